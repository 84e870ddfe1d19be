"""Materials of pbrt files by dialect: one table of makers each; those of pbrt-v2 are in `dmis.pbrt_objects`.

All rough materials of pbrt-v3 and v4 are microfacets with the distribution of Trowbridge and Reitz (GGX). `_rough` is
the one place that says whether there is a lobe for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dmis import material
from dmis.brdf import SpecularReflection
from dmis.conductor import ExactConductor
from dmis.material import Material
from dmis.pbrt_objects import V2_MATERIALS, Lookup, Textures
from dmis.pbrt_parameters import Parameters
from dmis.pbrt_spectra import SPECTRA
from dmis.pbrt_tokens import PbrtError, Token, blame
from dmis.texture import Image, scale

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


def _rough(p: Lookup, *names: str) -> PbrtError:
    """The error of a material that needs a GGX lobe, at the parameter that asks for it if there is one."""
    token = next((one.items[n].token for one in p.lists for n in names if n in one.items), p.name)
    return token.error(
        f"rough {p.name.name} is not supported yet in {p.name.source.dialect.name}, whose roughness is that of the "
        "GGX distribution"
    )


def _smooth(p: Lookup) -> bool:
    """Whether the roughness of a material that may be smooth is 0."""
    p.boolean("remaproughness", True)
    both = p.real("roughness", 0)
    u, v = p.real("uroughness", both), p.real("vroughness", both)  # type: ignore[arg-type]
    return not isinstance(u, Image) and not isinstance(v, Image) and u == v == 0


def _black(value: Any) -> bool:
    return not np.any(value.texels if isinstance(value, Image) else value)


# pbrt-v3 ------------------------------------------------------------------------------------------------------------


def _plastic(p: Lookup) -> Material:
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    if not _black(ks):
        raise _rough(p, "roughness", "Ks")
    p.boolean("remaproughness", True), p.real("roughness", 0.1)
    return replace(material.matte(kd), name="plastic")


def _always_rough(p: Lookup) -> Material:
    raise _rough(p, "roughness", "uroughness", "vroughness")


def _uber(p: Lookup) -> Material:
    ks = p.reflectance("Ks", 0.25)
    if not _black(ks):
        raise _rough(p, "roughness", "uroughness", "Ks")
    p.boolean("remaproughness", True), p.real("roughness", 0.1)
    index = p.index("eta", p.index())
    kd, kr, kt = p.reflectance("Kd", 0.25), p.reflectance("Kr", 0), p.reflectance("Kt", 0)
    return material.uber(kd, 0, kr, kt, eta=index, opacity=p.reflectance("opacity", 1))


def _glass(p: Lookup) -> Material:
    if not _smooth(p):
        raise _rough(p, "uroughness", "vroughness")
    return material.glass(p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index("eta", p.index()))


def _mix3(p: Lookup) -> Material:
    first, second = (p.named(*p.string(f"namedmaterial{k}")) for k in (1, 2))
    amount = np.asarray(p.constant_colour("amount", (0.5, 0.5, 0.5)))
    return _mixed(p, first, second, amount, 1 - amount)


# pbrt-v4 ------------------------------------------------------------------------------------------------------------


def _diffuse(p: Lookup) -> Material:
    return replace(material.matte(p.reflectance("reflectance", 0.5)), name="diffuse")


def _conductor(p: Lookup) -> Material:
    if not _smooth(p):
        raise _rough(p, "roughness", "uroughness", "vroughness")
    if p.has("reflectance"):
        if p.has("eta") or p.has("k"):
            raise p.error("reflectance", "must not stand beside eta and k, which give the same")
        r = np.clip(p.constant_colour("reflectance", (0.5, 0.5, 0.5)), 0, 0.9999)
        eta, k = np.ones(3), 2 * np.sqrt(r) / np.sqrt(1 - r)
    else:
        named = SPECTRA["v4"].named
        eta = np.asarray(p.constant_colour("eta", named["metal-Cu-eta"]))
        k = np.asarray(p.constant_colour("k", named["metal-Cu-k"]))
    if (eta <= 0).any() or (k < 0).any():
        raise ValueError(f"a metal needs eta above 0 and k at least 0; got {eta.tolist()} and {k.tolist()}")
    (er, eg, eb), (kr, kg, kb) = eta.tolist(), k.tolist()
    return Material((SpecularReflection(1.0, ExactConductor((er, eg, eb), (kr, kg, kb))),), "conductor")


def _dielectric(p: Lookup) -> Material:
    if not _smooth(p):
        raise _rough(p, "roughness", "uroughness", "vroughness")
    return replace(material.glass(1, 1, p.index("eta", 1.5)), name="dielectric")


def _coated(p: Lookup) -> Material:
    raise p.name.error("coateddiffuse is not supported yet: v4 follows light through its layers, there is no such lobe")


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
            if name is None:
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
        "metal": _always_rough,
        "substrate": _always_rough,
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
