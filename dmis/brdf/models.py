"""Materials that are one reflection model of the literature: its glossy lobe over a diffuse base.

The modules of `dmis.brdf` define the models and name their sources. `kd`, the reflectance of a Lambert base, and `ks`,
that of the glossy lobe, are those of `dmis.brdf.materials`. Other parameters that several models share:

exponent
    Exponent of the cosine: positive, a number or an image.
alpha, alpha_v
    Roughness, the alpha of the distribution of facets: positive, a number or an image; with `alpha_v`, along the two
    tangents.
fresnel
    `dmis.brdf.fresnel.Dielectric`, `dmis.brdf.fresnel.Conductor`, or None, which reflects everything.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from dmis.base.color import Rgb
from dmis.base.validate import whole
from dmis.base.vectors import Array
from dmis.brdf.ashikhmin_shirley import AshikhminShirley, BlendBase
from dmis.brdf.coated_conductor import CoatedConductor, CoatedFresnel
from dmis.brdf.coated_diffuse import CoatedBase
from dmis.brdf.distributions import MIN_ALPHA, Anisotropic, Beckmann, Blinn, Elliptic, Isotropic, Roughness
from dmis.brdf.fresnel import Coat, Dielectric, Fresnel, check_ior, check_metal_index
from dmis.brdf.lobe import MAX_LOBE_EXPONENT, Lambert, Lobe
from dmis.brdf.materials import COPPER_ETA, COPPER_K, Material, assemble, is_black
from dmis.brdf.microfacet import GGX, Microfacet
from dmis.brdf.phong import BlinnPhong, Lafortune
from dmis.brdf.rough_glass import RoughReflection, RoughTransmission
from dmis.brdf.specular import SpecularReflection
from dmis.brdf.texture import FLOAT32_TINY, Image, check_number, check_values, reads_images
from dmis.brdf.ward import Ward


@reads_images
def phong(kd: Any = 0.0, ks: Any = 0.5, exponent: Any = 50.0) -> Material:
    """Make Phong's cosine lobe about the mirror direction, normalised; see `dmis.brdf.phong.Lafortune`."""
    return _over(kd, ks, Lafortune(ks, _power("exponent", exponent)), "phong")


@reads_images
def lafortune(kd: Any = 0.0, ks: Any = 0.5, exponent: Any = 50.0, c_t: float = -1.0, c_n: float = 0.9) -> Material:
    """Make Lafortune's cosine lobe about wo with its tangential part times `c_t`, its normal part times `c_n`.

    ``c_t = -1`` with ``c_n < 1`` is off-specular, ``c_t > 0`` sends light back to where it came from. Put several
    lobes in one `Material` to fit a measured surface. `c_t` is in [-1, 1], `c_n` in (0, 1].
    """
    reason = "the lobe's peak grows with its power"
    c_t = check_number("c_t", c_t, "in [-1, 1]", reason, -1, 1)
    c_n = check_number("c_n", c_n, "in (0, 1]", reason, FLOAT32_TINY, 1)
    return _over(kd, ks, Lafortune(ks, _power("exponent", exponent), c_t, c_n), "lafortune")


@reads_images
def blinn_phong(kd: Any = 0.0, ks: Any = 0.5, exponent: Any = 50.0) -> Material:
    """Make a cosine lobe of the half vector without masking, normalised; see `dmis.brdf.phong.BlinnPhong`."""
    return _over(kd, ks, BlinnPhong(ks, Blinn(_power("exponent", exponent))), "blinnphong")


@reads_images
def ward(kd: Any = 0.0, ks: Any = 0.5, alpha: Any = 0.15, alpha_v: Any = None) -> Material:
    """Make Ward's Gaussian lobe with bounded albedo; `alpha_v` makes it anisotropic; see `dmis.brdf.ward.Ward`."""
    return _over(kd, ks, Ward(ks, Beckmann(facet_roughness(alpha, alpha_v))), "ward")


@reads_images
def ashikhmin_shirley(kd: Any = 0.5, ks: Any = 0.05, n_u: Any = 100.0, n_v: Any = None) -> Material:
    """Make Ashikhmin and Shirley's model as in their paper: diffuse base, and a coat of normal reflectance `ks`.

    `n_u` and `n_v` are the exponents along the two tangents: positive, numbers or an `Image`; the same if `n_v` is
    None. `substrate` is pbrt's variant, whose coat has a slightly larger factor.
    """
    is_black("kd", kd), is_black("ks", ks)
    u = _power("n_u", n_u)
    distribution = Blinn(u) if n_v is None else Anisotropic(u, _power("n_v", n_v))
    return Material((BlendBase(kd, ks), AshikhminShirley(ks, distribution)), "ashikhminshirley")


@reads_images
def torrance_sparrow(kd: Any = 0.0, ks: Any = 1.0, exponent: Any = 50.0, fresnel: Fresnel | None = None) -> Material:
    """Make V-shaped facets with Blinn's distribution; see `dmis.brdf.microfacet.Microfacet`."""
    return _over(kd, ks, Microfacet(ks, Blinn(_power("exponent", exponent)), fresnel), "torrancesparrow")


@reads_images
def cook_torrance(
    kd: Any = 0.0, ks: Any = 1.0, alpha: Any = 0.15, alpha_v: Any = None, fresnel: Fresnel | None = None
) -> Material:
    """Make V-shaped facets with Beckmann's distribution; its factor is 1/4, as the paper's 1/pi gains energy."""
    return _over(kd, ks, Microfacet(ks, Beckmann(facet_roughness(alpha, alpha_v)), fresnel), "cooktorrance")


@reads_images
def ggx(
    kd: Any = 0.0, ks: Any = 1.0, alpha: Any = 0.15, alpha_v: Any = None, fresnel: Fresnel | None = None
) -> Material:
    """Make facets with the distribution of Trowbridge and Reitz and Smith's masking; see `dmis.brdf.microfacet.GGX`."""
    return _over(kd, ks, GGX(ks, facet_roughness(alpha, alpha_v), fresnel), "ggx")


@reads_images
def rough_glass(kr: Any = 1.0, kt: Any = 1.0, alpha: Any = 0.15, alpha_v: Any = None, eta: float = 1.5) -> Material:
    """Make glass with facets of the distribution of Trowbridge and Reitz; see `dmis.brdf.rough_glass`.

    What comes through it is light that falls upon its far side: behind glass that has two surfaces, that takes path
    tracing. `dmis.brdf.materials.glass` is smooth, and has the same `kr`, `kt` and `eta`, but that this is not 1.
    """
    eta = check_ior("eta", eta)
    if eta == 1:
        raise ValueError("eta must not be 1, because facets would not refract; got 1")
    facets = facet_roughness(alpha, alpha_v)
    reflection = RoughReflection(kr, facets, Dielectric(eta))
    transmission = RoughTransmission(kt, facets, eta)
    return assemble("glass", ("kr", kr, reflection), ("kt", kt, transmission))


@reads_images
def coated_diffuse(
    kd: Any = 0.5, alpha: float = 0.0, eta: float = 1.5, thickness: float = 0.0, bounces: int | None = None
) -> Material:
    """Make a Lambertian base under a dielectric coat, with all reflections in between; see `dmis.brdf.coated_diffuse`.

    Parameters
    ----------
    kd
        Reflectance of the base: a number, an RGB triple or an `Image`, from 0 to 1; black leaves the lobe out.
    alpha
        Roughness of the coat, a number up to 10; 0 is smooth, and then its outer side is a mirror.
    eta
        Index of refraction of the coat, inside over outside, 1 to 100; 1 reflects nothing.
    thickness
        Optical thickness of the coat, which absorbs, up to 1000; 0 is clear.
    bounces
        How many reflections by the base count; None: all.
    """
    alpha, eta, thickness = _check_layers(alpha=(alpha, 0, 10), eta=(eta, 1, 100), thickness=(thickness, 0, 1000))
    bounces = None if bounces is None else whole("bounces", bounces, 1)
    check_values("kd", kd, "in [0, 1]", "it is reflected again and again", 0, 1)
    base = CoatedBase(kd, eta, alpha if eta > 1 else 0.0, thickness, bounces)
    lobes: tuple[Lobe, ...] = () if is_black("kd", kd) else (base,)
    return Material((*lobes, *_coat(alpha, eta)), "coateddiffuse")


def coated_conductor(
    eta: Rgb = COPPER_ETA,
    k: Rgb = COPPER_K,
    alpha: float = 0.0,
    coat_alpha: float = 0.0,
    coat_eta: float = 1.5,
    thickness: float = 0.0,
    bounces: int = 100,
) -> Material:
    """Make a metal under a dielectric coat, with all reflections in between; see `dmis.brdf.coated_conductor`.

    Parameters
    ----------
    eta, k
        The metal's index of refraction and absorption: numbers or RGB triples; copper by default.
    alpha
        Roughness of the metal, a number up to 1; 0 is smooth.
    coat_alpha, coat_eta, thickness
        The coat: its roughness up to 1, its index of refraction from 1 to 4, and `thickness` of `coated_diffuse`.
    bounces
        How many reflections by the metal count.
    """
    bounces = whole("bounces", bounces, 1)
    alpha, coat_alpha, coat_eta, thickness = _check_layers(
        alpha=(alpha, 0, 1),
        coat_alpha=(coat_alpha, 0, 1),
        coat_eta=(coat_eta, 1, 4),  # of 10, alpha 1 reflects 1e23 times the light
        thickness=(thickness, 0, 1000),
    )
    check_values("eta", eta, "positive and finite", "it is part of a metal's index", FLOAT32_TINY, image=False)
    index, absorption = (np.array(check_metal_index(*item)) / coat_eta for item in (("eta", eta), ("k", k)))
    metal = tuple(index.tolist()), tuple(absorption.tolist())
    if alpha == coat_alpha == 0:
        mirror = CoatedFresnel(coat_eta, metal, thickness, bounces)
        return Material((SpecularReflection(1.0, mirror),), "coatedconductor")
    base = CoatedConductor(metal, alpha, coat_eta, coat_alpha, thickness, bounces)
    return Material((base, *_coat(coat_alpha, coat_eta)), "coatedconductor")


def _check_layers(**bounds: tuple[float, float, float]) -> list[float]:
    """Return the values of layers, which must be in their `bounds` (value, least, most)."""
    reason = "what crosses the coat is tabulated"
    return [
        check_number(name, value, f"from {least} to {most}", reason, least, most)
        for name, (value, least, most) in bounds.items()
    ]


def _coat(alpha: float, eta: float) -> tuple[Lobe, ...]:
    """Return the lobe of a coat's outer side; none at index 1."""
    if eta == 1:
        return ()
    return (GGX(1.0, facet_roughness(alpha), Dielectric(eta)) if alpha else SpecularReflection(1.0, Coat(eta)),)


def _over(kd: Any, ks: Any, lobe: Lobe, name: str) -> Material:
    """Return a glossy lobe of reflectance `ks` and a Lambert lobe, without black ones; check the Fresnel term."""
    fresnel = getattr(lobe, "fresnel", None)
    if not isinstance(fresnel, Fresnel | None):
        raise ValueError(f"fresnel must be a Dielectric or Conductor, because it takes cosines, or None; got {fresnel}")
    if fresnel is not None:
        fresnel.check()
    material = assemble(name, ("kd", kd, Lambert(kd)), ("ks", ks, lobe))
    head_on = 1.0 if fresnel is None else np.ravel(fresnel(np.ones(1, np.float32)))
    reflected = _largest(kd) + _largest(ks) * head_on
    if len(material.lobes) > 1 and reflected.max() > 1 + 1e-6:
        text = (
            f"{name} reflects up to {reflected.max():.3g} of the light, kd = {_largest(kd).max():g} beside ks = "
            f"{_largest(ks).max():g}, and no surface reflects more than it gets; lower one of them"
        )
        warnings.warn(text, stacklevel=4)
    return material


def _largest(value: Any) -> Array:
    """Return the largest reflectance of each channel, ``(1,)`` or ``(3,)``."""
    return value.texels.max(axis=(0, 1)) if isinstance(value, Image) else np.atleast_1d(value)


def _power(name: str, exponent: Any) -> Any:
    rule = f"positive and finite, at most {MAX_LOBE_EXPONENT:g}"
    reason = "the lobe is a cosine to this power"
    return check_number(name, exponent, rule, reason, FLOAT32_TINY, MAX_LOBE_EXPONENT, image=True)


def facet_roughness(alpha: Any, alpha_v: Any = None) -> Roughness:
    """Return the roughness alpha along both tangents; equal in all directions if `alpha_v` is None."""
    u = _alpha("alpha", alpha)
    return Isotropic(u) if alpha_v is None else Elliptic(u, _alpha("alpha_v", alpha_v))


def _alpha(name: str, alpha: Any) -> Any:
    rule = f"positive and finite, at least {MIN_ALPHA:g}"
    return check_number(name, alpha, rule, "float32 directions resolve no less", MIN_ALPHA, image=True)
