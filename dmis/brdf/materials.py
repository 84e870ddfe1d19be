"""Materials: named sets of lobes, with the textbook definitions of those of pbrt; `dmis.brdf.models` has the
literature's.

Parameters are numbers, RGB triples or `dmis.brdf.texture.Image`; reflectances are in [0, 1], but for those of pbrt
files (`unbounded`). A black constant removes its lobe, so that nothing is sampled or evaluated for it. Fresnel terms
are the right way round here; the pbrt reader passes the reciprocal index for files of pbrt-v2, whose ``plastic`` and
``uber`` swap the two media. A parameter out of its range is a ValueError that names it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base.validate import check_methods
from dmis.base.vectors import Array
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.cosines import MAX_EXPONENT
from dmis.brdf.diffuse import Lambert, OrenNayar
from dmis.brdf.distributions import Anisotropic, Blinn, Distribution
from dmis.brdf.fresnel import Conductor, Dielectric
from dmis.brdf.lobe import DeltaLobe, Lobe
from dmis.brdf.microfacet import Microfacet
from dmis.brdf.specular import SpecularReflection, SpecularTransmission
from dmis.brdf.texture import FLOAT32_MAX, FLOAT32_TINY, Image, check_number, check_values, scale

Rgb = tuple[float, float, float]
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

    Raises
    ------
    ValueError
        If one of `lobes` is no lobe, or lacks a method that has no default.
    """

    lobes: tuple[Lobe, ...]
    name: str = "material"

    def __post_init__(self) -> None:
        if not isinstance(self.lobes, tuple | list):
            raise ValueError(f"lobes must be a tuple of lobes; got {self.lobes!r}. Write Material((lobe,))")
        for lobe in self.lobes:
            if not isinstance(lobe, Lobe):
                raise ValueError(
                    f"lobes must derive from dmis.brdf.lobe.Lobe or DeltaLobe, whose defaults a scene's plan reads; "
                    f"got {lobe!r}. Write class {type(lobe).__name__}(Lobe)"
                )
            if lobe.delta:
                check_methods(lobe, DeltaLobe, ["scatter"])
            else:
                check_methods(lobe, Lobe, ["eval", "pdf", "sample"])


def matte(kd: Any = 0.5, sigma: float = 0.0) -> Material:
    """Make a Lambert material, or Oren-Nayar if `sigma` (degrees) is not 0.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, in [0, 1]; black leaves the lobe out.
    sigma
        Spread of facet slopes in degrees, 0 to 90.
    """
    sigma = check_number("sigma", sigma, "in [0, 90] degrees", "it is the spread of facet slopes", 0, 90)
    if is_black("kd", kd):
        return Material((), "matte")
    return Material((OrenNayar(kd, sigma) if sigma else Lambert(kd),), "matte")


def plastic(kd: Any = 0.25, ks: Any = 0.25, roughness: Any = 0.1, eta: float = 1.5) -> Material:
    """Make a material of Lambert plus a Blinn microfacet coat of relative index `eta`; `ks` does not dim `kd`.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, in [0, 1]; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    roughness
        Positive, a number or an `Image`; Blinn's exponent is its reciprocal.
    eta
        Index of refraction of the coat, inside over outside: positive.
    """
    lobes: tuple[Lobe, ...] = ()
    coat = Microfacet(ks, blinn(roughness), Dielectric(check_ior("eta", eta)))
    if not is_black("kd", kd):
        lobes += (Lambert(kd),)
    if not is_black("ks", ks):
        lobes += (coat,)
    return Material(lobes, "plastic")


def metal(eta: Rgb = COPPER_ETA, k: Rgb = COPPER_K, roughness: Any = 0.01) -> Material:
    """Make a metal, a Blinn microfacet conductor; copper by default.

    Parameters
    ----------
    eta, k
        Index of refraction and absorption, RGB triples, not negative.
    roughness
        Positive, a number or an `Image`; Blinn's exponent is its reciprocal.
    """
    return Material(
        (Microfacet(1.0, blinn(roughness), Conductor(check_metal_index("eta", eta), check_metal_index("k", k))),),
        "metal",
    )


def shiny_metal(ks: Any = 1.0, kr: Any = 1.0, roughness: Any = 0.1) -> Material:
    """Make a glossy and a mirror lobe of conductors whose reflectance at normal incidence is `ks`, `kr`.

    Parameters
    ----------
    ks, kr
        Numbers or RGB triples in [0, 1]; black leaves the lobe out.
    roughness
        Positive, a number or an `Image`; Blinn's exponent is its reciprocal.
    """
    lobes: tuple[Lobe, ...] = ()
    facets = blinn(roughness)
    if not is_black("ks", ks):
        lobes += (Microfacet(1.0, facets, _conductor_of("ks", ks)),)
    if not is_black("kr", kr):
        lobes += (SpecularReflection(1.0, _conductor_of("kr", kr)),)
    return Material(lobes, "shinymetal")


def substrate(kd: Any = 0.5, ks: Any = 0.5, u_roughness: Any = 0.1, v_roughness: Any = 0.1) -> Material:
    """Make Ashikhmin and Shirley's diffuse base under a glossy coat; only if u and v differ it needs tangents.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, in [0, 1]; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    u_roughness, v_roughness
        Reciprocals of the exponents along the two tangents: positive, numbers or an `Image`.
    """
    is_black("kd", kd), is_black("ks", ks)
    u, v = _exponent("u_roughness", u_roughness), _exponent("v_roughness", v_roughness)
    same = u_roughness is v_roughness or u == v
    coat: Distribution = Blinn(u) if same else Anisotropic(u, v)
    return Material((BlendBase(kd, ks), BlendCoat(ks, coat)), "substrate")


def uber(
    kd: Any = 0.25,
    ks: Any = 0.25,
    kr: Any = 0.0,
    kt: Any = 0.0,
    roughness: Any = 0.1,
    eta: float = 1.5,
    opacity: Any = 1.0,
) -> Material:
    """Make diffuse, glossy, mirror and refraction in one, of which a share ``1 - opacity`` is clear.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, in [0, 1]; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    kr, kt
        Reflectance of the mirror and transmittance of the refraction, likewise.
    roughness
        Positive, a number or an `Image`; Blinn's exponent is its reciprocal.
    eta
        Index of refraction, inside over outside: positive.
    opacity
        A number or an RGB triple in [0, 1].
    """
    for name, value in (("kd", kd), ("ks", ks), ("kr", kr), ("kt", kt)):
        is_black(name, value)
    clear = 1 - check_values("opacity", opacity, "in [0, 1]", "the rest goes straight through", 0, 1, image=False)
    facets, fresnel = blinn(roughness), Dielectric(check_ior("eta", eta))
    lobes: tuple[Lobe, ...] = ()
    if clear.any():
        lobes += (SpecularTransmission(tuple(clear.tolist()), 1.0),)
    if not is_black("kd", kd := scale(opacity, kd)):
        lobes += (Lambert(kd),)
    if not is_black("ks", ks := scale(opacity, ks)):
        lobes += (Microfacet(ks, facets, fresnel),)
    if not is_black("kr", kr := scale(opacity, kr)):
        lobes += (SpecularReflection(kr, fresnel),)
    if not is_black("kt", kt := scale(opacity, kt)):
        lobes += (SpecularTransmission(kt, fresnel.eta),)
    return Material(lobes, "uber")


def mirror(kr: Any = 0.9) -> Material:
    """Make a perfect mirror of reflectance `kr`, which is followed as a ray of its own and takes no part in MIS.

    Parameters
    ----------
    kr
        A number, an RGB triple or an `Image`, in [0, 1].
    """
    lobes: tuple[DeltaLobe, ...] = () if is_black("kr", kr) else (SpecularReflection(kr),)
    return Material(lobes, "mirror")


def glass(kr: Any = 1.0, kt: Any = 1.0, eta: float = 1.5) -> Material:
    """Make smooth glass: mirror reflection and refraction, divided by Fresnel.

    Parameters
    ----------
    kr, kt
        Factors of the reflected and of the refracted part: numbers, RGB triples or `Image`, in [0, 1].
    eta
        Index of refraction, inside over outside: positive.
    """
    eta = check_ior("eta", eta)
    lobes: tuple[Lobe, ...] = ()
    if not is_black("kr", kr):
        lobes += (SpecularReflection(kr, Dielectric(eta)),)
    if not is_black("kt", kt):
        lobes += (SpecularTransmission(kt, eta),)
    return Material(lobes, "glass")


def blinn(roughness: Any) -> Blinn:
    """Return Blinn's distribution of exponent ``1/roughness``."""
    return Blinn(_exponent("roughness", roughness))


class ReciprocalImage(Image):
    """One over the interpolated texels: the exponent where the image is roughness."""

    def __call__(self, uv: Array) -> Array:
        return 1 / super().__call__(uv)


def _exponent(name: str, roughness: Any) -> Any:
    least, reason = 1 / MAX_EXPONENT, "Blinn's exponent is its reciprocal"
    roughness = check_number(name, roughness, f"positive and finite, at least {least:g}", reason, least, image=True)
    if isinstance(roughness, Image):
        return ReciprocalImage(roughness.texels, roughness.scale, roughness.offset, roughness.wrap)
    return 1 / roughness


def _conductor_of(name: str, reflectance: Any) -> Conductor:
    """Return the conductor with k = 0 of a normal reflectance: ``eta = (1 + sqrt r) / (1 - sqrt r)``."""
    r = check_values(name, reflectance, "in [0, 1]", "a conductor is made that reflects it", 0, 1, image=False)
    r = np.minimum(np.broadcast_to(r, 3), 0.999)
    eta = (1 + np.sqrt(r)) / (1 - np.sqrt(r))
    return Conductor((float(eta[0]), float(eta[1]), float(eta[2])), (0.0, 0.0, 0.0))


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


def check_ior(name: str, eta: Any) -> float:
    """Return an index of refraction, inside over outside, as a float; refuse one that is not positive."""
    return float(check_number(name, eta, "positive and finite", "it is a ratio of speeds of light", FLOAT32_TINY))


def check_metal_index(name: str, value: Any) -> Rgb:
    """Return the index of refraction or absorption of a metal as three floats; refuse negative ones."""
    numbers = check_values(name, value, "finite and not negative", "it is part of a metal's index", image=False)
    r, g, b = np.broadcast_to(numbers, 3).tolist()
    return r, g, b
