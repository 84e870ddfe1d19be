"""Materials of pbrt files: a table of functions by dialect; those of v2 and v4 are in modules of their own.

All rough materials of pbrt-v3 and v4 are microfacets with the distribution of Trowbridge and Reitz (GGX).
Source: materials/ and core/microfacet.h of pbrt-v3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.brdf import materials, models
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.diffuse import Lambert, LambertTransmission
from dmis.brdf.distributions import TrowbridgeReitz
from dmis.brdf.fresnel import Dielectric
from dmis.brdf.lobe import Lobe
from dmis.brdf.materials import Material
from dmis.brdf.microfacet import GGX
from dmis.brdf.relief import BumpMap, NormalMap, Relief
from dmis.brdf.rough_glass import RoughReflection
from dmis.brdf.specular import SpecularTransmission
from dmis.brdf.texture import Image, scale
from dmis.formats.pbrt.materials_v4 import V4_MATERIALS, alpha_of, alphas_of, refractive, rough_metal, roughnesses
from dmis.formats.pbrt.parameters import Parameters
from dmis.formats.pbrt.textures import blend, image
from dmis.formats.pbrt.tokens import Token, blame

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


def _unscaled(material: Material) -> Material:
    """Return the material without the 1/eta^2 of refracted radiance, which pbrt-v2 leaves out."""
    lobes: list[Any] = list(material.lobes)
    lobes = [replace(x, scaled=False) if isinstance(x, SpecularTransmission) else x for x in lobes]
    return replace(material, lobes=tuple(lobes))


V2_MATERIALS: dict[str, Callable[[Parameters], Material]] = {
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


def make_material(name: Token, p: Parameters, named: Mapping[str, Material]) -> Material:
    """Return the material `name` made from parameters; `named` are the materials that a mix may name."""
    p = replace(p, directive=name)
    make = MATERIALS[name.dialect][name.name]
    with blame(name), materials.unbounded():
        return _mix(p, named) if make is None else replace(make(p), relief=_relief(p))


def _relief(p: Parameters) -> Relief | None:
    """Return the bump map of a material, called displacement in v4, or its normal map."""
    heights = p.real("displacement" if p.dialect == "v4" else "bumpmap", 0.0)
    if p.dialect == "v4" and "normalmap" in p.items:
        p.refuse("a material must have a displacement or a normalmap, not both", "displacement")
        return NormalMap(Image(image(p, "normalmap", encoded=False)[::-1]), towards_dpdv=False)
    return BumpMap(heights, p.dialect != "v4") if isinstance(heights, Image) else None


def _plastic(p: Parameters) -> Material:
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


def _substrate(p: Parameters) -> Material:
    kd, ks = p.reflectance("Kd", 0.5), p.reflectance("Ks", 0.5)
    alphas = alphas_of(p, (p.real("uroughness", 0.1), p.real("vroughness", 0.1)))
    if not any(np.any(value.texels if isinstance(value, Image) else value) for value in (kd, ks)):
        return Material((), "substrate")
    facets = TrowbridgeReitz(models.facet_roughness(*alphas))
    return Material((BlendBase(kd, ks), BlendCoat(ks, facets)), "substrate")


def _uber(p: Parameters) -> Material:
    ks, opacity = p.reflectance("Ks", 0.25), p.reflectance("opacity", 1, 1)
    index, (alpha, alpha_v) = p.index("eta", p.index()), alphas_of(p, roughnesses(p, 0.1))
    kd, kr, kt = p.reflectance("Kd", 0.25), p.reflectance("Kr", 0), p.reflectance("Kt", 0)
    others = materials.uber(kd, 0, kr, kt, eta=index, opacity=opacity)
    rough = models.ggx(0, scale(opacity, ks), alpha, alpha_v, Dielectric(index))
    return replace(others, lobes=others.lobes + _by_side(rough))


def _translucent(p: Parameters) -> Material:
    reflected, through = p.reflectance("reflect", 0.5), p.reflectance("transmit", 0.5)
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    alpha = alpha_of(p.real("roughness", 0.1), p.boolean("remaproughness", True), True)
    diffuse = Lambert(scale(reflected, kd)), LambertTransmission(scale(through, kd))
    glossy = models.rough_glass(scale(reflected, ks), scale(through, ks), alpha)
    return Material((*diffuse, *glossy.lobes), "translucent")


def _mix(p: Parameters, named: Mapping[str, Material]) -> Material:
    """Return the sum of two materials: pbrt-v4 picks one of them at random, with the same mean."""
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


MATERIALS: Mapping[str, Mapping[str, Callable[[Parameters], Material] | None]] = {
    "v2": V2_MATERIALS,
    "v3": {
        "matte": V2_MATERIALS["matte"],
        "mirror": V2_MATERIALS["mirror"],
        "glass": lambda p: refractive(p, p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index("eta", p.index())),
        "plastic": _plastic,
        "uber": _uber,
        "metal": lambda p: rough_metal(
            p, p.constant("eta", materials.COPPER_ETA), p.constant("k", materials.COPPER_K), 0.01, "metal"
        ),
        "substrate": _substrate,
        "translucent": _translucent,
        "mix": None,
    },
    "v4": V4_MATERIALS | {"mix": None},
}
"""Functions that make materials, by the names of the dialect and the material; None for a mix of two others."""
