"""Materials of pbrt files: which table of a dialect makes them, their bump maps, mixtures of two, and those of pbrt-v2.

v3 has some of the materials of v2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.brdf import materials
from dmis.brdf.materials import Material
from dmis.brdf.texture import Image, scale
from dmis.formats.pbrt.parameters import ParameterSet
from dmis.formats.pbrt.tokens import Token, blame

if TYPE_CHECKING:
    from dmis.brdf.relief import Relief


def materials_of(dialect: str) -> Mapping[str, Callable[[ParameterSet], Material] | None]:
    """Return the functions that make materials of a dialect, by name; the modules of others are not imported."""
    if dialect == "v2":
        return V2_MATERIALS
    if dialect == "v3":
        from dmis.formats.pbrt.materials_v3 import V3_MATERIALS

        return {name: V2_MATERIALS[name] for name in ("matte", "mirror")} | V3_MATERIALS
    from dmis.formats.pbrt.materials_v4 import V4_MATERIALS

    return V4_MATERIALS


def make_material(name: Token, p: ParameterSet, named: Mapping[str, Material]) -> Material:
    """Return the material `name` made from parameters; `named` are the materials that a mix may name."""
    p = replace(p, directive=name)
    make = materials_of(name.dialect)[name.name]
    with blame(name), materials.unbounded():
        return _mix(p, named) if make is None else replace(make(p), relief=_relief(p))


def _relief(p: ParameterSet) -> Relief | None:
    """Return the bump map of a material, called displacement in v4, or its normal map."""
    heights = p.real("displacement" if p.dialect == "v4" else "bumpmap", 0.0)
    has_normals = p.dialect == "v4" and "normalmap" in p.items
    if not has_normals and not isinstance(heights, Image):
        return None
    from dmis.brdf.relief import BumpMap, NormalMap
    from dmis.formats.pbrt.textures import image

    if has_normals:
        p.refuse("a material must have a displacement or a normalmap, not both", "displacement")
        return NormalMap(Image(image(p, "normalmap", encoded=False)[::-1]), towards_dpdv=False)
    return BumpMap(heights, p.dialect != "v4")


def _mix(p: ParameterSet, named: Mapping[str, Material]) -> Material:
    """Return the sum of two materials: pbrt-v4 picks one of them at random, with the same mean."""
    from dmis.formats.pbrt.textures import blend

    amount: Any
    if p.dialect == "v3":  # the amount is the share of the first
        items = [p.required(f"namedmaterial{k}", "string") for k in (1, 2)]
        names, amount = [item.single()[0] for item in items], p.colour("amount", 0.5)
        shares = amount, blend(1.0, 0.0, amount)
    else:  # of the second
        items = [p.required("materials", "string")] * 2
        names, amount = list(items[0].single(2)), p.real("amount", 0.5)
        shares = blend(1.0, 0.0, amount), amount
    values = np.asarray(amount.texels if isinstance(amount, Image) else amount)
    if values.min() < 0 or values.max() > 1:
        raise p.items["amount"].error("must be from 0 to 1, because it divides the surface")
    lobes: list[Any] = []
    for item, name, share in zip(items, names, shares, strict=True):
        material = item.token.find("material", name, named)
        if material.relief is not None:
            raise item.token.error(f"a material with a bump map or normal map cannot be mixed; got {name!r}")
        for lobe in material.lobes:
            if lobe.factor is None:
                raise p.directive.error(f"a material of the kind {material.name} cannot be mixed")
            part = scale(getattr(lobe, lobe.factor), share)
            if isinstance(part, Image) or np.any(part):
                lobes.append(replace(lobe, **{lobe.factor: part}))
    return Material(tuple(lobes), "mix")


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
