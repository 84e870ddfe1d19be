"""Materials of pbrt-v2, with its defaults and deviations from the textbook, which `dmis.formats.pbrt.read` lists."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.brdf import materials
from dmis.brdf.materials import Material
from dmis.brdf.specular import SpecularTransmission
from dmis.brdf.texture import Image
from dmis.formats.pbrt.parameters import Parameters

MAX_EXPONENT = 10_000
"""Largest exponent of Blinn's distribution in pbrt-v2."""


def _roughness(p: Parameters, default: float, name: str = "roughness") -> float | Image:
    """Return the roughness `name`, raised so that its reciprocal, the exponent, is at most `MAX_EXPONENT`."""
    value, least = p.real(name, default), 1 / MAX_EXPONENT
    if np.min(value.texels if isinstance(value, Image) else value) < 0:
        raise p.items[name].error("must not be negative, because its reciprocal is an exponent")
    if isinstance(value, Image):
        return replace(value, texels=np.maximum(value.texels, np.float32(least)))
    return max(value, least)


def _matte(p: Parameters) -> Material:
    return materials.matte(p.reflectance("Kd", 0.5), float(np.clip(p.constant("sigma", 0), 0, 90)))


def _plastic(p: Parameters) -> Material:
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    return materials.plastic(kd, ks, _roughness(p, 0.1), eta=1 / 1.5)  # pbrt-v2 swaps the two media


def _metal(p: Parameters) -> Material:
    eta, k = p.constant_colour("eta", materials.COPPER_ETA), p.constant_colour("k", materials.COPPER_K)
    return materials.metal(eta, k, _roughness(p, 0.01))


def _shinymetal(p: Parameters) -> Material:
    return materials.shiny_metal(p.reflectance("Ks", 1, 1), p.reflectance("Kr", 1, 1), _roughness(p, 0.1))


def _substrate(p: Parameters) -> Material:
    u, v = (_roughness(p, 0.1, name) for name in ("uroughness", "vroughness"))
    return materials.substrate(p.reflectance("Kd", 0.5), p.reflectance("Ks", 0.5), u, v)


def _uber(p: Parameters) -> Material:
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    kr, kt = p.reflectance("Kr", 0), p.reflectance("Kt", 0)
    eta, opacity = 1 / p.index(), p.reflectance("opacity", 1, 1)  # pbrt-v2 swaps the two media
    return _unscaled(materials.uber(kd, ks, kr, kt, _roughness(p, 0.1), eta, opacity))


def _mirror(p: Parameters) -> Material:
    return materials.mirror(p.reflectance("Kr", 0.9))


def _glass(p: Parameters) -> Material:
    return _unscaled(materials.glass(p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index()))


def _unscaled(material: Material) -> Material:
    """Return the material without the 1/eta^2 of refracted radiance, which pbrt-v2 leaves out."""
    lobes: list[Any] = list(material.lobes)
    return replace(
        material,
        lobes=tuple(replace(x, scaled=False) if isinstance(x, SpecularTransmission) else x for x in lobes),
    )


V2_MATERIALS: dict[str, Callable[[Parameters], Material]] = {
    "matte": _matte,
    "plastic": _plastic,
    "metal": _metal,
    "shinymetal": _shinymetal,
    "substrate": _substrate,
    "uber": _uber,
    "mirror": _mirror,
    "glass": _glass,
}
"""Functions that make materials, by name."""
