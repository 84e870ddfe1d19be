"""The dialects of the pbrt format as data: their names, their defaults, and the words that tell them apart.

Directives and words that all dialects share are not listed here. The materials, lights and spectra of a dialect are in
`make_material`, `materials_v3`, `materials_v4`, `lights` and `spectra`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from dmis.samplers.pixel_filter import PixelFilter

_NUMERIC = {"integer": 1, "float": 1, "point": 3, "vector": 3, "normal": 3, "rgb": 3, "blackbody": 2}
_SPECTRAL = {"color": 3, "xyz": 3}
_LATER = {"point2": 2, "vector2": 2, "point3": 3, "vector3": 3, "normal3": 3}
SAME_TYPE = {"point3": "point", "vector3": "vector", "normal3": "normal", "vector2": "point2"}
"""Types of v3 and v4 that rename types of v2."""


@dataclass(frozen=True, eq=False)
class Dialect:
    """Names, types and defaults of a dialect.

    Attributes
    ----------
    name
        v2, v3 or v4.
    types
        Types of parameters that hold numbers, with how many each.
    directives
        Directives that not all dialects have.
    film
        Names of the film that makes an image.
    film_size
        Width and height where the Film line has none.
    required
        Parameters of the film that change the image, with the only supported value.
    unapplied
        Parameters whose effect on the image is left out with a warning, by directive, with the value that has no
        effect; None: each has one.
    integrators
        Integrators whose expected image is that of paths, and those whose own image is biased and is replaced by paths
        with a warning.
    radius
        Names of a pixel filter's half widths.
    filter
        The filter of a file without a PixelFilter line; None: a box of one pixel.
    """

    name: str
    types: Mapping[str, int]
    directives: frozenset[str]
    film: tuple[str, ...] = ("image",)
    film_size: tuple[int, int] = (1280, 720)
    required: Mapping[str, Any] = field(default_factory=dict)
    unapplied: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    integrators: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    radius: tuple[str, str] = ("xwidth", "ywidth")
    filter: PixelFilter | None = None


V2 = Dialect(
    "v2",
    types=_NUMERIC | _SPECTRAL,
    directives=frozenset({"SurfaceIntegrator", "VolumeIntegrator", "Renderer", "Volume"}),
    film_size=(640, 480),
    integrators=(("path",), ("photonmap", "exphotonmap", "igi", "irradiancecache")),
)
V3 = Dialect(
    "v3",
    types=_NUMERIC | _SPECTRAL | _LATER,
    directives=frozenset({"Integrator", "MakeNamedMedium", "MediumInterface"}),
    unapplied={"Film": {"scale": [1.0], "maxsampleluminance": None}},
    integrators=(("path", "volpath", "bdpt", "mlt"), ("sppm",)),
)
V4 = Dialect(
    "v4",
    types=_NUMERIC | _LATER | {"blackbody": 1},
    directives=frozenset({*V3.directives, "Attribute", "ColorSpace", "Import", "Option"}),
    film=("rgb", "gbuffer", "spectral"),
    integrators=(("path", "volpath", "bdpt", "mlt", "simplepath", "simplevolpath", "randomwalk"), ("sppm",)),
    required={"sensor": "cie1931", "whitebalance": 0.0},
    unapplied={
        "Film": {"iso": [100.0], "maxcomponentvalue": None},
        "Camera": {"shutteropen": [0.0], "shutterclose": [1.0]},
        "Integrator": {"regularize": ["false"]},
    },
    radius=("xradius", "yradius"),
    filter=PixelFilter("gaussian", (1.5, 1.5), 0.5),
)
DIALECTS = {dialect.name: dialect for dialect in (V2, V3, V4)}
IRRELEVANT = {
    "Camera": frozenset({"shutteropen", "shutterclose", "focaldistance", "hither", "yon"}),
    "Film": frozenset({"filename", "diagonal", "display", "savefp16", "premultiplyalpha", "writefrequency"}),
    "LightSource": frozenset({"nsamples", "samples"}),
    "AreaLightSource": frozenset({"nsamples", "samples"}),
    "Shape": frozenset({"discarddegenerateUVs", "levels", "nlevels"}),
    **dict.fromkeys(
        ("Integrator", "SurfaceIntegrator"),
        frozenset(
            "lightsamplestrategy lightsampler rrthreshold pixelbounds nsamples mutationsperpixel chains sigma radius "
            "samplebsdf bootstrapsamples largestepprobability samplelights photonsperiteration iterations".split()
        ),
    ),
}
"""Parameters that do not change the expected image, by directive; those of Sampler and Renderer never do."""
_WORDS = """
v2    : Material         : shinymetal
v2 v3 : Film             : image
v2 v3 : Camera           : environment
v4    : Camera           : spherical
v2 v3 : Sampler          : lowdiscrepancy random
v2 v3 : Material         : matte plastic metal mirror glass substrate uber
v2 v3 : AreaLightSource  : area
v3    : Sampler          : 02sequence maxmindist
v3    : Integrator       : directlighting whitted
v3 v4 : Sampler          : sobol
v3 v4 : Integrator       : volpath bdpt mlt sppm
v4    : Integrator       : simplepath simplevolpath randomwalk
v3 v4 : Shape            : plymesh
v4    : Film             : rgb gbuffer spectral
v4    : Sampler          : independent paddedsobol pmj02bn zsobol
v4    : Shape            : bilinearmesh
v4    : Material         : diffuse conductor dielectric coateddiffuse coatedconductor
v2    : Camera           : hither yon
v2    : Film             : premultiplyalpha writefrequency
v2 v3 : PixelFilter      : xwidth ywidth alpha
v2 v3 : LightSource      : nsamples mapname
v2 v3 : AreaLightSource  : nsamples
v2 v3 : Shape            : nlevels
v3    : Film             : scale maxsampleluminance
v3    : LightSource      : samples
v3    : AreaLightSource  : samples
v3 v4 : Film             : diagonal
v3 v4 : AreaLightSource  : twosided
v3 v4 : Shape            : levels
v3 v4 : Material         : remaproughness
v3 v4 : MakeNamedMaterial: remaproughness
v4    : Film             : iso sensor whitebalance maxcomponentvalue
v4    : PixelFilter      : xradius yradius sigma
v4    : LightSource      : filename illuminance power portal
v4    : AreaLightSource  : power
"""
"""Dialects, a directive, and supported first strings (of materials also in MakeNamedMaterial) or parameters of it that
only these dialects have."""
_OWNERS = {
    (directive.strip(), word): dialects
    for dialects, directive, words in (row.split(":") for row in _WORDS.strip().splitlines())
    for word in words.split()
}
_OWNERS |= dict.fromkeys((("", word) for word in V2.directives), "v2")
_OWNERS |= dict.fromkeys((("", word) for word in V4.directives), "v4")
_OWNERS |= dict.fromkeys((("", word) for word in (*V3.directives, *_LATER)), "v3 v4")
_OWNERS |= dict.fromkeys((("", word) for word in (*_SPECTRAL, "WorldEnd")), "v2 v3")
"""Dialects by directive and word; directives and types of parameters have an empty directive."""


def detect(tokens: Iterable[Any]) -> tuple[Dialect, tuple[str, ...]]:
    """Return the dialect by which to read a file, and the names of all dialects that fit its words.

    The words of the file `tokens` rule dialects out until one remains. If several remain, the first of them is a guess.
    The reader refuses a word that contradicts earlier ones. Without WorldEnd a file that is not of v2 is of v4.
    """
    remaining, directive, before = set(DIALECTS), "", ""
    for token in tokens:
        for key in _marks(token, directive, before):
            remaining = remaining & set(_OWNERS.get(key, "").split()) or remaining
        if len(remaining) == 1:
            break
        if token.kind == "word" and token.text[0].isalpha():
            directive = token.text
        before = token.text
    if "v2" not in remaining and len(remaining) > 1:  # no WorldEnd: v3 has one
        remaining = {"v4"}
    fits = tuple(sorted(remaining))
    return DIALECTS[fits[0]], fits


def _marks(token: Any, directive: str, before: str) -> Iterator[tuple[str, str]]:
    """Yield the keys of `_OWNERS` for a token in the parameters of `directive` and behind the token `before`."""
    if token.kind == "word":
        yield "", token.text
    elif directive == "MakeNamedMaterial" and before == '"string type"':
        yield "Material", token.text.strip('[]" \t\r\n')
    elif token.kind == "string" and before == directive:
        yield directive, token.name
    elif token.kind == "string":
        kind, _, name = token.name.strip().partition(" ")
        if name:
            yield from (("", kind), (directive, name.strip()))
