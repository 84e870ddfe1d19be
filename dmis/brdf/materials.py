"""Materials: named sets of lobes, with the textbook definitions of those of pbrt; `dmis.brdf.models` has the
literature's.

A parameter out of its range is a ValueError that names it. The following have one meaning in all materials; numbers,
RGB triples, `dmis.brdf.texture.Image` and paths of image files will do, but where only some of them are named:

kd, ks, kr, kt
    Reflectance of the diffuse lobe, the glossy lobe and the mirror, and transmittance: in [0, 1], but for those of pbrt
    files (`unbounded`). Black leaves the lobe out, so that nothing is sampled or evaluated for it.
roughness
    Positive, a number or an `Image`; Blinn's exponent is its reciprocal.
eta
    Index of refraction, inside over outside: a positive number. The reader of pbrt-v2 passes the reciprocal for its
    ``plastic`` and ``uber``, which swap the two media. Of a metal it is an RGB triple, and so is its absorption `k`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.base.color import Rgb
from dmis.base.validate import check_methods
from dmis.base.vectors import Array
from dmis.brdf.distributions import Anisotropic, Blinn
from dmis.brdf.fresnel import Conductor, Dielectric, check_ior, check_metal_index
from dmis.brdf.lobe import MAX_LOBE_EXPONENT, DeltaLobe, Lambert, Lobe, OrenNayar
from dmis.brdf.microfacet import Microfacet
from dmis.brdf.texture import FLOAT32_MAX, Image, check_number, check_values, reads_images, scale

if TYPE_CHECKING:
    from dmis.brdf.relief import Relief

COPPER_ETA: Rgb = (0.200438, 0.924033, 1.102212)
COPPER_K: Rgb = (3.912949, 2.452848, 2.142188)


@dataclass(frozen=True, eq=False)
class Material:
    """A surface's reflection: the sum of its lobes; sampling picks one of the non-delta lobes uniformly.

    Parameters
    ----------
    lobes
        Any number, see `dmis.brdf` and `dmis.brdf.phong`; none is black.
    name
        For tables and messages.
    relief
        What turns the shading normals, see `dmis.brdf.relief`; None: nothing.

    Raises
    ------
    ValueError
        If one of `lobes` is no lobe, or lacks a method that has no default.
    """

    lobes: tuple[Lobe, ...]
    name: str = "material"
    relief: Relief | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.lobes, tuple | list):
            raise ValueError(f"lobes must be a tuple of lobes; got {self.lobes!r}. Write Material((lobe,))")
        for lobe in self.lobes:
            if not isinstance(lobe, Lobe):
                raise ValueError(
                    f"lobes must derive from dmis.brdf.lobe.Lobe or DeltaLobe, whose defaults a scene's plan reads; "
                    f"got {lobe!r}. Write class {type(lobe).__name__}(Lobe)"
                )
            base, methods = (DeltaLobe, ["scatter"]) if lobe.delta else (Lobe, ["eval", "pdf", "sample"])
            check_methods(lobe, base, methods)


def assemble(name: str, *lobes: tuple[str, Any, Lobe]) -> Material:
    """Return a material of the lobes that are not black, each with the name and value of its reflectance."""
    return Material(tuple(lobe for parameter, value, lobe in lobes if not is_black(parameter, value)), name)


@reads_images
def matte(kd: Any = 0.5, sigma: float = 0.0) -> Material:
    """Make a Lambert material, or Oren-Nayar if `sigma`, the spread of facet slopes (0 to 90 degrees), is not 0."""
    sigma = check_number("sigma", sigma, "in [0, 90] degrees", "it is the spread of facet slopes", 0, 90)
    return assemble("matte", ("kd", kd, OrenNayar(kd, sigma) if sigma else Lambert(kd)))


@reads_images
def plastic(kd: Any = 0.25, ks: Any = 0.25, roughness: Any = 0.1, eta: float = 1.5) -> Material:
    """Make a material of Lambert plus a Blinn microfacet coat of relative index `eta`; `ks` does not dim `kd`."""
    coat = Microfacet(ks, blinn(roughness), Dielectric(check_ior("eta", eta)))
    return assemble("plastic", ("kd", kd, Lambert(kd)), ("ks", ks, coat))


@reads_images
def metal(eta: Rgb = COPPER_ETA, k: Rgb = COPPER_K, roughness: Any = 0.01) -> Material:
    """Make a metal, a Blinn microfacet conductor; copper by default."""
    fresnel = Conductor(check_metal_index("eta", eta), check_metal_index("k", k))
    return Material((Microfacet(1.0, blinn(roughness), fresnel),), "metal")


@reads_images
def shiny_metal(ks: Any = 1.0, kr: Any = 1.0, roughness: Any = 0.1) -> Material:
    """Make a glossy and a mirror lobe of conductors whose reflectance at normal incidence is `ks`, `kr`, no images."""
    from dmis.brdf.specular import SpecularReflection

    is_black("ks", ks), is_black("kr", kr)
    glossy = Microfacet(1.0, blinn(roughness), _conductor_of("ks", ks))
    return assemble("shinymetal", ("ks", ks, glossy), ("kr", kr, SpecularReflection(1.0, _conductor_of("kr", kr))))


@reads_images
def substrate(kd: Any = 0.5, ks: Any = 0.5, u_roughness: Any = 0.1, v_roughness: Any = 0.1) -> Material:
    """Make Ashikhmin and Shirley's diffuse base under a glossy coat, of a roughness along each of the two tangents.

    Only if they differ it needs tangents.
    """
    from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat

    is_black("kd", kd), is_black("ks", ks)
    u = _exponent("u_roughness", u_roughness)
    v = _exponent("v_roughness", v_roughness)
    same = u_roughness is v_roughness or u == v
    coat = Blinn(u) if same else Anisotropic(u, v)
    return Material((BlendBase(kd, ks), BlendCoat(ks, coat)), "substrate")


@reads_images
def uber(
    kd: Any = 0.25, ks: Any = 0.25, kr: Any = 0, kt: Any = 0, roughness: Any = 0.1, eta: float = 1.5, opacity: Any = 1
) -> Material:
    """Make diffuse, glossy, mirror and refraction in one; a share ``1 - opacity`` (number or RGB) is clear."""
    from dmis.brdf.specular import SpecularReflection, SpecularTransmission

    for name, value in (("kd", kd), ("ks", ks), ("kr", kr), ("kt", kt)):
        is_black(name, value)
    clear = 1 - check_values("opacity", opacity, "in [0, 1]", "the rest goes straight through", 0, 1, image=False)
    facets = blinn(roughness)
    fresnel = Dielectric(check_ior("eta", eta))
    kd, ks, kr, kt = (scale(opacity, value) for value in (kd, ks, kr, kt))
    return assemble(
        "uber",
        ("opacity", tuple(clear.tolist()), SpecularTransmission(tuple(clear.tolist()), 1.0)),
        ("kd", kd, Lambert(kd)),
        ("ks", ks, Microfacet(ks, facets, fresnel)),
        ("kr", kr, SpecularReflection(kr, fresnel)),
        ("kt", kt, SpecularTransmission(kt, fresnel.eta)),
    )


@reads_images
def mirror(kr: Any = 0.9) -> Material:
    """Make a perfect mirror of reflectance `kr`, which is followed as a ray of its own and takes no part in MIS."""
    from dmis.brdf.specular import SpecularReflection

    return assemble("mirror", ("kr", kr, SpecularReflection(kr)))


@reads_images
def glass(kr: Any = 1.0, kt: Any = 1.0, eta: float = 1.5) -> Material:
    """Make smooth glass: mirror reflection and refraction, divided by Fresnel."""
    from dmis.brdf.specular import SpecularReflection, SpecularTransmission

    eta = check_ior("eta", eta)
    mirrored = SpecularReflection(kr, Dielectric(eta))
    refracted = SpecularTransmission(kt, eta)
    return assemble("glass", ("kr", kr, mirrored), ("kt", kt, refracted))


def blinn(roughness: Any) -> Blinn:
    """Return Blinn's distribution of exponent ``1/roughness``."""
    return Blinn(_exponent("roughness", roughness))


class ReciprocalImage(Image):
    """One over the interpolated texels: the exponent where the image is roughness."""

    def __call__(self, uv: Array) -> Array:
        return 1 / super().__call__(uv)


def _exponent(name: str, roughness: Any) -> Any:
    least = 1 / MAX_LOBE_EXPONENT
    reason = "Blinn's exponent is its reciprocal"
    roughness = check_number(name, roughness, f"positive and finite, at least {least:g}", reason, least, image=True)
    if isinstance(roughness, Image):
        return ReciprocalImage(**{f.name: getattr(roughness, f.name) for f in fields(roughness)})
    return 1 / roughness


def _conductor_of(name: str, reflectance: Any) -> Conductor:
    """Return the conductor with k = 0 of a normal reflectance: ``eta = (1 + sqrt r) / (1 - sqrt r)``."""
    r = check_values(name, reflectance, "in [0, 1]", "a conductor is made that reflects it", 0, 1, image=False)
    root = np.sqrt(np.minimum(np.broadcast_to(r, 3), 0.999))
    return Conductor(tuple(((1 + root) / (1 - root)).tolist()), (0.0, 0.0, 0.0))


_most_reflected: ContextVar[float] = ContextVar("_most_reflected", default=1 + 1e-6)
"""Largest reflectance; 1 up to rounding."""


@contextmanager
def unbounded() -> Iterator[None]:
    """Let the reflectances of materials that are made inside exceed 1, as those of pbrt files may."""
    before = _most_reflected.set(FLOAT32_MAX)
    try:
        yield
    finally:
        _most_reflected.reset(before)


def is_black(name: str, value: Any) -> bool:
    """Return whether a reflectance is a constant 0; refuse one that is negative, or above 1 (but see `unbounded`)."""
    numbers = check_values(name, value, "finite and not negative", "it is a reflectance")
    remedy = "no surface reflects more light than it gets; divide values of 8 bits by 255 and make them linear"
    check_values(name, value, "at most 1", remedy, 0, _most_reflected.get())
    return not isinstance(value, Image) and not numbers.any()
