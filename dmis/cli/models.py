"""Texts of the options that give a model what its file lacks: a sky and a material."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from dmis.base.validate import did_you_mean
from dmis.brdf import materials, metallic_roughness, models
from dmis.brdf.materials import Material
from dmis.light.environment import EnvironmentLight

_MAKERS = (
    materials.matte, materials.plastic, materials.metal, materials.shiny_metal, materials.substrate, materials.uber,
    materials.mirror, materials.glass, metallic_roughness.metallic_roughness, models.phong, models.blinn_phong,
    models.ward, models.ashikhmin_shirley, models.cook_torrance, models.ggx, models.rough_glass, models.coated_diffuse,
)  # fmt: skip
MATERIALS: dict[str, Callable[..., Material]] = {make.__name__: make for make in _MAKERS}
"""Materials by the names of their functions."""


def read_sky(text: str, up: tuple[float, float, float]) -> EnvironmentLight:
    """Return the sky of a text: an even one of "R G B" or of one number, or that of an image file.

    The top of the image is towards `up`, and it is not mirrored: text in it can be read.
    """
    values = _numbers(text)
    if values is not None and len(values) in (1, 3):
        return EnvironmentLight(np.broadcast_to(values, (16, 32, 3)))
    y_up = up[1] != 0
    return EnvironmentLight(text, np.eye(3)[[0, 2, 1]] if y_up else np.diag((1.0, -1.0, 1.0)))  # type: ignore[arg-type]


def read_material(text: str) -> Material:
    """Return the material of a text: a name of `MATERIALS`, a colon, and parameters ``name=value``, with commas.

    A value is a number, three numbers with spaces between them, or the path of an image file.
    """
    name, _, rest = text.strip().partition(":")
    if name not in MATERIALS:
        raise ValueError(
            f"--material must be one of {', '.join(MATERIALS)}, with parameters after a colon; got "
            f"{name!r}{did_you_mean(name, MATERIALS)}"
        )
    known = inspect.signature(MATERIALS[name]).parameters
    given: dict[str, Any] = {}
    for part in rest.split(",") if rest else []:
        key, is_given, value = (piece.strip() for piece in part.partition("="))
        if not is_given or key not in known:
            raise ValueError(
                f"parameters of {name} are {', '.join(known)}, such as {next(iter(known))}=0.5; got {part!r}"
            )
        values = _numbers(value)
        given[key] = value if values is None else values[0] if len(values) == 1 else values
    return MATERIALS[name](**given)


def _numbers(text: str) -> tuple[float, ...] | None:
    """Return the numbers of a text, with spaces between them; None if it is something else."""
    try:
        return tuple(map(float, text.split())) or None
    except ValueError:
        return None
