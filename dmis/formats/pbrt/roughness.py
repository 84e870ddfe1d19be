"""Roughness of pbrt-v3 and v4, numbers or images, as the alpha of Trowbridge and Reitz, and what is made of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dmis.brdf import materials, models
from dmis.brdf.fresnel import ExactConductor
from dmis.brdf.materials import Material
from dmis.brdf.texture import Image
from dmis.formats.pbrt.parameter import rgb
from dmis.formats.pbrt.parameters import Parameters


def _polynomial(roughness: Any) -> Any:
    """Return pbrt-v3's alpha of a roughness in about [0, 1] (core/microfacet.h, RoughnessToAlpha)."""
    return np.polyval([0.000640711, 0.0171201, 0.1734, 0.819955, 1.62142], np.log(np.maximum(roughness, 1e-3)))


MIN_ROUGH_ALPHA = 1e-3
"""Smallest alpha of a rough material: pbrt-v3 raises smaller ones to it, v4 makes them smooth."""


def roughnesses(p: Parameters, default: float) -> tuple[Any, Any]:
    """Return the roughness along both tangents, numbers or images.

    The default along each is ``roughness``; but along v, with ``uber``, it is the roughness along u.
    """
    default_roughness = p.real("roughness", default)
    u = p.real("uroughness", default_roughness)
    return u, p.real("vroughness", u if p.directive.name == "uber" else default_roughness)


def alphas_of(p: Parameters, roughness: tuple[Any, Any]) -> tuple[Any, Any]:
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
    alpha = (_polynomial(roughness) if v3 else np.sqrt(roughness)) if remap else roughness
    alpha = np.maximum(alpha, MIN_ROUGH_ALPHA) if v3 else alpha
    if not isinstance(value, Image):
        return float(alpha)
    if np.min(alpha) < MIN_ROUGH_ALPHA:
        raise ValueError("an image of roughness must be rough everywhere; one smooth in places is not supported")
    return replace(value, texels=alpha.astype(np.float32))


def is_smooth(p: Parameters) -> bool:
    """Return whether a material that may be rough or smooth is smooth."""
    roughness = roughnesses(p, 0)
    values = alphas_of(p, roughness)
    if p.dialect == "v3":
        return all(not isinstance(value, Image) and value == 0 for value in roughness)
    below = [not isinstance(a, Image) and a < MIN_ROUGH_ALPHA for a in values if a is not None]
    if any(below) and not all(below):
        raise ValueError("a material must be rough along both tangents, or along none")
    return all(below)


def refractive(p: Parameters, kr: Any, kt: Any, index: float) -> Material:
    """Return glass, rough or smooth; with the index 1 it is smooth, and light passes straight through."""
    if is_smooth(p) or index == 1:
        return materials.glass(kr, kt, index)
    return models.rough_glass(kr, kt, *alphas_of(p, roughnesses(p, 0)), index)


def rough_metal(p: Parameters, eta: Any, k: Any, default_roughness: float, name: str) -> Material:
    alpha, alpha_v = alphas_of(p, roughnesses(p, default_roughness))
    return replace(models.ggx(0, 1, alpha, alpha_v, conductor_fresnel(eta, k)), name=name)


def conductor_fresnel(eta: Any, k: Any) -> ExactConductor:
    if np.min(eta) <= 0 or np.min(k) < 0:
        raise ValueError(f"a metal needs eta above 0 and k at least 0; got {rgb(eta)} and {rgb(k)}")
    return ExactConductor(rgb(eta), rgb(k))
