"""Units that suit float32: a scene near its origin, of a size near 1, whose lights are near 1.

float32 has 7 digits, and squares between 1e-38 and 1e38. A scene of size 1 that is a million away from the origin would
have one digit left for its shape; one of radiance 1e30 has variances that are infinite. Neither is lost in the float64
description that scenes have. So what is extreme is moved, and multiplied by powers of two, before float32 sees it, and
the image is multiplied back. No bit of an ordinary scene's image depends on this, and nothing is copied for it
(`dmis.scene.scene.Scene.in_float32`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.base.vectors import TINY, Array
from dmis.geometry.mesh import Mesh
from dmis.geometry.refinement import diagonals
from dmis.light.light import Light
from dmis.scene.camera import Camera
from dmis.scene.groups import Part

MAX_REACH = 16
"""Largest coordinate in diagonals of the scene for which the origin stays: a scene loses one digit of float32 for each
factor of ten."""
KEPT_DIAGONALS = 2.0**-20, 2.0**20
"""Range of diagonals of scenes whose unit of length stays."""
KEPT_RADIANCES = 2.0**-32, 2.0**32
"""Range of the brightest radiance for which its unit stays: squares of samples, and 1e9 times these, are in float32."""
LIGHT_EXTENTS = 1e-12, 1e12
"""Range of extents of lights, in diagonals of the scene."""
RAY_OFFSET = 1e-6
"""Distance of ray origins from the surfaces that rays leave, in extents of these (rounding of float32)."""


def units(low: Array, high: Array, small: Array, lights: Sequence[Light]) -> tuple[Array, float, float]:
    """Return the origin ``(3,)``, the unit of length and that of radiance in which float32 holds a scene.

    Parameters
    ----------
    low, high
        Bounds of the scene, ``(3,)`` each.
    small
        Bounds of its bodies that are small beside it, ``(B, 2, 3)``; the origin is amid these if they are far off.
    lights
        Its lights.

    A ValueError if the scene is so far away from the origin that even float64 keeps fewer than 7 digits of it, or a
    light is so small or so large that squares of its size are beyond float32.
    """
    size = float(np.linalg.norm(high - low))
    reach = float(np.abs([low, high]).max())
    if reach > 1e9 * size > 0:
        raise ValueError(
            f"a scene must not be further from the origin than 1e9 times its size, where its shape is rounding; got "
            f"coordinates up to {reach:g} and a diagonal of {size:g}"
        )
    for light in lights:
        extent = light.extent()
        if extent is not None and size > 0 and not LIGHT_EXTENTS[0] * size <= extent <= LIGHT_EXTENTS[1] * size:
            raise ValueError(
                f"a light must have {LIGHT_EXTENTS[0]:g} to {LIGHT_EXTENTS[1]:g} times the size of the scene, because "
                f"float32 does not hold its area; got a {type(light).__name__} of {extent:g} in a scene of diagonal "
                f"{size:g}. A smaller one is a PointLight, a larger one an EnvironmentLight"
            )
    origin = (low + high) / 2 if reach > MAX_REACH * size else np.zeros(3)
    if len(small):
        least, most = small[:, 0].min(axis=0), small[:, 1].max(axis=0)
        if np.abs([least, most]).max() > MAX_REACH * np.linalg.norm(most - least):
            origin = (least + most) / 2
    length = _unit(size, KEPT_DIAGONALS)
    return origin, length, _unit(max((light.brightness(length) for light in lights), default=0.0), KEPT_RADIANCES)


def rescale(
    camera: Camera, parts: Sequence[Part], lights: Sequence[Light], units: tuple[Array, float, float]
) -> dict[str, Any]:
    """Return camera, parts and lights in other `units`, by name; a ValueError if a bump map has heights."""
    from dmis.brdf.relief import BumpMap

    origin, length, gain = units
    if length != 1 and any(isinstance(part.material.relief, BumpMap) for part in parts):
        raise ValueError(
            f"a scene with bump maps, whose heights are lengths, must have a diagonal from {KEPT_DIAGONALS[0]:.0e} to "
            f"{KEPT_DIAGONALS[1]:.0e}; scale the scene and the heights"
        )
    new: dict[int, Any] = {id(light): light.rescaled(origin, length, gain) for light in lights}
    matrix = np.array(camera.to_world, np.float64)
    matrix[:3, 3] = (matrix[:3, 3] - origin) / length
    if not camera.is_pinhole:  # lengths of camera space matter
        matrix[:3, :3] /= length
    return {
        "camera": replace(camera, to_world=matrix),
        "parts": tuple(
            replace(
                part,
                mesh=Mesh((part.mesh.vertices - origin) / length, part.mesh.faces, part.mesh.normals, part.mesh.uv),
                light=part.light and new[id(part.light)],
            )
            for part in parts
        ),
        "lights": tuple(new[id(light)] for light in lights),
    }


def _unit(value: float, kept: tuple[float, float]) -> float:
    """Return 1 if `value` is in the range that is `kept`, or 0; else a power of two near it."""
    return 1.0 if kept[0] <= value <= kept[1] or value == 0 else 2.0 ** math.floor(math.log2(value))


def ray_offsets(parts: Sequence[Part], bounds: tuple[Array, Array], small: Array) -> Array:
    """Return the distance along the geometric normal at which rays begin: one, ``()``, or of each triangle, ``(T,)``.

    One is `RAY_OFFSET` of the scene's diagonal or of its largest coordinate, whichever is larger, because these set the
    rounding of float32 positions. In a scene with small bodies, rays would begin far above these. There it is
    `RAY_OFFSET` of the triangle's size or largest coordinate, which set the rounding of a point on it, and of the
    height above it at which Embree sees a ray begin (both less than 2e-7 of that); or of the smallest body.

    Parameters
    ----------
    bounds
        Least and largest coordinates of the parts that rays leave, ``(3,)`` each.
    small
        Bounds of the bodies that are small beside the scene, ``(B, 2, 3)``.
    """
    low, high = bounds
    epsilon = np.array(RAY_OFFSET * max(np.linalg.norm(high - low), np.abs([low, high]).max()), np.float32)
    if not len(small):
        return epsilon
    corners = np.concatenate([part.mesh.vertices[part.mesh.faces] for part in parts])
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    extent = np.maximum(np.maximum(size, np.abs(corners).max(axis=(1, 2))), diagonals(small).min())
    return np.clip((RAY_OFFSET * extent).astype(np.float32), TINY, epsilon)
