"""Skies of pbrt-v4, whose maps are squares of equal area, as latitude-longitude maps.

A direction on the upper hemisphere lies in the square |s| + |t| <= 1, at a distance from its middle that makes areas
proportional to solid angles; the lower one is folded outwards into the corners (Clarberg 2008, "Fast Equal-Area Mapping
of the (Hemi)Sphere using SIMD"). pbrt looks texels up without interpolation.
"""

from __future__ import annotations

import numpy as np

from dmis.base.patches import row_blocks
from dmis.base.vectors import Array

SIDE_SAMPLES = 4096
"""Lookups along the height of a map, at least one for each row; a texel is the mean of its own."""


def sphere_to_square(d: Array) -> Array:
    """Return coordinates in [0, 1], ``(2, N)``, of unit directions ``(3, N)``."""
    x, y, z = np.abs(d)
    radius = np.sqrt(np.maximum(1 - z, 0))
    angle = np.arctan2(y, x) * (2 / np.pi)  # share of a quarter turn
    v = angle * radius
    u = radius - v
    u, v = np.where(d[2] < 0, (1 - v, 1 - u), (u, v))
    return (np.stack([np.copysign(u, d[0]), np.copysign(v, d[1])]) + 1) / 2


def to_latitude_longitude(square: Array) -> Array:
    """Return the latitude-longitude map ``(N, 2 N, 3)`` of a map of equal area ``(N, N, 3)``, both row 0 on top."""
    side = len(square)
    if square.shape[1] != side:
        raise ValueError(f"the map of a sky must be square in v4; got {square.shape[1]}x{side} pixels")
    fine = max(1, min(8, SIDE_SAMPLES // side))
    offsets = (np.arange(fine) + 0.5) / fine
    phi = ((np.arange(2 * side)[:, None] + offsets) * (np.pi / side)).reshape(-1)
    result = np.zeros((side, 2 * side, 3), np.float32)
    for block in row_blocks(side, 8):
        theta = ((np.arange(side)[block, None] + offsets) * (np.pi / side)).reshape(-1, 1)
        d = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi
        place = sphere_to_square(np.reshape(d, (3, -1)))
        column, row = np.minimum((place * side).astype(np.int32), side - 1)
        texels = square[row, column].reshape(-1, fine, 2 * side, fine, 3)
        result[block] = texels.mean(axis=(1, 3))
    return result
