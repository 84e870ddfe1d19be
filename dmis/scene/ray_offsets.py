"""Ray offsets: how far off a surface the rays that leave it begin, so that they do not meet it again by rounding."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.vectors import TINY, Array
from dmis.geometry.refinement import diagonals
from dmis.scene.groups import Part

RAY_OFFSET = 1e-6
"""Distance of ray origins from the surfaces that rays leave, in extents of these (rounding of float32)."""


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
