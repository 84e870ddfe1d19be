"""Materials of pbrt files: a table of functions for each dialect; those of pbrt-v2 are in `dmis.formats.pbrt.objects`.

All rough materials of pbrt-v3 and v4 are microfacets with the distribution of Trowbridge and Reitz (GGX).
Sources: materials/ and core/microfacet.h of pbrt-v3, pbrt/materials.h, bxdfs.h and util/scattering.h of pbrt-v4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import Array
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
from dmis.formats.pbrt.dialect import V1_MATERIALS
from dmis.formats.pbrt.objects import V2_MATERIALS, Lookup, Textures
from dmis.formats.pbrt.parameters import Parameters
from dmis.formats.pbrt.spectra import SPECTRA
from dmis.formats.pbrt.tokens import Token, blame

Named = Callable[[Token, str], Material]
"""Function that returns a named material, or raises an error about its token."""


def make_material(name: Token, lists: tuple[Parameters, ...], textures: Textures, named: Named) -> Material:
    """Return the material `name`, with parameters from the first of the `lists` that has them."""
    for parameters in lists:
        for bump in ("bumpmap", "displacement", "normalmap"):
            parameters.refuse(bump, "bump maps are not supported; remove the parameter, or bake it into the mesh")
    with blame(name), materials.unbounded():
        return MATERIALS[name.source.dialect.name][name.name](Lookup(lists, textures, name, named))


def check_material(name: Token) -> None:
    """Raise a `PbrtError` if the material `name` is unknown."""
    dialect = name.source.dialect.name
    if name.name in V1_MATERIALS:
        raise name.error(
            f"{name.name} is a material of pbrt-v1, made of measured data; write another one, such as matte"
        )
    if name.name not in MATERIALS[dialect]:
        names = ", ".join(MATERIALS[dialect])
        raise name.error(f"a material must be one of {names}; others are not supported in {dialect}")


def _polynomial(roughness: Any) -> Any:
    """Return pbrt-v3's alpha of a roughness in about [0, 1] (core/microfacet.h, RoughnessToAlpha)."""
    return np.polyval([0.000640711, 0.0171201, 0.1734, 0.819955, 1.62142], np.log(np.maximum(roughness, 1e-3)))


class _PolynomialOf(Image):
    """Image of pbrt-v3's alpha, made of an image of roughness."""

    outside: ClassVar[float] = float(_polynomial(0.0))

    def __call__(self, uv: Array) -> Array:
        return _polynomial(super().__call__(uv))


class _RootOf(Image):
    """Image of pbrt-v4's alpha, made of an image of roughness."""

    def __call__(self, uv: Array) -> Array:
        return np.sqrt(super().__call__(uv))


MIN_ROUGH_ALPHA = 1e-3
"""Smallest alpha of a rough material: pbrt-v3 raises smaller ones to it, v4 makes them smooth."""


def _roughness(p: Lookup, default: float) -> tuple[Any, Any]:
    """Return the roughness along both tangents, numbers or images.

    The default along each is ``roughness``; but along v, with ``uber``, it is the roughness along u.
    """
    default_roughness = p.real("roughness", default)
    u = p.real("uroughness", default_roughness)  # type: ignore[arg-type]
    return u, p.real("vroughness", u if p.name.name == "uber" else default_roughness)  # type: ignore[arg-type]


def _alphas(p: Lookup, roughness: tuple[Any, Any]) -> tuple[Any, Any]:
    """Return the alpha along both tangents, numbers or images; the second is None if it is the same."""
    u, v = roughness
    remap, v3 = p.boolean("remaproughness", True), p.name.source.dialect.name == "v3"
    same = u is v or (not isinstance(u, Image) and not isinstance(v, Image) and u == v)
    return _alpha(u, remap, v3), None if same else _alpha(v, remap, v3)


def _alpha(value: Any, remap: bool, v3: bool) -> Any:
    """Return the alpha of a roughness, a number or an image, in v3 or v4; without `remap` roughness is alpha."""
    texels = value.texels if isinstance(value, Image) else np.asarray(value, float)
    if np.min(texels) < 0:
        raise ValueError("the roughness of a material must not be negative, because it is a spread of slopes")
    if not isinstance(value, Image):
        alpha = float((_polynomial(value) if v3 else np.sqrt(value)) if remap else value)
        return max(alpha, MIN_ROUGH_ALPHA) if v3 else alpha
    if not v3 and np.min(texels) < (MIN_ROUGH_ALPHA**2 if remap else MIN_ROUGH_ALPHA):
        raise ValueError(
            "an image of roughness must be rough everywhere; one that is smooth in places is not supported"
        )
    kind = (_PolynomialOf if v3 else _RootOf) if remap else Image
    return kind(
        np.maximum(texels, np.float32(MIN_ROUGH_ALPHA)) if v3 else texels, value.scale, value.offset, value.wrap
    )


def _smooth(p: Lookup) -> bool:
    """Return whether a material that may be rough or smooth is smooth."""
    roughness = _roughness(p, 0)
    values = _alphas(p, roughness)
    if p.name.source.dialect.name == "v3":
        return all(not isinstance(value, Image) and value == 0 for value in roughness)
    below = [not isinstance(a, Image) and a < MIN_ROUGH_ALPHA for a in values if a is not None]
    if any(below) and not all(below):
        raise ValueError("a material must be rough along both tangents, or along none")
    return all(below)


def _black(value: Any) -> bool:
    """Return whether a reflectance, an RGB triple or an image, is zero everywhere."""
    return not np.any(value.texels if isinstance(value, Image) else value)


def _plastic(p: Lookup) -> Material:
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


def _metal(p: Lookup) -> Material:
    eta = p.constant_colour("eta", materials.COPPER_ETA)
    k = p.constant_colour("k", materials.COPPER_K)
    return _rough_metal(p, eta, k, _roughness(p, 0.01), "metal")


def _substrate(p: Lookup) -> Material:
    kd, ks = p.reflectance("Kd", 0.5), p.reflectance("Ks", 0.5)
    alphas = _alphas(p, (p.real("uroughness", 0.1), p.real("vroughness", 0.1)))
    if _black(kd) and _black(ks):
        return Material((), "substrate")
    facets = TrowbridgeReitz(models.facet_roughness(*alphas))
    return Material((BlendBase(kd, ks), BlendCoat(ks, facets)), "substrate")


def _uber(p: Lookup) -> Material:
    ks, opacity = p.reflectance("Ks", 0.25), p.share("opacity", 1)
    index, (alpha, alpha_v) = p.index("eta", p.index()), _alphas(p, _roughness(p, 0.1))
    kd, kr, kt = p.reflectance("Kd", 0.25), p.reflectance("Kr", 0), p.reflectance("Kt", 0)
    others = materials.uber(kd, 0, kr, kt, eta=index, opacity=opacity)
    rough = models.ggx(0, scale(opacity, ks), alpha, alpha_v, Dielectric(index))
    return replace(others, lobes=others.lobes + _by_side(rough))


def _glass(p: Lookup) -> Material:
    return _refractive(p, p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index("eta", p.index()))


def _refractive(p: Lookup, kr: Any, kt: Any, index: float) -> Material:
    """Return glass, rough or smooth; with the index 1 it is smooth, and light passes straight through."""
    if _smooth(p) or index == 1:
        return materials.glass(kr, kt, index)
    return models.rough_glass(kr, kt, *_alphas(p, _roughness(p, 0)), index)


def _mix3(p: Lookup) -> Material:
    first, second = (p.named(*p.string(f"namedmaterial{k}")) for k in (1, 2))
    amount = np.asarray(p.constant_colour("amount", (0.5, 0.5, 0.5)))
    return _mixed(p, first, second, amount, 1 - amount)


def _diffuse(p: Lookup) -> Material:
    return replace(materials.matte(p.albedo("reflectance", 0.5)), name="diffuse")


def _conductor(p: Lookup) -> Material:
    if p.has("reflectance"):
        if p.has("eta") or p.has("k"):
            raise p.error("reflectance", "must not stand beside eta and k, which give the same")
        r = np.clip(p.constant_colour("reflectance", (0.5, 0.5, 0.5)), 0, 0.9999)
        eta, k = np.ones(3), 2 * np.sqrt(r) / np.sqrt(1 - r)
    else:
        named = SPECTRA["v4"].named()
        eta = np.asarray(p.constant_colour("eta", named["metal-Cu-eta"]))
        k = np.asarray(p.constant_colour("k", named["metal-Cu-k"]))
    if _smooth(p):
        return Material((SpecularReflection(1.0, _fresnel(eta, k)),), "conductor")
    return _rough_metal(p, eta, k, _roughness(p, 0), "conductor")


def _rough_metal(p: Lookup, eta: Any, k: Any, roughness: tuple[Any, Any], name: str) -> Material:
    alpha, alpha_v = _alphas(p, roughness)
    return replace(models.ggx(0, 1, alpha, alpha_v, _fresnel(eta, k)), name=name)


def _fresnel(eta: Any, k: Any) -> ExactConductor:
    eta, k = np.asarray(eta, float), np.asarray(k, float)
    if (eta <= 0).any() or (k < 0).any():
        raise ValueError(f"a metal needs eta above 0 and k at least 0; got {eta.tolist()} and {k.tolist()}")
    (er, eg, eb), (kr, kg, kb) = eta.tolist(), k.tolist()
    return ExactConductor((er, eg, eb), (kr, kg, kb))


def _dielectric(p: Lookup) -> Material:
    return replace(_refractive(p, 1, 1, p.index("eta", 1.5)), name="dielectric")


def _coated(p: Lookup) -> Material:
    if any(p.constant_colour("albedo", (0.0, 0.0, 0.0))):
        raise p.error("albedo", "must be black, because light that is scattered inside of a coat has no formula")
    p.constant("g", 0), p.integer("nsamples", 1)  # of that medium; of random walks, whose mean is computed here
    depth, thickness = p.integer("maxdepth", 10), max(p.constant("thickness", 0.01), 0)
    if depth < 1:
        raise p.error("maxdepth", f"must be at least 1, because the base is the first that light meets; got {depth}")
    default_roughness = p.constant("roughness", 0)
    u, v = (p.constant(name, default_roughness) for name in ("uroughness", "vroughness"))
    if u != v:
        name = next(name for name in ("uroughness", "vroughness") if p.has(name))
        raise p.error(name, "must be the same along both tangents of a coat, because what passes it is tabulated")
    alpha, _ = _alphas(p, (u, v))
    return models.coated_diffuse(
        p.albedo("reflectance", 0.5),
        alpha if alpha >= MIN_ROUGH_ALPHA else 0,
        p.index("eta", 1.5),
        thickness,
        (depth + 1) // 2,  # every other interface is the base
    )


def _mix4(p: Lookup) -> Material:
    token, *names = p.string("materials", count=2)
    amount = p.constant("amount", 0.5)
    return _mixed(p, p.named(token, names[0]), p.named(token, names[1]), np.float64(1 - amount), np.float64(amount))


def _mixed(p: Lookup, first: Material, second: Material, a: Any, b: Any) -> Material:
    """Return the sum of two materials: pbrt-v4 picks one of them at random, with the same mean."""
    if np.min(a) < 0 or np.min(b) < 0:
        raise p.error("amount", "must be from 0 to 1, because it divides the surface")
    lobes: list[Any] = []
    for share, material in ((a, first), (b, second)):
        chosen: tuple[Any, ...] = material.lobes if np.any(share) else ()
        for lobe in chosen:
            name = lobe.factor
            if name is None:
                raise p.name.error(f"a material of the kind {material.name} cannot be mixed")
            changes: dict[str, Any] = {name: scale(getattr(lobe, name), tuple(np.broadcast_to(share, 3).tolist()))}
            lobes.append(replace(lobe, **changes))
    return Material(tuple(lobes), "mix")


MATERIALS: Mapping[str, Mapping[str, Callable[[Lookup], Material]]] = {
    "v2": V2_MATERIALS,
    "v3": {
        "matte": V2_MATERIALS["matte"],
        "mirror": V2_MATERIALS["mirror"],
        "glass": _glass,
        "plastic": _plastic,
        "uber": _uber,
        "metal": _metal,
        "substrate": _substrate,
        "mix": _mix3,
    },
    "v4": {
        "diffuse": _diffuse,
        "conductor": _conductor,
        "dielectric": _dielectric,
        "coateddiffuse": _coated,
        "mix": _mix4,
    },
}
"""Functions that make materials, by the names of the dialect and the material."""
