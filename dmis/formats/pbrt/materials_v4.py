"""Materials of pbrt-v4.

Sources: pbrt/materials.h, bxdfs.h and util/scattering.h of pbrt-v4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.brdf import materials, models
from dmis.brdf.lobe import Lambert, LambertTransmission
from dmis.brdf.materials import Material, assemble
from dmis.brdf.specular import SpecularReflection
from dmis.brdf.texture import scale
from dmis.formats.pbrt.materials_v3 import MIN_ROUGH_ALPHA, alphas_of, is_smooth, metal_fresnel, refractive, rough_metal
from dmis.formats.pbrt.parameters import ParameterSet
from dmis.formats.pbrt.spectra import v4_names


def _metal(p: ParameterSet, prefix: str = "") -> tuple[Any, Any]:
    """Return the index and absorption of a metal from the parameters whose names begin with `prefix`."""
    eta, k = prefix + "eta", prefix + "k"
    if "reflectance" in p.items:
        p.refuse("parameter 'reflectance' must not stand beside eta and k, which give the same", eta, k)
        r = np.clip(p.constant("reflectance", (0.5, 0.5, 0.5)), 0, 0.9999)
        return np.ones(3), 2 * np.sqrt(r) / np.sqrt(1 - r)
    named = v4_names()
    return np.asarray(p.constant(eta, named["metal-Cu-eta"])), np.asarray(p.constant(k, named["metal-Cu-k"]))


def _conductor(p: ParameterSet) -> Material:
    eta, k = _metal(p)
    if is_smooth(p):
        return Material((SpecularReflection(1.0, metal_fresnel(eta, k)),), "conductor")
    return rough_metal(p, eta, k, 0, "conductor")


def _layers(p: ParameterSet) -> tuple[float, int]:
    """Return the optical thickness of a coat, and how many reflections by the base below it count."""
    if any(p.constant("albedo", (0.0, 0.0, 0.0))):
        raise p.items["albedo"].error("must be black, because light that is scattered inside of a coat has no formula")
    p.constant("g", 0), p.integer("nsamples", 1)  # of that medium; of random walks, whose mean is computed here
    depth = p.integer("maxdepth", 10)
    if depth < 1:
        rule = "must be at least 1, because the base is the first that light meets"
        raise p.items["maxdepth"].error(f"{rule}; got {depth}")
    return max(p.constant("thickness", 0.01), 0), (depth + 1) // 2  # every other interface is the base


def _layer_alpha(p: ParameterSet, prefix: str = "") -> float:
    """Return the alpha of a layer, 0 if it is smooth, from the parameters whose names begin with `prefix`."""
    default_roughness = p.constant(prefix + "roughness", 0)
    u, v = (p.constant(prefix + name, default_roughness) for name in ("uroughness", "vroughness"))
    if u != v:
        raise p.directive.error("roughness must be the same along both tangents of a coat, which is tabulated")
    alpha, _ = alphas_of(p, (u, v))
    return alpha if alpha >= MIN_ROUGH_ALPHA else 0


def _coated_diffuse(p: ParameterSet) -> Material:
    thickness, bounces = _layers(p)
    alpha, eta = _layer_alpha(p), p.index("eta", 1.5)
    return models.coated_diffuse(p.albedo("reflectance", 0.5), alpha, eta, thickness, bounces)


def _coated_conductor(p: ParameterSet) -> Material:
    alpha, coat_alpha = _layer_alpha(p, "conductor."), _layer_alpha(p, "interface.")
    eta, layers = p.index("interface.eta", 1.5), _layers(p)
    return models.coated_conductor(*_metal(p, "conductor."), alpha, coat_alpha, eta, *layers)


def _diffuse_transmission(p: ParameterSet) -> Material:
    factor = p.number("scale", 1)
    kd, kt = (scale(p.albedo(name, 0.25), factor) for name in ("reflectance", "transmittance"))
    return assemble("diffusetransmission", ("kd", kd, Lambert(kd)), ("kt", kt, LambertTransmission(kt)))


V4_MATERIALS: dict[str, Callable[[ParameterSet], Material] | None] = {
    "diffuse": lambda p: replace(materials.matte(p.albedo("reflectance", 0.5)), name="diffuse"),
    "conductor": _conductor,
    "dielectric": lambda p: replace(refractive(p, 1, 1, p.index("eta", 1.5)), name="dielectric"),
    "coateddiffuse": _coated_diffuse,
    "coatedconductor": _coated_conductor,
    "diffusetransmission": _diffuse_transmission,
    "mix": None,
}
"""Functions that make materials, by name; None for a mix of two others."""
