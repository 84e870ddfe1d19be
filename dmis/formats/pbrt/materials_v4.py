"""Materials of pbrt-v4, but for mixtures.

Sources: pbrt/materials.h, bxdfs.h and util/scattering.h of pbrt-v4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dmis.brdf import materials, models
from dmis.brdf.diffuse import Lambert, LambertTransmission
from dmis.brdf.materials import Material, assemble
from dmis.brdf.specular import SpecularReflection
from dmis.brdf.texture import scale
from dmis.formats.pbrt.parameters import Parameters
from dmis.formats.pbrt.roughness import (
    MIN_ROUGH_ALPHA,
    alphas_of,
    conductor_fresnel,
    is_smooth,
    refractive,
    rough_metal,
)
from dmis.formats.pbrt.spectra import SPECTRA


def _conductor(p: Parameters) -> Material:
    if "reflectance" in p.items:
        p.refuse("parameter 'reflectance' must not stand beside eta and k, which give the same", "eta", "k")
        r = np.clip(p.constant("reflectance", (0.5, 0.5, 0.5)), 0, 0.9999)
        eta, k = np.ones(3), 2 * np.sqrt(r) / np.sqrt(1 - r)
    else:
        named = SPECTRA["v4"].named()
        eta = np.asarray(p.constant("eta", named["metal-Cu-eta"]))
        k = np.asarray(p.constant("k", named["metal-Cu-k"]))
    if is_smooth(p):
        return Material((SpecularReflection(1.0, conductor_fresnel(eta, k)),), "conductor")
    return rough_metal(p, eta, k, 0, "conductor")


def _coated(p: Parameters) -> Material:
    if any(p.constant("albedo", (0.0, 0.0, 0.0))):
        raise p.items["albedo"].error("must be black, because light that is scattered inside of a coat has no formula")
    p.constant("g", 0), p.integer("nsamples", 1)  # of that medium; of random walks, whose mean is computed here
    depth, thickness = p.integer("maxdepth", 10), max(p.constant("thickness", 0.01), 0)
    if depth < 1:
        rule = "must be at least 1, because the base is the first that light meets"
        raise p.items["maxdepth"].error(f"{rule}; got {depth}")
    default_roughness = p.constant("roughness", 0)
    u, v = (p.constant(name, default_roughness) for name in ("uroughness", "vroughness"))
    if u != v:
        raise p.directive.error("roughness must be the same along both tangents of a coat, which is tabulated")
    alpha, _ = alphas_of(p, (u, v))
    return models.coated_diffuse(
        p.albedo("reflectance", 0.5),
        alpha if alpha >= MIN_ROUGH_ALPHA else 0,
        p.index("eta", 1.5),
        thickness,
        (depth + 1) // 2,  # every other interface is the base
    )


def _diffuse_transmission(p: Parameters) -> Material:
    factor = p.number("scale", 1)
    kd, kt = (scale(p.albedo(name, 0.25), factor) for name in ("reflectance", "transmittance"))
    return assemble("diffusetransmission", ("kd", kd, Lambert(kd)), ("kt", kt, LambertTransmission(kt)))


V4_MATERIALS: dict[str, Callable[[Parameters], Material]] = {
    "diffuse": lambda p: replace(materials.matte(p.albedo("reflectance", 0.5)), name="diffuse"),
    "conductor": _conductor,
    "dielectric": lambda p: replace(refractive(p, 1, 1, p.index("eta", 1.5)), name="dielectric"),
    "coateddiffuse": _coated,
    "diffusetransmission": _diffuse_transmission,
}
"""Functions that make materials, by name."""
