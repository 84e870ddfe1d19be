"""Materials of pbrt-v2, and those of v3 that are the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.brdf import materials
from dmis.brdf.materials import Material
from dmis.brdf.texture import Image
from dmis.formats.pbrt.parameters import ParameterSet

MAX_EXPONENT = 10_000
"""Largest exponent of Blinn's distribution in pbrt-v2."""


def _roughness(p: ParameterSet, default: float, name: str = "roughness") -> float | Image:
    """Return the roughness `name`, raised so that its reciprocal, the exponent, is at most `MAX_EXPONENT`."""
    value, least = p.real(name, default), 1 / MAX_EXPONENT
    if np.min(value.texels if isinstance(value, Image) else value) < 0:
        raise p.items[name].error("must not be negative, because its reciprocal is an exponent")
    if isinstance(value, Image):
        return replace(value, texels=np.maximum(value.texels, np.float32(least)))
    return max(value, least)


def _unscaled(material: Material) -> Material:
    """Return the material without the 1/eta^2 of refracted radiance, which pbrt-v2 leaves out."""
    from dmis.brdf.specular import SpecularTransmission

    lobes: list[Any] = list(material.lobes)
    lobes = [replace(x, scaled=False) if isinstance(x, SpecularTransmission) else x for x in lobes]
    return replace(material, lobes=tuple(lobes))


V2_MATERIALS: dict[str, Callable[[ParameterSet], Material]] = {
    "matte": lambda p: materials.matte(p.reflectance("Kd", 0.5), float(np.clip(p.constant("sigma", 0), 0, 90))),
    "plastic": lambda p: materials.plastic(
        p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25), _roughness(p, 0.1), eta=1 / 1.5
    ),
    "metal": lambda p: materials.metal(
        p.constant("eta", materials.COPPER_ETA), p.constant("k", materials.COPPER_K), _roughness(p, 0.01)
    ),
    "shinymetal": lambda p: materials.shiny_metal(
        p.reflectance("Ks", 1, 1), p.reflectance("Kr", 1, 1), _roughness(p, 0.1)
    ),
    "substrate": lambda p: materials.substrate(
        p.reflectance("Kd", 0.5),
        p.reflectance("Ks", 0.5),
        _roughness(p, 0.1, "uroughness"),
        _roughness(p, 0.1, "vroughness"),
    ),
    "uber": lambda p: _unscaled(
        materials.uber(
            p.reflectance("Kd", 0.25),
            p.reflectance("Ks", 0.25),
            p.reflectance("Kr", 0),
            p.reflectance("Kt", 0),
            _roughness(p, 0.1),
            1 / p.index(),
            p.reflectance("opacity", 1, 1),
        )
    ),
    "mirror": lambda p: materials.mirror(p.reflectance("Kr", 0.9)),
    "glass": lambda p: _unscaled(materials.glass(p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index())),
}
"""Functions that make materials, by name. pbrt-v2 swaps the two media of plastic and uber."""
