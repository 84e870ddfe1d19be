"""Materials: named sets of lobes, with the textbook definitions of pbrt's materials, and the models of the literature.

Parameters are numbers, RGB triples or `dmis.texture.Image`. A black constant removes its lobe, so that nothing is
sampled or evaluated for it. Fresnel terms are the right way round here; the pbrt reader passes the reciprocal index
for files of pbrt-v2, whose ``plastic`` and ``uber`` swap the two media. A parameter out of its range is a ValueError
that names it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.brdf import (
    Anisotropic,
    BlendBase,
    BlendCoat,
    Blinn,
    Conductor,
    Delta,
    Dielectric,
    Distribution,
    Fresnel,
    Glossy,
    Lambert,
    Lobe,
    Microfacet,
    OrenNayar,
    SpecularReflection,
    SpecularTransmission,
)
from dmis.ggx import GGX
from dmis.glossy import AshikhminShirley, BlinnPhong, Lafortune, Ward
from dmis.roughness import LEAST_ALPHA, Beckmann, Elliptic, Isotropic, Roughness
from dmis.texture import Image, scale
from dmis.vec import Array

Rgb = tuple[float, float, float]

COPPER_ETA: Rgb = (0.200438, 0.924033, 1.102212)
COPPER_K: Rgb = (3.912949, 2.452848, 2.142188)


@dataclass(frozen=True, eq=False)
class Material:
    """A surface's reflection: the sum of its lobes; sampling picks one of the non-delta lobes uniformly.

    Parameters
    ----------
    lobes
        Any number, see `dmis.brdf` and `dmis.glossy`; none is black.
    name
        For tables and messages.
    """

    lobes: tuple[Lobe, ...]
    name: str = "material"


def matte(kd: Any = 0.5, sigma: float = 0.0) -> Material:
    """Lambert, or Oren-Nayar if `sigma` (degrees) is not 0.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    sigma
        Spread of facet slopes in degrees, 0 to 90.
    """
    if not 0 <= sigma <= 90:
        raise ValueError(f"sigma must be in [0, 90] degrees, the spread of facet slopes; got {sigma}")
    if _black("kd", kd):
        return Material((), "matte")
    return Material((OrenNayar(kd, sigma) if sigma else Lambert(kd),), "matte")


def plastic(kd: Any = 0.25, ks: Any = 0.25, roughness: Any = 0.1, eta: float = 1.5) -> Material:
    """Lambert plus a Blinn microfacet coat of relative index `eta`; `ks` does not dim `kd`.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    roughness
        Positive, a number or an `Image`; Blinn's exponent is its reciprocal.
    eta
        Index of refraction of the coat, inside over outside.
    """
    lobes: tuple[Lobe, ...] = ()
    if not _black("kd", kd):
        lobes += (Lambert(kd),)
    if not _black("ks", ks):
        lobes += (Microfacet(ks, blinn(roughness), Dielectric(eta)),)
    return Material(lobes, "plastic")


def metal(eta: Rgb = COPPER_ETA, k: Rgb = COPPER_K, roughness: Any = 0.01) -> Material:
    """A Blinn microfacet conductor; copper by default.

    Parameters
    ----------
    eta, k
        Index of refraction and absorption, RGB triples, not negative.
    roughness
        Positive, a number or an `Image`; Blinn's exponent is its reciprocal.
    """
    return Material((Microfacet(1.0, blinn(roughness), Conductor(_triple("eta", eta), _triple("k", k))),), "metal")


def shiny_metal(ks: Any = 1.0, kr: Any = 1.0, roughness: Any = 0.1) -> Material:
    """A glossy and a mirror lobe, both with the conductor whose reflectance at normal incidence is `ks`, `kr`.

    Parameters
    ----------
    ks, kr
        Numbers or RGB triples in [0, 1]; black leaves the lobe out.
    roughness
        Positive, a number or an `Image`; Blinn's exponent is its reciprocal.
    """
    lobes: tuple[Lobe, ...] = ()
    if not _black("ks", ks):
        lobes += (Microfacet(1.0, blinn(roughness), _conductor_of("ks", ks)),)
    if not _black("kr", kr):
        lobes += (SpecularReflection(1.0, _conductor_of("kr", kr)),)
    return Material(lobes, "shinymetal")


def substrate(kd: Any = 0.5, ks: Any = 0.5, u_roughness: Any = 0.1, v_roughness: Any = 0.1) -> Material:
    """Ashikhmin and Shirley's diffuse base under a glossy coat; a tangent frame is needed only if u and v differ.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    u_roughness, v_roughness
        Reciprocals of the exponents along the two tangents: positive, numbers or an `Image`.
    """
    _black("kd", kd), _black("ks", ks)
    same = u_roughness is v_roughness or (
        not isinstance(u_roughness, Image) and not isinstance(v_roughness, Image) and u_roughness == v_roughness
    )
    coat: Distribution = blinn(u_roughness)
    if not same:
        coat = Anisotropic(_exponent("u_roughness", u_roughness), _exponent("v_roughness", v_roughness))
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
    """Diffuse, glossy, mirror and refraction together, all but a share ``1 - opacity`` that passes straight through.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    kr, kt
        Reflectance of the mirror and transmittance of the refraction, likewise.
    roughness
        Positive, a number or an `Image`; Blinn's exponent is its reciprocal.
    eta
        Index of refraction, inside over outside.
    opacity
        A number or an RGB triple in [0, 1].
    """
    if isinstance(opacity, Image):
        raise ValueError("opacity must be a constant; got an image texture, which is not supported")
    clear = np.maximum(1 - np.atleast_1d(np.asarray(opacity, float)), 0)
    lobes: tuple[Lobe, ...] = ()
    if clear.any():
        lobes += (SpecularTransmission(tuple(clear.tolist()), 1.0),)
    if not _black("kd", kd := scale(opacity, kd)):
        lobes += (Lambert(kd),)
    if not _black("ks", ks := scale(opacity, ks)):
        lobes += (Microfacet(ks, blinn(roughness), Dielectric(eta)),)
    if not _black("kr", kr := scale(opacity, kr)):
        lobes += (SpecularReflection(kr, Dielectric(eta)),)
    if not _black("kt", kt := scale(opacity, kt)):
        lobes += (SpecularTransmission(kt, eta),)
    return Material(lobes, "uber")


def mirror(kr: Any = 0.9) -> Material:
    """A perfect mirror of reflectance `kr`, which is followed as a ray of its own and takes no part in MIS.

    Parameters
    ----------
    kr
        A number, an RGB triple or an `Image`, not negative.
    """
    lobes: tuple[Delta, ...] = () if _black("kr", kr) else (SpecularReflection(kr),)
    return Material(lobes, "mirror")


def glass(kr: Any = 1.0, kt: Any = 1.0, eta: float = 1.5) -> Material:
    """Smooth glass: mirror reflection and refraction, divided by Fresnel.

    Parameters
    ----------
    kr, kt
        Factors of the reflected and of the refracted part: numbers, RGB triples or `Image`, not negative.
    eta
        Index of refraction, inside over outside.
    """
    lobes: tuple[Lobe, ...] = ()
    if not _black("kr", kr):
        lobes += (SpecularReflection(kr, Dielectric(eta)),)
    if not _black("kt", kt):
        lobes += (SpecularTransmission(kt, eta),)
    return Material(lobes, "glass")


# Models of the literature: one glossy lobe of reflectance `ks`, over Lambert's of `kd` if that is not black -----------


def phong(kd: Any = 0.0, ks: Any = 0.5, exponent: Any = 50.0) -> Material:
    """Phong's cosine lobe about the mirror direction, normalised; see `dmis.glossy.Lafortune`.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    exponent
        Of the cosine: positive, a number or an `Image`.
    """
    return _over(kd, ks, Lafortune(ks, _power("exponent", exponent)), "phong")


def lafortune(kd: Any = 0.0, ks: Any = 0.5, exponent: Any = 50.0, c_t: float = -1.0, c_n: float = 0.9) -> Material:
    """Lafortune's cosine lobe; its direction is wo with its tangential part times `c_t`, its normal part times `c_n`.

    ``c_t = -1`` with ``c_n < 1`` is off-specular, ``c_t > 0`` sends light back to where it came from. Put several
    lobes in one `Material` to fit a measured surface.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    exponent
        Of the cosine: positive, a number or an `Image`.
    c_t, c_n
        In [-1, 1] and (0, 1].
    """
    if not (abs(c_t) <= 1 and 0 < c_n <= 1):
        raise ValueError(
            f"c_t must be in [-1, 1] and c_n in (0, 1], because the lobe's peak grows with their power; "
            f"got c_t {c_t}, c_n {c_n}"
        )
    return _over(kd, ks, Lafortune(ks, _power("exponent", exponent), float(c_t), float(c_n)), "lafortune")


def blinn_phong(kd: Any = 0.0, ks: Any = 0.5, exponent: Any = 50.0) -> Material:
    """A cosine lobe of the half vector without masking, normalised; see `dmis.glossy.BlinnPhong`.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    exponent
        Of the cosine: positive, a number or an `Image`.
    """
    return _over(kd, ks, BlinnPhong(ks, Blinn(_power("exponent", exponent))), "blinnphong")


def ward(kd: Any = 0.0, ks: Any = 0.5, alpha: Any = 0.15, alpha_v: Any = None) -> Material:
    """Ward's Gaussian lobe with bounded albedo; anisotropic if `alpha_v` is given; see `dmis.glossy.Ward`.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    alpha, alpha_v
        Roughness, the alpha of the distribution of facets: positive, a number or an `Image`; with `alpha_v`, along
        the two tangents.
    """
    return _over(kd, ks, Ward(ks, Beckmann(spread(alpha, alpha_v))), "ward")


def ashikhmin_shirley(kd: Any = 0.5, ks: Any = 0.05, n_u: Any = 100.0, n_v: Any = None) -> Material:
    """Ashikhmin and Shirley's model as in their paper: diffuse base, and a coat of normal reflectance `ks`.

    `n_u` and `n_v` are the exponents along the two tangents, the same if `n_v` is None. `substrate` is pbrt's variant,
    whose coat has a slightly larger factor.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the coat at normal incidence, likewise.
    n_u, n_v
        Positive, numbers or an `Image`.
    """
    _black("kd", kd), _black("ks", ks)
    distribution: Distribution = Blinn(_power("n_u", n_u))
    if n_v is not None:
        distribution = Anisotropic(_power("n_u", n_u), _power("n_v", n_v))
    return Material((BlendBase(kd, ks), AshikhminShirley(ks, distribution)), "ashikhminshirley")


def torrance_sparrow(kd: Any = 0.0, ks: Any = 1.0, exponent: Any = 50.0, fresnel: Fresnel | None = None) -> Material:
    """V-shaped facets with Blinn's distribution; `fresnel` None reflects everything; see `dmis.brdf.Microfacet`.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    exponent
        Of the cosine: positive, a number or an `Image`.
    fresnel
        `dmis.brdf.Dielectric`, `dmis.brdf.Conductor`, or None, which reflects everything.
    """
    return _over(kd, ks, Microfacet(ks, Blinn(_power("exponent", exponent)), fresnel), "torrancesparrow")


def cook_torrance(
    kd: Any = 0.0, ks: Any = 1.0, alpha: Any = 0.15, alpha_v: Any = None, fresnel: Fresnel | None = None
) -> Material:
    """V-shaped facets with Beckmann's distribution; the paper's factor 1/pi is 1/4 here, which conserves energy.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    alpha, alpha_v
        Roughness, the alpha of the distribution of facets: positive, a number or an `Image`; with `alpha_v`, along
        the two tangents.
    fresnel
        `dmis.brdf.Dielectric`, `dmis.brdf.Conductor`, or None, which reflects everything.
    """
    return _over(kd, ks, Microfacet(ks, Beckmann(spread(alpha, alpha_v)), fresnel), "cooktorrance")


def ggx(
    kd: Any = 0.0, ks: Any = 1.0, alpha: Any = 0.15, alpha_v: Any = None, fresnel: Fresnel | None = None
) -> Material:
    """Facets with the distribution of Trowbridge and Reitz and Smith's masking; see `dmis.ggx`.

    Parameters
    ----------
    kd
        Diffuse reflectance: a number, an RGB triple or an `Image`, not negative; black leaves the lobe out.
    ks
        Reflectance of the glossy lobe, likewise.
    alpha, alpha_v
        Roughness, the alpha of the distribution of facets: positive, a number or an `Image`; with `alpha_v`, along
        the two tangents.
    fresnel
        `dmis.brdf.Dielectric`, `dmis.brdf.Conductor`, or None, which reflects everything.
    """
    return _over(kd, ks, GGX(ks, spread(alpha, alpha_v), fresnel), "ggx")


def _over(kd: Any, ks: Any, lobe: Glossy, name: str) -> Material:
    """A glossy lobe of reflectance `ks` and a Lambert lobe, without those that are black."""
    lobes: tuple[Lobe, ...] = () if _black("kd", kd) else (Lambert(kd),)
    return Material(lobes if _black("ks", ks) else (*lobes, lobe), name)


def _power(name: str, exponent: Any) -> Any:
    _check(name, exponent, 0.0, "because the lobe is a cosine to this power")
    return exponent if isinstance(exponent, Image) else float(exponent)


def spread(alpha: Any, alpha_v: Any = None) -> Roughness:
    """Roughness alpha along both tangents; equal in all directions if `alpha_v` is None."""
    for name, value in (("alpha", alpha), ("alpha_v", alpha_v)):
        if value is not None:
            _check(name, value, LEAST_ALPHA, f"at least {LEAST_ALPHA:g}, which is what float32 directions resolve")
    return Isotropic(alpha) if alpha_v is None else Elliptic(alpha, alpha_v)


def _check(name: str, value: Any, least: float, reason: str) -> None:
    """Raise unless a number, or all texels of an image, are positive, finite, and at least `least`."""
    texels = value.texels if isinstance(value, Image) else np.asarray(value, float)
    if not isinstance(value, Image) and texels.ndim:
        raise ValueError(f"{name} must be a number or an image; got {value}")
    if not (np.isfinite(texels).all() and (texels > 0).all() and (texels >= least).all()):
        raise ValueError(f"{name} must be positive and finite, {reason}; got {value}")


def blinn(roughness: Any) -> Blinn:
    """Blinn's distribution of exponent ``1/roughness``."""
    return Blinn(_exponent("roughness", roughness))


def _triple(name: str, value: Any) -> Rgb:
    out = np.broadcast_to(np.asarray(value, float).reshape(-1), 3)
    if not np.isfinite(out).all() or (out < 0).any():
        raise ValueError(f"{name} of a metal must be finite and not negative; got {value}")
    return float(out[0]), float(out[1]), float(out[2])


class ReciprocalImage(Image):
    """One over the interpolated texels: the exponent where the image is roughness."""

    def __call__(self, uv: Array) -> Array:
        return 1 / super().__call__(uv)


def _exponent(name: str, roughness: Any) -> Any:
    if isinstance(roughness, Image):
        return ReciprocalImage(roughness.texels, roughness.scale, roughness.offset, roughness.wrap)
    value = float(np.asarray(roughness).reshape(-1)[0])
    if not (value > 0 and np.isfinite(value)):
        raise ValueError(f"{name} must be positive, because the Blinn exponent is its reciprocal; got {roughness}")
    return 1 / value


def _conductor_of(name: str, reflectance: Any) -> Conductor:
    """The conductor with k = 0 whose normal reflectance is as given: ``eta = (1 + sqrt r) / (1 - sqrt r)``."""
    if isinstance(reflectance, Image):
        raise ValueError(f"{name} of shinymetal must be a constant; got an image texture, which is not supported")
    r = np.minimum(np.broadcast_to(np.asarray(reflectance, float), 3), 0.999)
    eta = (1 + np.sqrt(r)) / (1 - np.sqrt(r))
    return Conductor((float(eta[0]), float(eta[1]), float(eta[2])), (0.0, 0.0, 0.0))


def _black(name: str, value: Any) -> bool:
    """Whether a constant parameter is zero; negative or non-finite reflectances are refused."""
    texels = value.texels if isinstance(value, Image) else np.asarray(value, float)
    if not np.isfinite(texels).all() or (texels < 0).any():
        raise ValueError(f"{name} must be finite and not negative, because it is a reflectance; got {value}")
    return not isinstance(value, Image) and not texels.any()
