"""Triangles of lights that lie in one plane and overlap: twins, reverse twins, lamps on walls.

Every triangle of a light emits on the side that it faces, whatever else lies in the same place, and where several face
the same side their radiances add up. A ray caster reports only one of the triangles that a ray meets at the same
distance, and which one is arbitrary. So emission there is decided by geometry: `Coincident` lists, for each triangle
that a ray may meet, the emitting triangles that overlap it, and tells which of them contain a hit.

Search (`find_coincident`): pairs of boxes around positions and normals by halving both sets, surface by surface, then
the planes' distance, then the separating axis theorem in the plane.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base.selection import Index
from dmis.base.vectors import Array

MAX_GAP = 1e-6
"""Largest distance of one triangle's corners from the other's plane, in largest coordinates: float32 rounds these."""
MIN_OVERLAP = 1e-4
"""Least overlap along each axis, in widths of the smaller triangle; neighbours overlap by rounding."""
_MAX_NORMAL_DIFFERENCE = 1e-3
"""Largest difference of unit normals in the search. The planes' distance is the stricter test."""
_PAIRS_PER_BLOCK = 2**14
"""Pairs of boxes that are compared at a time."""


@dataclass(frozen=True, eq=False)
class Coincident:
    """For each of T triangles, the emitting triangles that overlap it in its plane: P ordered pairs.

    Attributes
    ----------
    count, first
        How many pairs a triangle has, and its first one, ``(T + 1,)``; the last entry is that of misses, whose triangle
        number is -1.
    triangle, other
        The triangle that a ray meets and the emitting one, ``(P,)``, ordered by `triangle`.
    same
        Whether they face the same side, ``(P,)`` bool.
    mapping
        From the barycentrics (u, v) on `triangle` to those on `other`: ``(c + a u + b v)`` twice, rows
        c, a, b, c', a', b', ``(6, P)`` float32.
    """

    count: Index
    first: Index
    triangle: Index
    other: Index
    same: Array
    mapping: Array

    def at(self, prim: Index, u: Array, v: Array) -> tuple[Index, Index]:
        """Return the pairs whose emitting triangle contains the hits: numbers of hits and of pairs, ``(K,)`` each.

        Parameters
        ----------
        prim, u, v
            Triangle numbers (-1: a miss) and barycentrics of N hits.
        """
        count = self.count.take(prim)
        hit = np.repeat(np.arange(len(prim)), count)
        pair = np.arange(len(hit)) + np.repeat(self.first.take(prim) - (np.cumsum(count) - count), count)
        c, a, b, c2, a2, b2 = self.mapping.take(pair, axis=1)
        u, v = u.take(hit), v.take(hit)
        s, t = c + a * u + b * v, c2 + a2 * u + b2 * v
        inside = np.flatnonzero((s >= 0) & (t >= 0) & (s + t <= 1))
        return hit.take(inside), pair.take(inside)


def find_coincident(triangles: Array, emitting: Index | None = None, owner: Index | None = None) -> Coincident | None:
    """Return the emitting triangles that overlap others in one plane; None if there are none.

    Parameters
    ----------
    triangles
        Corners, ``(T, 3, 3)`` float64.
    emitting
        Numbers of those that emit; None: all.
    owner
        Number of the surface that a triangle is of, ``(T,)``: triangles of one surface are known not to overlap. Of
        triangles with a negative number nothing is known. None: nothing is known of any.
    """
    edges = triangles[:, 1:] - triangles[:, :1]
    cross = np.cross(edges[:, 0], edges[:, 1])
    twice = np.linalg.norm(cross, axis=1)
    normal = cross / np.maximum(twice, 1e-300)[:, None]
    reach = np.abs(triangles).max(axis=(1, 2)) * MAX_GAP
    # |n| is the same for both windings, and steady where a sign is not
    margin = np.concatenate(
        [np.repeat(reach[:, None], 3, axis=1), np.full((len(normal), 3), _MAX_NORMAL_DIFFERENCE / 2)], axis=1
    )
    low = np.concatenate([triangles.min(axis=1), np.abs(normal)], axis=1) - margin
    high = np.concatenate([triangles.max(axis=1), np.abs(normal)], axis=1) + margin
    whole = np.flatnonzero(twice > 0)
    owner = np.full(len(triangles), -1) if owner is None else owner
    sources = whole if emitting is None else emitting[twice[emitting] > 0]
    found = []
    for i, j in _boxes_that_meet(low, high, whole, sources, owner):
        gap = np.maximum(reach[i], reach[j])
        # one in the plane of the other: that of a sliver is uncertain, and may be far away at the other's corners
        near = _within(triangles[i], triangles[j], normal[j], gap) | _within(triangles[j], triangles[i], normal[i], gap)
        i, j = i[near], j[near]
        mapping = _mapping(triangles[i], edges[i], triangles[j], edges[j], cross[j])
        over = _overlap(mapping)
        same = np.einsum("kc,kc->k", normal[i[over]], normal[j[over]]) > 0
        found.append((i[over], j[over], same, mapping[over]))
    triangle, other, same, mapping = (
        (np.concatenate(a) for a in zip(*found, strict=True)) if found else [np.zeros(0)] * 4
    )
    if not len(triangle):
        return None
    order = np.lexsort((other, triangle))
    count = np.bincount(triangle, minlength=len(triangles) + 1)
    rows = np.ascontiguousarray(mapping[order].reshape(-1, 6).T, np.float32)
    return Coincident(count, np.cumsum(count) - count, triangle[order], other[order], same[order], rows)


def coincident_lights(parts: Sequence[Any]) -> tuple[Coincident, Array] | None:
    """Return the overlaps of lights with all triangles of a scene, and the radiance of each pair's light ``(3, P)``.

    Parameters
    ----------
    parts
        See `dmis.scene.groups.Part`; those without a light do not emit.

    Returns
    -------
    None if no emitting triangle overlaps another triangle.
    """
    bounds = [part.mesh.bounds for part in parts if part.light is not None]
    if not bounds:
        return None
    low, high = np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)
    reach = MAX_GAP * max(np.abs(low).max(), np.abs(high).max())
    low, high = low - reach, high + reach
    kept = []  # corners, triangle numbers, part numbers, owners: of triangles that may meet a light
    start = 0
    surfaces: dict[int, int] = {}  # without overlaps: of analytic lights, and of meshes that were searched before
    for k, (light, mesh) in enumerate((part.light, part.mesh) for part in parts):
        owner = -1
        if light is not None and light.overlaps is None:
            owner = surfaces.setdefault(id(light), len(surfaces))
        if (mesh.bounds[0] <= high).all() and (mesh.bounds[1] >= low).all():
            corners = mesh.vertices[mesh.faces]
            index = np.flatnonzero(((corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)).all(axis=1))
            kept.append((corners[index], index + start, np.full(len(index), k), np.full(len(index), owner)))
        start += len(mesh.faces)
    corners, number, of_part, owners = (np.concatenate(a) for a in zip(*kept, strict=True))
    emits = np.array([part.light is not None for part in parts])
    found = find_coincident(corners, np.flatnonzero(emits[of_part]), owners)
    if found is None:
        return None
    emitting = [parts[k].light for k in np.unique(of_part[found.other])]
    if textured := [type(light).__name__ for light in emitting if light.textured]:
        raise ValueError(
            f"a textured light must not lie in one plane with another triangle that it overlaps; got a {textured[0]}. "
            f"Move one of them by a little"
        )
    anywhere = np.zeros((3, 1), np.float32)
    lights = [None if part.light is None or part.light.textured else part.light for part in parts]
    table = np.array([np.zeros(3) if light is None else light.emission(anywhere)[:, 0] for light in lights], np.float32)
    radiance = np.ascontiguousarray(table[of_part[found.other]].T)
    triangle, other = number[found.triangle], number[found.other]
    count = np.bincount(triangle, minlength=start + 1)
    return Coincident(count, np.cumsum(count) - count, triangle, other, found.same, found.mapping), radiance


def _boxes_that_meet(
    low: Array, high: Array, first: Index, second: Index, owner: Index
) -> Iterator[tuple[Index, Index]]:
    """Yield pairs of one of `first` and one of `second` whose boxes meet, of different owners."""
    groups = ([index[owner[index] == k] for k in np.unique(owner[index])] for index in (first, second))
    pending = list(itertools.product(*groups))  # each pair has one owner on either side
    while pending:
        a, b = pending.pop()
        if owner[a[0]] == owner[b[0]] >= 0:
            continue
        a = _meet_box_around(low, high, a, b)
        b = _meet_box_around(low, high, b, a)
        if not len(a) or not len(b):
            continue
        if len(a) * len(b) <= _PAIRS_PER_BLOCK:
            meet = np.ones((len(a), len(b)), bool)
            for axis in range(low.shape[1]):
                meet &= (low[a, axis, None] <= high[b, axis]) & (high[a, axis, None] >= low[b, axis])
            i, j = np.nonzero(meet)
            i, j = a[i], b[j]
            others = i != j
            if others.any():
                yield i[others], j[others]
            continue
        split = a if len(a) >= len(b) else b
        centre = low[split] + high[split]
        axis = int(np.argmax(np.ptp(centre, axis=0) / np.mean(high[split] - low[split], axis=0)))
        order = split[np.argsort(centre[:, axis], kind="stable")]
        halves = order[: len(order) // 2], order[len(order) // 2 :]
        pending += [(half, b) for half in halves] if split is a else [(a, half) for half in halves]


def _meet_box_around(low: Array, high: Array, index: Index, others: Index) -> Index:
    """Return those of `index` whose boxes meet the box around all of the `others`; none if there are no others."""
    if not len(others):
        return index[:0]
    least, most = low[others].min(axis=0), high[others].max(axis=0)
    for axis in range(low.shape[1]):
        index = index[(low[index, axis] <= most[axis]) & (high[index, axis] >= least[axis])]
    return index


def _within(corners: Array, plane: Array, normal: Array, gap: Array) -> Array:
    """Return whether all corners of triangles ``(K, 3, 3)`` are at most `gap` from the planes of others, ``(K,)``."""
    near = np.ones(len(corners), bool)
    for k in range(3):
        near &= np.abs(np.einsum("kc,kc->k", corners[:, k] - plane[:, 0], normal)) <= gap
    return near


def _mapping(corners: Array, edges: Array, others: Array, other_edges: Array, cross: Array) -> Array:
    """Return the maps from barycentrics on triangles to those on others in the same planes, ``(K, 2, 3)``.

    The last axis is the constant, the factor of u and the factor of v; `cross` is that of the other triangles' edges.
    """
    # barycentrics of x on (q, f_1, f_2) are g_i . (x - q) with the dual vectors, g_i . f_k = 1 if i = k else 0:
    # g_1 = f_2 x N / |N|^2,  g_2 = N x f_1 / |N|^2,  N = f_1 x f_2
    scaled = cross / np.einsum("kc,kc->k", cross, cross)[:, None]
    dual = np.stack([np.cross(other_edges[:, 1], scaled), np.cross(scaled, other_edges[:, 0])], axis=1)
    columns = np.concatenate([corners[:, :1] - others[:, :1], edges], axis=1)
    return np.asarray(np.einsum("kic,kmc->kim", dual, columns))


def _overlap(mapping: Array) -> Array:
    """Return whether ((0, 0), (1, 0), (0, 1)) and its images overlap, ``(K,)`` bool, by the separating axis theorem."""
    (c, a, b), (c2, a2, b2) = mapping.transpose(1, 2, 0)
    x, y = (c, c + a, c + b), (c2, c2 + a2, c2 + b2)
    one, zero = np.ones_like(c), np.zeros_like(c)
    axes = [(one, zero), (zero, one), (one, one)]
    axes += [(y[k - 1] - y[k], x[k] - x[k - 1]) for k in range(3)]  # across each edge of the image
    over = np.ones(len(mapping), bool)
    for s, t in axes:
        low, high = np.minimum(np.minimum(s, t), 0), np.maximum(np.maximum(s, t), 0)
        p, q, r = (s * x[k] + t * y[k] for k in range(3))
        least, most = np.minimum(np.minimum(p, q), r), np.maximum(np.maximum(p, q), r)
        depth = np.minimum(high, most) - np.maximum(low, least)
        over &= depth > MIN_OVERLAP * np.minimum(high - low, most - least)
    return over
