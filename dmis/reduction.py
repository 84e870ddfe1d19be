"""What is provably zero or constant in the parts of a scene, and is left out of its plan.

Parameters of lobes are listed here, too: what may differ from point to point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from dmis.brdf import Coat, Conductor, Dielectric
from dmis.light import AreaLight, DistantLight, EnvironmentLight, Light
from dmis.material import Material
from dmis.texture import Image

COLOURS = {"reflectance", "diffuse", "specular", "transmittance"}
SCALARS = {"exponent", "u", "v", "alpha", "alpha_u", "alpha_v"}


def parameters(lobe: Any) -> Iterator[tuple[str, Any]]:
    """The parameters that differ from point to point, and the nested data that may hold some."""
    metal = isinstance(lobe, Conductor)
    for field in fields(lobe):
        value = getattr(lobe, field.name)
        holds = is_dataclass(value) and not isinstance(value, Dielectric | Coat)
        if metal or holds or field.name in COLOURS | SCALARS:
            yield field.name, value


def shines(light: Light) -> bool:
    """Whether a light has any power."""
    if isinstance(light, EnvironmentLight):
        return bool(np.any(np.asarray(light.texels).max(axis=(0, 1)) * np.asarray(light.scale)))
    return bool(np.any(light.radiance if isinstance(light, AreaLight | DistantLight) else light.intensity))


def reduced(material: Material) -> Material:
    """The same reflection without black lobes, and with constants in place of constant images.

    `dmis.brdf.BlendBase` stays if it is black: which lobe a sample is drawn from would change for old scenes.
    """
    lobes = tuple(_folded(lobe) for lobe in material.lobes)
    kept = tuple(lobe for lobe in lobes if not _black(lobe))
    same = len(kept) == len(material.lobes) and all(a is b for a, b in zip(kept, material.lobes, strict=True))
    return material if same else replace(material, lobes=kept)


def _folded(lobe: Any) -> Any:
    """`lobe`, or a copy with the values of its images whose texels are all the same."""
    changes: dict[str, Any] = {}
    for name, value in parameters(lobe):
        if isinstance(value, Image):
            if value.wrap != "black" and (value.texels == value.texels[0, 0]).all():
                texel = value(np.zeros((2, 1), np.float32))[:, 0].tolist()
                changes[name] = tuple(texel) if name in COLOURS else texel[0]
        elif is_dataclass(value) and (folded := _folded(value)) is not value:
            changes[name] = folded
    return replace(lobe, **changes) if changes else lobe


def _black(lobe: Any) -> bool:
    """Whether a lobe reflects nothing, whatever the directions."""
    values = [getattr(lobe, name) for name in ("reflectance", "transmittance") if hasattr(lobe, name)]
    return any(not isinstance(value, Image) and not np.any(value) for value in values)
