"""Materials of pbrt files: a table of functions by dialect; those of v2 are in `dmis.formats.pbrt.materials_v2`.

All rough materials of pbrt-v3 and v4 are microfacets with the distribution of Trowbridge and Reitz (GGX).
Sources: materials/ and core/microfacet.h of pbrt-v3, pbrt/materials.h, bxdfs.h and util/scattering.h of pbrt-v4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.brdf import materials, models
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.distributions import TrowbridgeReitz
from dmis.brdf.fresnel import Dielectric, ExactConductor
from dmis.brdf.lobe import Lobe
from dmis.brdf.materials import Material
from dmis.brdf.microfacet import GGX
from dmis.brdf.rough_glass import RoughReflection
from dmis.brdf.specular import SpecularReflection
from dmis.brdf.texture import Image, scale
from dmis.formats.pbrt.materials_v2 import V2_MATERIALS
from dmis.formats.pbrt.parameter import Parameter, rgb
from dmis.formats.pbrt.parameters import Parameters, Textures
from dmis.formats.pbrt.spectra import SPECTRA
from dmis.formats.pbrt.tokens import Token, blame


def make_material(
    name: Token, lists: Sequence[Parameters], textures: Textures, named: Mapping[str, Material]
) -> Material:
    """Return the material `name`, with each parameter from the first of the `lists` that has it.

    In pbrt-v2 a texture in any list counts before a constant in any list. `named` are the materials that a mix may
    name. What is read is noted in all lists, reflectances outside of [0, 1] in the first one.
    """
    items: dict[str, Parameter] = {}
    for p in reversed(lists):
        p.refuse(
            "bump maps are not supported; remove the parameter, or bake it into the mesh",
            *("bumpmap", "displacement", "normalmap"),
        )
        items |= p.items
    if name.dialect == "v2":
        for p in reversed(lists):
            items |= {key: item for key, item in p.items.items() if item.kind == "texture"}
    joined = replace(lists[0], directive=name, items=items, textures=textures, read_names=set())
    make = MATERIALS[name.dialect][name.name]
    with blame(name), materials.unbounded():
        material = _mix(joined, named) if make is None else make(joined)
    for p in lists:
        p.read_names |= joined.read_names
    return material


def _polynomial(roughness: Any) -> Any:
    """Return pbrt-v3's alpha of a roughness in about [0, 1] (core/microfacet.h, RoughnessToAlpha)."""
    return np.polyval([0.000640711, 0.0171201, 0.1734, 0.819955, 1.62142], np.log(np.maximum(roughness, 1e-3)))


MIN_ROUGH_ALPHA = 1e-3
"""Smallest alpha of a rough material: pbrt-v3 raises smaller ones to it, v4 makes them smooth."""


def _roughness(p: Parameters, default: float) -> tuple[Any, Any]:
    """Return the roughness along both tangents, numbers or images.

    The default along each is ``roughness``; but along v, with ``uber``, it is the roughness along u.
    """
    default_roughness = p.real("roughness", default)
    u = p.real("uroughness", default_roughness)
    return u, p.real("vroughness", u if p.directive.name == "uber" else default_roughness)


def _alphas(p: Parameters, roughness: tuple[Any, Any]) -> tuple[Any, Any]:
    """Return the alpha along both tangents, numbers or images; the second is None if it is the same."""
    u, v = roughness
    remap, v3 = p.boolean("remaproughness", True), p.dialect == "v3"
    same = u is v or (not isinstance(u, Image) and not isinstance(v, Image) and u == v)
    return _alpha(u, remap, v3), None if same else _alpha(v, remap, v3)


def _alpha(value: Any, remap: bool, v3: bool) -> Any:
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


def _smooth(p: Parameters) -> bool:
    """Return whether a material that may be rough or smooth is smooth."""
    roughness = _roughness(p, 0)
    values = _alphas(p, roughness)
    if p.dialect == "v3":
        return all(not isinstance(value, Image) and value == 0 for value in roughness)
    below = [not isinstance(a, Image) and a < MIN_ROUGH_ALPHA for a in values if a is not None]
    if any(below) and not all(below):
        raise ValueError("a material must be rough along both tangents, or along none")
    return all(below)


def _plastic(p: Parameters) -> Material:
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    remap, roughness = p.boolean("remaproughness", True), p.real("roughness", 0.1)
    # pbrt-v3 swaps the two media, like v2 (materials/plastic.cpp)
    material = models.ggx(kd, ks, _alpha(roughness, remap, True), fresnel=Dielectric(1 / 1.5))
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
    alphas = _alphas(p, (p.real("uroughness", 0.1), p.real("vroughness", 0.1)))
    if not any(np.any(value.texels if isinstance(value, Image) else value) for value in (kd, ks)):
        return Material((), "substrate")
    facets = TrowbridgeReitz(models.facet_roughness(*alphas))
    return Material((BlendBase(kd, ks), BlendCoat(ks, facets)), "substrate")


def _uber(p: Parameters) -> Material:
    ks, opacity = p.reflectance("Ks", 0.25), p.reflectance("opacity", 1, 1)
    index, (alpha, alpha_v) = p.index("eta", p.index()), _alphas(p, _roughness(p, 0.1))
    kd, kr, kt = p.reflectance("Kd", 0.25), p.reflectance("Kr", 0), p.reflectance("Kt", 0)
    others = materials.uber(kd, 0, kr, kt, eta=index, opacity=opacity)
    rough = models.ggx(0, scale(opacity, ks), alpha, alpha_v, Dielectric(index))
    return replace(others, lobes=others.lobes + _by_side(rough))


def _refractive(p: Parameters, kr: Any, kt: Any, index: float) -> Material:
    """Return glass, rough or smooth; with the index 1 it is smooth, and light passes straight through."""
    if _smooth(p) or index == 1:
        return materials.glass(kr, kt, index)
    return models.rough_glass(kr, kt, *_alphas(p, _roughness(p, 0)), index)


def _conductor(p: Parameters) -> Material:
    if "reflectance" in p.items:
        p.refuse("parameter 'reflectance' must not stand beside eta and k, which give the same", "eta", "k")
        r = np.clip(p.constant("reflectance", (0.5, 0.5, 0.5)), 0, 0.9999)
        eta, k = np.ones(3), 2 * np.sqrt(r) / np.sqrt(1 - r)
    else:
        named = SPECTRA["v4"].named()
        eta = np.asarray(p.constant("eta", named["metal-Cu-eta"]))
        k = np.asarray(p.constant("k", named["metal-Cu-k"]))
    if _smooth(p):
        return Material((SpecularReflection(1.0, _fresnel(eta, k)),), "conductor")
    return _rough_metal(p, eta, k, 0, "conductor")


def _rough_metal(p: Parameters, eta: Any, k: Any, default_roughness: float, name: str) -> Material:
    alpha, alpha_v = _alphas(p, _roughness(p, default_roughness))
    return replace(models.ggx(0, 1, alpha, alpha_v, _fresnel(eta, k)), name=name)


def _fresnel(eta: Any, k: Any) -> ExactConductor:
    if np.min(eta) <= 0 or np.min(k) < 0:
        raise ValueError(f"a metal needs eta above 0 and k at least 0; got {rgb(eta)} and {rgb(k)}")
    return ExactConductor(rgb(eta), rgb(k))


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
    alpha, _ = _alphas(p, (u, v))
    return models.coated_diffuse(
        p.albedo("reflectance", 0.5),
        alpha if alpha >= MIN_ROUGH_ALPHA else 0,
        p.index("eta", 1.5),
        thickness,
        (depth + 1) // 2,  # every other interface is the base
    )


def _mix(p: Parameters, named: Mapping[str, Material]) -> Material:
    """Return the sum of two materials: pbrt-v4 picks one of them at random, with the same mean."""
    amount: Any
    if p.dialect == "v3":  # the share of the first
        items = [p.required(f"namedmaterial{k}", "string") for k in (1, 2)]
        names = [item.single()[0] for item in items]
        amount = np.asarray(p.constant("amount", (0.5, 0.5, 0.5)))
        shares = amount, 1 - amount
    else:  # of the second
        items = [p.required("materials", "string")] * 2
        names, amount = list(items[0].single(2)), p.constant("amount", 0.5)
        shares = np.float64(1 - amount), np.float64(amount)
    if np.min(shares[0]) < 0 or np.min(shares[1]) < 0:
        raise p.items["amount"].error("must be from 0 to 1, because it divides the surface")
    lobes: list[Any] = []
    for item, name, share in zip(items, names, shares, strict=True):
        material = item.token.find("material", name, named)
        for lobe in material.lobes if np.any(share) else ():
            if lobe.factor is None:
                raise p.directive.error(f"a material of the kind {material.name} cannot be mixed")
            factor = scale(getattr(lobe, lobe.factor), tuple(np.broadcast_to(share, 3).tolist()))
            lobes.append(replace(lobe, **{lobe.factor: factor}))
    return Material(tuple(lobes), "mix")


MATERIALS: Mapping[str, Mapping[str, Callable[[Parameters], Material] | None]] = {
    "v2": V2_MATERIALS,
    "v3": {
        "matte": V2_MATERIALS["matte"],
        "mirror": V2_MATERIALS["mirror"],
        "glass": lambda p: _refractive(p, p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index("eta", p.index())),
        "plastic": _plastic,
        "uber": _uber,
        "metal": lambda p: _rough_metal(
            p, p.constant("eta", materials.COPPER_ETA), p.constant("k", materials.COPPER_K), 0.01, "metal"
        ),
        "substrate": _substrate,
        "mix": None,
    },
    "v4": {
        "diffuse": lambda p: replace(materials.matte(p.albedo("reflectance", 0.5)), name="diffuse"),
        "conductor": _conductor,
        "dielectric": lambda p: replace(_refractive(p, 1, 1, p.index("eta", 1.5)), name="dielectric"),
        "coateddiffuse": _coated,
        "mix": None,
    },
}
"""Functions that make materials, by the names of the dialect and the material; None for a mix of two others."""
