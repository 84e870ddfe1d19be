"""Simplification of materials: black lobes are left out, and constant images become numbers.

`parameters` lists what may differ from point to point, which lobes declare.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np

from dmis.brdf.lobe import Parameters
from dmis.brdf.materials import Material
from dmis.brdf.texture import Image, Images


def parameters(lobe: Parameters) -> Iterator[tuple[str, Any]]:
    """Yield the parameters that differ from point to point, and the nested data that may hold some, by name."""
    for field in fields(lobe):  # type: ignore[arg-type]
        value = getattr(lobe, field.name)
        nested = hasattr(value, "colours")  # to ask whether it is an instance of the protocol takes 30 µs
        if nested or field.name in lobe.colours or field.name in lobe.scalars or isinstance(value, Image | Images):
            yield field.name, value


def simplify(material: Material) -> Material:
    """Return a material without black lobes, and with constants in place of constant images.

    `dmis.brdf.ashikhmin_shirley.BlendBase` stays if it is black: which lobe a sample is drawn from would change for
    old scenes.
    """
    lobes = tuple(_fold_constant_images(lobe) for lobe in material.lobes)
    kept = tuple(lobe for lobe in lobes if not lobe.is_black())
    same = len(kept) == len(material.lobes) and all(a is b for a, b in zip(kept, material.lobes, strict=True))
    return material if same else replace(material, lobes=kept)


def _fold_constant_images(lobe: Any) -> Any:
    """Return `lobe` with numbers in place of images whose texels are all the same."""
    changes: dict[str, Any] = {}
    for name, value in parameters(lobe):
        if isinstance(value, Image):
            if "black" not in value.wraps and (value.texels == value.texels[0, 0]).all():
                texel = value(np.zeros((2, 1), np.float32))[:, 0].tolist()
                changes[name] = tuple(texel) if name in lobe.colours else texel[0]
        elif isinstance(value, Parameters) and (folded := _fold_constant_images(value)) is not value:
            changes[name] = folded
    return replace(lobe, **changes) if changes else lobe
