"""Lamps in one place: triangles that stand back to back, or overlap.

Every triangle of a light emits on the side that it faces. Of several triangles at one distance a ray caster reports
one, and which one is arbitrary. So copies of a triangle in one light are left out, of two triangles back to back a ray
meets the one that faces it, and lamps that overlap otherwise are refused (`dmis.scene.scene.Scene.prepare`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dmis.base.vectors import Array, Index, distinct
from dmis.intersect import Hits, RayCaster

CORNER_ROUNDING = 2.0**-40
"""Differences of corners that do not count, in largest coordinates of their triangle: rounding of float64."""
MIN_BARYCENTRIC = 0.01
"""Least barycentric coordinate of a point inside of a triangle; neighbours meet at 0, up to rounding."""
PROBES = np.array([[1, 1, 1], [8, 1, 1], [1, 8, 1], [1, 1, 8], [9, 9, 1], [9, 1, 9], [1, 9, 9]], float)
"""Barycentric coordinates, up to a factor, of the points of a triangle at which overlaps are looked for."""


def find_twins(triangles: Array) -> tuple[Index, Index]:
    """Return the first triangles that have the same corners as each of ``(T, 3, 3)``.

    Returns
    -------
    same
        Number of the first one that faces the same side, ``(T,)``: the triangle's own if none comes before it.
    reverse
        Number of the first one that faces the other side, ``(T,)``; -1 if there is none.
    """
    # a power of two, so that triangles of other sizes are not alike; above 1, because the largest coordinate may be 1
    _, exponent = np.frexp(np.abs(triangles).max(axis=(1, 2), keepdims=True) * 1.001)
    grain = np.ldexp(CORNER_ROUNDING, exponent)
    points = (np.round(triangles / grain) * grain + 0.0).reshape(-1, 3)
    corner = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1, 3)
    a, b, c = np.take_along_axis(corner, (corner.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1).T
    keys = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, b], axis=1)])
    _, first, key = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    same, reverse = first[key.ravel()].reshape(2, -1)
    return same, np.where(reverse < len(triangles), reverse, -1)


class TwoSided:
    """A caster that reports, of two triangles back to back, the one that faces the ray, whichever `caster` reports.

    `triangles` ``(K, 3, 3)`` are those that have a twin, `number` ``(K,)`` their numbers in `caster`, ascending, and
    `twin` ``(K,)`` the positions of their twins among them.
    """

    def __init__(self, caster: RayCaster, triangles: Array, number: Index, twin: Index) -> None:
        self.occluded = caster.occluded
        self._caster, self._number, self._twin = caster, number, twin
        self._normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        gaps = np.abs(triangles[twin][:, :, None] - triangles[:, None]).sum(axis=-1)
        self._corner = gaps.argmin(axis=2)  # which corner of the triangle is corner k of its twin

    def closest(self, origin: Array, direction: Array) -> Hits:
        """See `dmis.intersect.Intersector.closest`."""
        hits = self._caster.closest(origin, direction)
        ray = np.flatnonzero(np.isin(hits.prim, self._number))
        k = np.searchsorted(self._number, hits.prim[ray])
        behind = np.einsum("kc,ck->k", self._normal[k], direction[:, ray]) > 0
        ray, k = ray[behind], k[behind]
        weights = np.stack([1 - hits.u[ray] - hits.v[ray], hits.u[ray], hits.v[ray]], axis=1)
        _, u, v = np.take_along_axis(weights, self._corner[k], axis=1).T
        prim = hits.prim.copy()
        prim[ray] = self._number[self._twin[k]]
        rows = np.stack([hits.u, hits.v])
        rows[:, ray] = u, v
        return Hits(prim, rows[0], rows[1], hits.distance)


def two_sided(caster: RayCaster, triangles: Array, number: Index) -> RayCaster:
    """Return a caster that tells apart `triangles` ``(K, 3, 3)`` back to back, of these numbers in it, if any are."""
    _, twin = find_twins(triangles)
    kept = np.flatnonzero(twin >= 0)
    twins = TwoSided(caster, triangles[kept], number[kept], np.searchsorted(kept, twin[kept]))
    return twins if len(kept) else caster


def lamp_triangles(parts: Sequence[Any]) -> tuple[Array, Index, Index]:
    """Return the corners ``(K, 3, 3)`` of emitting triangles, their numbers among all, and their parts, ``(K,)``."""
    starts = np.cumsum([0, *(len(part.mesh.faces) for part in parts)])
    lamps = [k for k, part in enumerate(parts) if part.light is not None]
    corners = [np.zeros((0, 3, 3)), *(parts[k].mesh.vertices[parts[k].mesh.faces] for k in lamps)]
    numbers = [np.zeros(0, np.int64), *(np.arange(starts[k], starts[k + 1]) for k in lamps)]
    return np.concatenate(corners), np.concatenate(numbers), np.repeat([0, *lamps], [len(n) for n in numbers])


def find_overlaps(caster: RayCaster, triangles: Array, reach: float) -> tuple[Index, Index]:
    """Return triangles of ``(T, 3, 3)`` and what `caster` has in their places: numbers of both, ``(K,)`` each.

    Rays go to points of each triangle from the side that it faces. What they meet within `reach` of the triangle
    counts, and the triangle itself does, too.
    """
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(cross, axis=1)
    index = np.flatnonzero(length > 0)
    normal = (cross[index] / length[index, None]).T
    found = [np.zeros((2, 0), np.int64)]
    for weights in PROBES:
        above = np.einsum("c,tcx->xt", weights / weights.sum(), triangles[index]) + 2 * reach * normal
        hits = caster.closest(above.astype(np.float32), -normal.astype(np.float32))
        inside = np.minimum(np.minimum(hits.u, hits.v), 1 - hits.u - hits.v) > MIN_BARYCENTRIC
        met = np.flatnonzero((hits.prim >= 0) & inside & (np.abs(hits.distance - 2 * reach) < reach))
        found.append(np.stack([index[met], hits.prim[met]]))
    first, second = np.concatenate(found, axis=1)
    count = int(second.max(initial=0)) + 1
    first, second = np.divmod(distinct(first * count + second), count)  # faster than np.unique of columns
    return first, second
