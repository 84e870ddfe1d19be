"""Materials of pbrt files by dialect: one table of makers each; those of pbrt-v2 are in `dmis.pbrt_objects`.

All rough materials of pbrt-v3 and v4 are microfacets with the distribution of Trowbridge and Reitz (GGX, `dmis.ggx`).
Sources: materials/ and core/microfacet.h of pbrt-v3, pbrt/materials.h, bxdfs.h and util/scattering.h of pbrt-v4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from dmis import material, models
from dmis.brdf import BlendBase, BlendCoat, Dielectric, SpecularReflection
from dmis.coat import CoatedBase
from dmis.conductor import ExactConductor
from dmis.ggx import TrowbridgeReitz
from dmis.material import Material
from dmis.pbrt_objects import V2_MATERIALS, Lookup, Textures
from dmis.pbrt_parameters import Parameters
from dmis.pbrt_spectra import SPECTRA
from dmis.pbrt_tokens import Token, blame
from dmis.texture import Image, scale
from dmis.vec import Array

Named = Callable[[Token, str], Material]
"""Finds a named material, or raises the error of the token."""


def make_material(name: Token, lists: tuple[Parameters, ...], textures: Textures, named: Named) -> Material:
    """The material `name`, with parameters from the first of the `lists` that has them."""
    for parameters in lists:
        for bump in ("bumpmap", "displacement", "normalmap"):
            parameters.refuse(bump, "bump maps are not supported; remove the parameter, or bake it into the mesh")
    with blame(name):
        return MATERIALS[name.source.dialect.name][name.name](Lookup(lists, textures, name, named))


def check_material(name: Token) -> None:
    """Raise if the material `name` is unknown."""
    dialect = name.source.dialect.name
    if name.name not in MATERIALS[dialect]:
        known = ", ".join(MATERIALS[dialect])
        raise name.error(f"a material must be one of {known}; others are not supported in {dialect}")


def _polynomial(roughness: Any) -> Any:
    """alpha in pbrt-v3, from a roughness in [0, 1] or so (core/microfacet.h, RoughnessToAlpha)."""
    return np.polyval([0.000640711, 0.0171201, 0.1734, 0.819955, 1.62142], np.log(np.maximum(roughness, 1e-3)))


class _PolynomialOf(Image):
    """The alpha of pbrt-v3 where the image is roughness."""

    outside: ClassVar[float] = float(_polynomial(0.0))

    def __call__(self, uv: Array) -> Array:
        return _polynomial(super().__call__(uv))


class _RootOf(Image):
    """The alpha of pbrt-v4 where the image is roughness."""

    def __call__(self, uv: Array) -> Array:
        return np.sqrt(super().__call__(uv))


LEAST_ALPHA = 1e-3
"""Smaller alphas are raised to this in pbrt-v3, and are smooth in v4."""


def _roughness(p: Lookup, default: float) -> tuple[Any, Any]:
    """Roughness along both tangents, numbers or images.

    What is not given for one of them is ``roughness``; but for v, with ``uber``, what is given for u.
    """
    both = p.real("roughness", default)
    u = p.real("uroughness", both)  # type: ignore[arg-type]
    return u, p.real("vroughness", u if p.name.name == "uber" else both)  # type: ignore[arg-type]


def _alphas(p: Lookup, roughness: tuple[Any, Any]) -> tuple[Any, Any]:
    """alpha along both tangents, numbers or images; the second is None if it is the same."""
    u, v = roughness
    remap, v3 = p.boolean("remaproughness", True), p.name.source.dialect.name == "v3"
    same = u is v or (not isinstance(u, Image) and not isinstance(v, Image) and u == v)
    return _alpha(u, remap, v3), None if same else _alpha(v, remap, v3)


def _alpha(value: Any, remap: bool, v3: bool) -> Any:
    texels = value.texels if isinstance(value, Image) else np.asarray(value, float)
    if np.min(texels) < 0:
        raise ValueError("the roughness of a material must not be negative, because it is a spread of slopes")
    if not isinstance(value, Image):
        alpha = float((_polynomial(value) if v3 else np.sqrt(value)) if remap else value)
        return max(alpha, LEAST_ALPHA) if v3 else alpha
    if not v3 and np.min(texels) < (LEAST_ALPHA**2 if remap else LEAST_ALPHA):
        raise ValueError(
            "an image of roughness must be rough everywhere; one that is smooth in places is not supported"
        )
    kind = (_PolynomialOf if v3 else _RootOf) if remap else Image
    return kind(np.maximum(texels, np.float32(LEAST_ALPHA)) if v3 else texels, value.scale, value.offset, value.wrap)


def _smooth(p: Lookup) -> bool:
    """Whether a material that may be smooth is."""
    roughness = _roughness(p, 0)
    values = _alphas(p, roughness)
    if p.name.source.dialect.name == "v3":
        return all(not isinstance(value, Image) and value == 0 for value in roughness)
    below = [not isinstance(a, Image) and a < LEAST_ALPHA for a in values if a is not None]
    if any(below) and not all(below):
        raise ValueError("a material must be rough along both tangents, or along none")
    return all(below)


def _black(value: Any) -> bool:
    return not np.any(value.texels if isinstance(value, Image) else value)


# pbrt-v3 ------------------------------------------------------------------------------------------------------------


def _plastic(p: Lookup) -> Material:
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    remap, roughness = p.boolean("remaproughness", True), p.real("roughness", 0.1)
    # pbrt-v3 swaps the two media, like v2 (materials/plastic.cpp)
    made = models.ggx(kd, ks, _alpha(roughness, remap, True), fresnel=Dielectric(1 / 1.5))
    return replace(made, name="plastic")


def _metal(p: Lookup) -> Material:
    eta = p.constant_colour("eta", material.COPPER_ETA)
    k = p.constant_colour("k", material.COPPER_K)
    return _rough_metal(p, eta, k, _roughness(p, 0.01), "metal")


def _substrate(p: Lookup) -> Material:
    kd, ks = p.reflectance("Kd", 0.5), p.reflectance("Ks", 0.5)
    alphas = _alphas(p, (p.real("uroughness", 0.1), p.real("vroughness", 0.1)))
    if _black(kd) and _black(ks):
        return Material((), "substrate")
    facets = TrowbridgeReitz(models.spread(*alphas))
    return Material((BlendBase(kd, ks), BlendCoat(ks, facets)), "substrate")


def _uber(p: Lookup) -> Material:
    ks, opacity = p.reflectance("Ks", 0.25), p.share("opacity", 1)
    index, (alpha, alpha_v) = p.index("eta", p.index()), _alphas(p, _roughness(p, 0.1))
    kd, kr, kt = p.reflectance("Kd", 0.25), p.reflectance("Kr", 0), p.reflectance("Kt", 0)
    others = material.uber(kd, 0, kr, kt, eta=index, opacity=opacity)
    rough = models.ggx(0, scale(opacity, ks), alpha, alpha_v, Dielectric(index))
    return replace(others, lobes=others.lobes + rough.lobes)


def _glass(p: Lookup) -> Material:
    return _refractive(p, p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index("eta", p.index()))


def _refractive(p: Lookup, kr: Any, kt: Any, index: float) -> Material:
    """Glass, rough or smooth; what has the index of its surroundings lets all light straight through."""
    if _smooth(p) or index == 1:
        return material.glass(kr, kt, index)
    return models.rough_glass(kr, kt, *_alphas(p, _roughness(p, 0)), index)


def _mix3(p: Lookup) -> Material:
    first, second = (p.named(*p.string(f"namedmaterial{k}")) for k in (1, 2))
    amount = np.asarray(p.constant_colour("amount", (0.5, 0.5, 0.5)))
    return _mixed(p, first, second, amount, 1 - amount)


# pbrt-v4 ------------------------------------------------------------------------------------------------------------


def _diffuse(p: Lookup) -> Material:
    return replace(material.matte(p.share("reflectance", 0.5)), name="diffuse")


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
    both = p.constant("roughness", 0)
    u, v = (p.constant(name, both) for name in ("uroughness", "vroughness"))
    if u != v:
        name = next(name for name in ("uroughness", "vroughness") if p.has(name))
        raise p.error(name, "must be the same along both tangents of a coat, because what passes it is tabulated")
    alpha, _ = _alphas(p, (u, v))
    return models.coated_diffuse(
        p.share("reflectance", 0.5),  # which v4 clamps
        alpha if alpha >= LEAST_ALPHA else 0,
        p.index("eta", 1.5),
        thickness,
        (depth + 1) // 2,  # every other interface is the base
    )


def _mix4(p: Lookup) -> Material:
    token, *names = p.string("materials", count=2)
    amount = p.constant("amount", 0.5)
    return _mixed(p, p.named(token, names[0]), p.named(token, names[1]), np.float64(1 - amount), np.float64(amount))


def _mixed(p: Lookup, first: Material, second: Material, a: Any, b: Any) -> Material:
    """The sum of two materials: pbrt-v4 picks one of them at random, with the same mean."""
    if np.min(a) < 0 or np.min(b) < 0:
        raise p.error("amount", "must be from 0 to 1, because it divides the surface")
    lobes: list[Any] = []
    for share, made in ((a, first), (b, second)):
        every: tuple[Any, ...] = made.lobes if np.any(share) else ()
        for lobe in every:
            name = next((n for n in ("reflectance", "transmittance") if hasattr(lobe, n)), None)
            if name is None or isinstance(lobe, CoatedBase):  # whose colour is not in proportion to its reflectance
                raise p.name.error(f"a material of the kind {made.name} cannot be mixed")
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
"""By the names of the dialect and the material."""
