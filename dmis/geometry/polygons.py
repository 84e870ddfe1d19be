"""Triangles of polygons: a fan, or ears that are cut off a concave one."""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Floats
from dmis.geometry.mesh import Ints

MOST_CONCAVE = 256
"""Most corners of a polygon whose ears are cut off."""


def triangulate(sides: Ints, points: Floats) -> Ints:
    """Return the corners of the triangles of polygons of `sides` (N,) corners at `points` (C, 3), (F, 3).

    They are the fan (0, 1, 2), (0, 2, 3), ..., or `_ears` where one of it is wound against its polygon.
    """
    if (sides == 3).all():
        return np.arange(len(points)).reshape(-1, 3)
    count = sides - 2
    begin = np.cumsum(sides) - sides
    polygon = np.repeat(np.arange(len(sides)), count)
    place = np.cumsum(count) - count
    second = np.arange(count.sum()) - place[polygon] + begin[polygon] + 1
    triangles = np.stack([begin[polygon], second, second + 1], axis=1)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    cross = np.cross(b - a, c - a)
    normal = np.add.reduceat(cross, place)
    against = (cross * normal[polygon]).sum(axis=1) < -1e-9 * (normal[polygon] ** 2).sum(axis=1)
    for k in np.unique(polygon[against]):
        if sides[k] <= MOST_CONCAVE:
            corners = slice(begin[k], begin[k] + sides[k])
            triangles[place[k] : place[k] + count[k]] = begin[k] + _ears(points[corners], normal[k])
    return triangles


def _ears(points: Floats, normal: Floats) -> Ints:
    """Return triangles of one polygon (N, 3), cut off at corners in which no other one is, (N - 2, 3)."""
    left = list(range(len(points)))
    ears = []
    while len(left) > 3:
        for k, b in enumerate(left):
            a, c = left[k - 1], left[(k + 1) % len(left)]
            others = points[[n for n in left if n not in (a, b, c)]]
            sides = ((points[y] - points[x], others - points[x]) for x, y in ((a, b), (b, c), (c, a)))
            inside = np.logical_and.reduce([np.cross(side, to) @ normal >= 0 for side, to in sides])
            if np.cross(points[b] - points[a], points[c] - points[b]) @ normal > 0 and not inside.any():
                break
        ears.append((a, b, c))  # the last one, if lines cross
        left.remove(b)
    return np.array([*ears, left])
