"""The dialects of the pbrt format, as data: what they call things, what they take for granted, how they are told apart.

Directives and words that all dialects share are not listed here. What the words of a dialect make is looked up by its
name in the tables of `dmis.pbrt_materials`, `dmis.pbrt_lights` and `dmis.pbrt_spectra`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from dmis.pixel_filter import PixelFilter

_NUMERIC = {"integer": 1, "float": 1, "point": 3, "vector": 3, "normal": 3, "rgb": 3, "blackbody": 2}
_SPECTRAL = {"color": 3, "xyz": 3}
_LATER = {"point2": 2, "vector2": 2, "point3": 3, "vector3": 3, "normal3": 3}

SAME_TYPE = {"point3": "point", "vector3": "vector", "normal3": "normal", "vector2": "point2"}
"""Types of later dialects that are others by a new name."""


@dataclass(frozen=True, eq=False)
class Dialect:
    """What a dialect calls things and takes for granted.

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
    fixed
        Parameters that change the image, by directive, with the only value that is rendered here.
    radius
        Names of a pixel filter's half widths.
    filter
        The filter where no PixelFilter line stands; None: a box of one pixel.
    levels
        Names of the number of subdivisions, the first that is there counts.
    t_up
        Whether the first row of a texture's image is t = 1, not 0.
    global_names
        Whether textures and named materials outlive the block they are made in.
    beyond
        How many surfaces more than ``maxdepth`` of a path integrator scatter light.
    overrides
        Whether parameters in a Shape line replace those of its material.
    bare_words
        Whether true and false may stand without quotes.
    ends
        Whether WorldEnd must close the world.
    """

    name: str
    types: Mapping[str, int]
    directives: frozenset[str]
    film: tuple[str, ...] = ("image",)
    film_size: tuple[int, int] = (1280, 720)
    fixed: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    radius: tuple[str, str] = ("xwidth", "ywidth")
    filter: PixelFilter | None = None
    levels: tuple[str, ...] = ("levels",)
    t_up: bool = True
    global_names: bool = False
    beyond: int = 0
    overrides: bool = True
    bare_words: bool = False
    ends: bool = True


V2 = Dialect(
    "v2",
    types=_NUMERIC | _SPECTRAL,
    directives=frozenset({"SurfaceIntegrator", "VolumeIntegrator", "Renderer", "Volume"}),
    film_size=(640, 480),
    levels=("nlevels",),
    t_up=False,
    beyond=1,
)
V3 = Dialect(
    "v3",
    types=_NUMERIC | _SPECTRAL | _LATER,
    directives=frozenset({"Integrator", "MakeNamedMedium", "MediumInterface"}),
    fixed={"Film": {"scale": 1.0, "maxsampleluminance": float("inf")}},
    levels=("levels", "nlevels"),
)
V4 = Dialect(
    "v4",
    types=_NUMERIC | _LATER | {"blackbody": 1},
    directives=frozenset({*V3.directives, "Attribute", "ColorSpace", "Import", "Option"}),
    film=("rgb", "gbuffer", "spectral"),
    fixed={
        "Film": {"iso": 100.0, "sensor": "cie1931", "whitebalance": 0.0, "maxcomponentvalue": float("inf")},
        "Camera": {"shutteropen": 0.0, "shutterclose": 1.0},
        "Integrator": {"regularize": False},
        "Option": {"disablepixeljitter": False, "forcediffuse": False, "disabletexturefiltering": False},
    },
    radius=("xradius", "yradius"),
    filter=PixelFilter("gaussian", (1.5, 1.5), 0.5),
    global_names=True,
    overrides=False,
    bare_words=True,
    ends=False,
)

DIALECTS = {dialect.name: dialect for dialect in (V2, V3, V4)}

_EARLIER = ("matte", "plastic", "metal", "mirror", "glass", "substrate", "uber", "translucent")
_V4_MATERIALS = (
    "diffuse",
    "conductor",
    "dielectric",
    "coateddiffuse",
    "coatedconductor",
    "thindielectric",
    "interface",
)

_MARKS: dict[str, str] = (
    dict.fromkeys(V2.directives, "v2")
    | dict.fromkeys(V3.directives, "v3 v4")
    | dict.fromkeys(V4.directives - V3.directives, "v4")
    | dict.fromkeys(_LATER, "v3 v4")
    | {f'Film "{name}"': "v4" for name in V4.film}
    | {'Film "image"': "v2 v3"}
    | {f'Material "{name}"': "v2 v3" for name in _EARLIER}
    | {f'Material "{name}"': "v4" for name in _V4_MATERIALS}
    | {f'{x} "{name}"': "v3 v4" for x in ("Sampler",) for name in ("sobol", "zsobol", "paddedsobol", "pmj02bn")}
    | {'AreaLightSource "area"': "v2", 'Integrator "directlighting"': "v3", 'Integrator "volpath"': "v3 v4"}
    | {'"bool remaproughness"': "v3 v4", '"integer pixelsamples"': "v2 v3 v4", "WorldEnd": "v2 v3"}
)
"""Dialects that have a directive, a directive with its first string, or a type of parameter."""


def detect(tokens: Iterable[Any]) -> Dialect:
    """The dialect of a file by its words; pbrt-v2 if they fit all.

    `tokens` are those of the file; what they say is put together until only one dialect has all of it. A word that
    contradicts the earlier ones is left for the reader to refuse.
    """
    left, before = set(DIALECTS), ""
    for token in tokens:
        keys: tuple[str, ...] = (token.text,)
        if token.kind == "string":
            keys = (f"{before} {token.text}", token.text, token.name.split(" ")[0])
        before = token.text
        for key in keys:
            narrowed = left & set(_MARKS.get(key, "v2 v3 v4").split())
            left = narrowed or left
        if len(left) == 1:
            break
    if "v2" not in left and len(left) > 1:  # no WorldEnd: v3 has one
        left = {"v4"}
    return DIALECTS[min(left)]
