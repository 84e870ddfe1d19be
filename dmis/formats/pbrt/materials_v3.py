"""Materials of pbrt-v3, and the roughness of v3 and v4: numbers or images, as the alpha of Trowbridge and Reitz (GGX).

Source: materials/ and core/microfacet.h of pbrt-v3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.brdf import materials, models
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.distributions import TrowbridgeReitz
from dmis.brdf.fresnel import Dielectric, ExactConductor
from dmis.brdf.lobe import Lambert, LambertTransmission, Lobe
from dmis.brdf.materials import Material
from dmis.brdf.microfacet import GGX
from dmis.brdf.rough_glass import RoughReflection
from dmis.brdf.texture import Image, scale
from dmis.formats.pbrt.parameters import ParameterSet, rgb

_V3_ALPHA = 0.000640711, 0.0171201, 0.1734, 0.819955, 1.62142
"""pbrt-v3's alpha as a polynomial of the logarithm of roughness (core/microfacet.h, RoughnessToAlpha)."""
MIN_ROUGH_ALPHA = 1e-3
"""Smallest alpha of a rough material: pbrt-v3 raises smaller ones to it, v4 makes them smooth."""


def roughnesses(p: ParameterSet, default: float) -> tuple[Any, Any]:
    """Return the roughness along both tangents, numbers or images.

    The default along each is ``roughness``; but along v, with ``uber``, it is the roughness along u.
    """
    default_roughness = p.real("roughness", default)
    u = p.real("uroughness", default_roughness)
    return u, p.real("vroughness", u if p.directive.name == "uber" else default_roughness)


def alphas_of(p: ParameterSet, roughness: tuple[Any, Any]) -> tuple[Any, Any]:
    """Return the alpha along both tangents, numbers or images; the second is None if it is the same."""
    u, v = roughness
    remap, v3 = p.boolean("remaproughness", True), p.dialect == "v3"
    same = u is v or (not isinstance(u, Image) and not isinstance(v, Image) and u == v)
    return alpha_of(u, remap, v3), None if same else alpha_of(v, remap, v3)


def alpha_of(value: Any, remap: bool, v3: bool) -> Any:
    """Return the alpha of a roughness, a number or an image, in v3 or v4; without `remap` roughness is alpha.

    Texels are remapped one by one, and lookups interpolate alpha, where pbrt remaps the interpolated roughness.
    """
    roughness = value.texels if isinstance(value, Image) else np.asarray(value, float)
    if np.min(roughness) < 0:
        raise ValueError("the roughness of a material must not be negative, because it is a spread of slopes")
    remapped = np.polyval(_V3_ALPHA, np.log(np.maximum(roughness, 1e-3))) if v3 else np.sqrt(roughness)
    alpha = np.maximum(remapped if remap else roughness, MIN_ROUGH_ALPHA if v3 else 0)
    if not isinstance(value, Image):
        return float(alpha)
    if np.min(alpha) < MIN_ROUGH_ALPHA:
        raise ValueError("an image of roughness must be rough everywhere; one smooth in places is not supported")
    return replace(value, texels=alpha.astype(np.float32))


def is_smooth(p: ParameterSet) -> bool:
    """Return whether a material that may be rough or smooth is smooth."""
    roughness = roughnesses(p, 0)
    values = alphas_of(p, roughness)
    if p.dialect == "v3":
        return all(not isinstance(value, Image) and value == 0 for value in roughness)
    below = [not isinstance(a, Image) and a < MIN_ROUGH_ALPHA for a in values if a is not None]
    if any(below) and not all(below):
        raise ValueError("a material must be rough along both tangents, or along none")
    return all(below)


def refractive(p: ParameterSet, kr: Any, kt: Any, index: float) -> Material:
    """Return glass, rough or smooth; with the index 1 it is smooth, and light passes straight through."""
    if is_smooth(p) or index == 1:
        return materials.glass(kr, kt, index)
    return models.rough_glass(kr, kt, *alphas_of(p, roughnesses(p, 0)), index)


def rough_metal(p: ParameterSet, eta: Any, k: Any, default_roughness: float, name: str) -> Material:
    """Return a metal of index `eta` and absorption `k` with the roughness of the parameters."""
    alpha, alpha_v = alphas_of(p, roughnesses(p, default_roughness))
    return replace(models.ggx(0, 1, alpha, alpha_v, metal_fresnel(eta, k)), name=name)


def metal_fresnel(eta: Any, k: Any) -> ExactConductor:
    """Return the Fresnel reflectance of a metal of index `eta` and absorption `k`."""
    if np.min(eta) <= 0 or np.min(k) < 0:
        raise ValueError(f"a metal needs eta above 0 and k at least 0; got {rgb(eta)} and {rgb(k)}")
    return ExactConductor(rgb(eta), rgb(k))


def _plastic(p: ParameterSet) -> Material:
    """Return a diffuse lobe under glossy microfacets."""
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    remap, roughness = p.boolean("remaproughness", True), p.real("roughness", 0.1)
    # pbrt-v3 swaps the two media, like v2 (materials/plastic.cpp)
    material = models.ggx(kd, ks, alpha_of(roughness, remap, True), fresnel=Dielectric(1 / 1.5))
    return replace(material, lobes=_by_side(material), name="plastic")


def _by_side(material: Material) -> tuple[Lobe, ...]:
    """Return the lobes of a material with the Fresnel reflectance of wo's side of the shading normal.

    Since 2019 (commit 478b2e6, core/reflection.cpp) pbrt-v3 evaluates Fresnel's reflectance at the cosine between wi
    and the half vector turned to the shading normal, which is negative beyond it and exchanges the two media. v2 has
    the reflectance of one side on both.
    """
    return tuple(
        RoughReflection(lobe.reflectance, lobe.roughness, lobe.fresnel)
        if isinstance(lobe, GGX) and isinstance(lobe.fresnel, Dielectric)
        else lobe
        for lobe in material.lobes
    )


def _substrate(p: ParameterSet) -> Material:
    """Return Ashikhmin and Shirley's diffuse base under a glossy coat."""
    kd, ks = p.reflectance("Kd", 0.5), p.reflectance("Ks", 0.5)
    alphas = alphas_of(p, (p.real("uroughness", 0.1), p.real("vroughness", 0.1)))
    if not any(np.any(value.texels if isinstance(value, Image) else value) for value in (kd, ks)):
        return Material((), "substrate")
    facets = TrowbridgeReitz(models.facet_roughness(*alphas))
    return Material((BlendBase(kd, ks), BlendCoat(ks, facets)), "substrate")


def _uber(p: ParameterSet) -> Material:
    """Return diffuse, glossy, mirrored and refracted light in one."""
    ks, opacity = p.reflectance("Ks", 0.25), p.reflectance("opacity", 1, 1)
    index, (alpha, alpha_v) = p.index("eta", p.index()), alphas_of(p, roughnesses(p, 0.1))
    kd, kr, kt = p.reflectance("Kd", 0.25), p.reflectance("Kr", 0), p.reflectance("Kt", 0)
    others = materials.uber(kd, 0, kr, kt, eta=index, opacity=opacity)
    rough = models.ggx(0, scale(opacity, ks), alpha, alpha_v, Dielectric(index))
    return replace(others, lobes=others.lobes + _by_side(rough))


def _translucent(p: ParameterSet) -> Material:
    """Return diffuse and glossy lobes of both sides."""
    reflected, through = p.reflectance("reflect", 0.5), p.reflectance("transmit", 0.5)
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    alpha = alpha_of(p.real("roughness", 0.1), p.boolean("remaproughness", True), True)
    diffuse = Lambert(scale(reflected, kd)), LambertTransmission(scale(through, kd))
    glossy = models.rough_glass(scale(reflected, ks), scale(through, ks), alpha)
    return Material((*diffuse, *glossy.lobes), "translucent")


V3_MATERIALS: dict[str, Callable[[ParameterSet], Material] | None] = {
    "glass": lambda p: refractive(p, p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index("eta", p.index())),
    "plastic": _plastic,
    "uber": _uber,
    "metal": lambda p: rough_metal(
        p, p.constant("eta", materials.COPPER_ETA), p.constant("k", materials.COPPER_K), 0.01, "metal"
    ),
    "substrate": _substrate,
    "translucent": _translucent,
    "mix": None,
}
"""Functions that make materials unlike those of v2, by name; None for a mix of two others."""
