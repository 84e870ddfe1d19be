"""Materials of pbrt-v4, but for mixtures, and the roughness of v3 and v4: numbers or images, as Trowbridge's alpha.

Sources: pbrt/materials.h, bxdfs.h and util/scattering.h of pbrt-v4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.brdf import materials, models
from dmis.brdf.diffuse import Lambert, LambertTransmission
from dmis.brdf.fresnel import ExactConductor
from dmis.brdf.materials import Material, assemble
from dmis.brdf.specular import SpecularReflection
from dmis.brdf.texture import Image, scale
from dmis.formats.pbrt.parameters import Parameters, rgb
from dmis.formats.pbrt.spectra import SPECTRA

_V3_ALPHA = 0.000640711, 0.0171201, 0.1734, 0.819955, 1.62142
"""pbrt-v3's alpha as a polynomial of the logarithm of roughness (core/microfacet.h, RoughnessToAlpha)."""
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
    remapped = np.polyval(_V3_ALPHA, np.log(np.maximum(roughness, 1e-3))) if v3 else np.sqrt(roughness)
    alpha = np.maximum(remapped if remap else roughness, MIN_ROUGH_ALPHA if v3 else 0)
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


def _metal(p: Parameters, prefix: str = "") -> tuple[Any, Any]:
    """Return the index and absorption of a metal from the parameters whose names begin with `prefix`."""
    eta, k = prefix + "eta", prefix + "k"
    if "reflectance" in p.items:
        p.refuse("parameter 'reflectance' must not stand beside eta and k, which give the same", eta, k)
        r = np.clip(p.constant("reflectance", (0.5, 0.5, 0.5)), 0, 0.9999)
        return np.ones(3), 2 * np.sqrt(r) / np.sqrt(1 - r)
    named = SPECTRA["v4"].named()
    return np.asarray(p.constant(eta, named["metal-Cu-eta"])), np.asarray(p.constant(k, named["metal-Cu-k"]))


def _conductor(p: Parameters) -> Material:
    eta, k = _metal(p)
    if is_smooth(p):
        return Material((SpecularReflection(1.0, conductor_fresnel(eta, k)),), "conductor")
    return rough_metal(p, eta, k, 0, "conductor")


def _layers(p: Parameters) -> tuple[float, int]:
    """Return the optical thickness of a coat, and how many reflections by the base below it count."""
    if any(p.constant("albedo", (0.0, 0.0, 0.0))):
        raise p.items["albedo"].error("must be black, because light that is scattered inside of a coat has no formula")
    p.constant("g", 0), p.integer("nsamples", 1)  # of that medium; of random walks, whose mean is computed here
    depth = p.integer("maxdepth", 10)
    if depth < 1:
        rule = "must be at least 1, because the base is the first that light meets"
        raise p.items["maxdepth"].error(f"{rule}; got {depth}")
    return max(p.constant("thickness", 0.01), 0), (depth + 1) // 2  # every other interface is the base


def _layer_alpha(p: Parameters, prefix: str = "") -> float:
    """Return the alpha of a layer, 0 if it is smooth, from the parameters whose names begin with `prefix`."""
    default_roughness = p.constant(prefix + "roughness", 0)
    u, v = (p.constant(prefix + name, default_roughness) for name in ("uroughness", "vroughness"))
    if u != v:
        raise p.directive.error("roughness must be the same along both tangents of a coat, which is tabulated")
    alpha, _ = alphas_of(p, (u, v))
    return alpha if alpha >= MIN_ROUGH_ALPHA else 0


def _coated_diffuse(p: Parameters) -> Material:
    thickness, bounces = _layers(p)
    alpha, eta = _layer_alpha(p), p.index("eta", 1.5)
    return models.coated_diffuse(p.albedo("reflectance", 0.5), alpha, eta, thickness, bounces)


def _coated_conductor(p: Parameters) -> Material:
    alpha, coat_alpha = _layer_alpha(p, "conductor."), _layer_alpha(p, "interface.")
    eta, layers = p.index("interface.eta", 1.5), _layers(p)
    return models.coated_conductor(*_metal(p, "conductor."), alpha, coat_alpha, eta, *layers)


def _diffuse_transmission(p: Parameters) -> Material:
    factor = p.number("scale", 1)
    kd, kt = (scale(p.albedo(name, 0.25), factor) for name in ("reflectance", "transmittance"))
    return assemble("diffusetransmission", ("kd", kd, Lambert(kd)), ("kt", kt, LambertTransmission(kt)))


V4_MATERIALS: dict[str, Callable[[Parameters], Material]] = {
    "diffuse": lambda p: replace(materials.matte(p.albedo("reflectance", 0.5)), name="diffuse"),
    "conductor": _conductor,
    "dielectric": lambda p: replace(refractive(p, 1, 1, p.index("eta", 1.5)), name="dielectric"),
    "coateddiffuse": _coated_diffuse,
    "coatedconductor": _coated_conductor,
    "diffusetransmission": _diffuse_transmission,
}
"""Functions that make materials, by name."""
