"""Pieces of lights as one table: triangles, parallelograms, disks and spheres, any of which a sample or a ray may meet.

A thousand separate lights are a thousand calls for each batch of samples; as rows of one table they are one call.
Rays are tested by Embree against proxies: a triangle or parallelogram is its own; the square around a disk and the cube
around a sphere tell which pieces to test exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from dmis.base.color import LUMINANCE
from dmis.base.vectors import Array, Index, Selection, columns, distinct, dot, indices, take
from dmis.intersect import Intersector, RayCaster
from dmis.light.coincident import two_sided
from dmis.light.light_sample import (
    LightSample,
    flat_light_hit,
    flat_light_sample,
    intersect_plane,
    sphere_light_hit,
    sphere_light_sample,
)
from dmis.samplers.warp import INV_PI, square_to_disk, square_to_triangle

TRIANGLE, PARALLELOGRAM, DISK, SPHERE = range(4)
"""Shapes of pieces."""
_WARPS = {TRIANGLE: square_to_triangle, PARALLELOGRAM: lambda u: u, DISK: square_to_disk}
"""Maps of the unit square to coordinates along the edges of a flat piece."""
_CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_CUBE_FACES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]]
_CUBE_FACES += [[0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
_PROXIES = {
    TRIANGLE: np.array([[[0, 0], [1, 0], [0, 1]]], float),
    PARALLELOGRAM: np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float),
    DISK: np.array([[[-1, -1], [1, -1], [1, 1]], [[-1, -1], [1, 1], [-1, 1]]], float),
    SPHERE: _CUBE[_CUBE_FACES],
}
"""Corners of the triangles of a proxy, in coordinates along the edges of its piece."""
_MARGIN = 1 + 1e-3
"""Size of the proxies of disks and spheres, relative to these: rounding must not cut them."""
_STEP = np.float32(1 + 1e-5)
"""Where a ray goes on behind a proxy, relative to its distance."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """F emitting pieces.

    Attributes
    ----------
    shape
        One of the constants here, the same for all F, or ``(F,)`` of them.
    rows
        ``(12, F)`` float32: the corner, or the centre of a disk or sphere; two edges, or the half axes of a disk; the
        normal. Of a sphere, three half axes after the centre.
    area
        Area of one side, ``(F,)`` float64; that of the disk that a sphere covers.
    radiance
        ``(3, F)`` float32.
    two_sided
        Whether both sides emit, ``(F,)`` bool.
    light
        Number of the light that each piece belongs to, ``(F,)``.
    """

    shape: Array
    rows: Array
    area: Array
    radiance: Array
    two_sided: Array
    light: Array

    @classmethod
    def of(
        cls, shape: int, rows: Array, area: Array | float, radiance: Array, two_sided: Array | bool = False
    ) -> Pieces:
        """Return the pieces of one light, all of one `shape`; `radiance` is ``(3, 1)``."""
        count = rows.shape[1]
        return cls(
            np.full(count, shape),
            rows.astype(np.float32, copy=False),
            np.broadcast_to(np.asarray(area, float), count),
            np.broadcast_to(radiance, (3, count)),
            np.broadcast_to(two_sided, count),
            np.zeros(count, int),
        )

    @classmethod
    def joined(cls, lights: Sequence[Pieces]) -> Pieces:
        """Return the pieces of several lights, numbered in order."""
        table = {field.name: np.concatenate([getattr(p, field.name) for p in lights], axis=-1) for field in fields(cls)}
        return cls(**{**table, "light": np.repeat(np.arange(len(lights)), [len(p.area) for p in lights])})

    @cached_property
    def intensity(self) -> Array:
        """Luminance times area, the radiant intensity along the normal, ``(F,)`` float64."""
        return LUMINANCE @ self.radiance.astype(float) * self.area

    @cached_property
    def proxies(self) -> tuple[Array, Index]:
        """Corners of the triangles of all proxies, ``(T, 3, 3)`` float64, and the piece of each, ``(T,)``."""
        triangles = []
        owner = []
        for shape, proxy in _PROXIES.items():
            index = np.flatnonzero(self.shape == shape)
            axes = self.rows[3:, index].astype(float).reshape(3, 3, -1)[: proxy.shape[-1]]
            if shape in (DISK, SPHERE):
                axes = axes * _MARGIN
            triangles.append(np.einsum("tvk,kcf->ftvc", proxy, axes) + self.rows[:3, index].T[:, None, None])
            if shape == DISK:  # a ray meets the one of two back to back that faces it
                shift = self.rows[9:, index] * (1e-5 * np.sqrt(self.area[index]))
                triangles[-1] += shift.T[:, None, None]
            owner.append(np.repeat(index, len(proxy)))
        return np.concatenate([t.reshape(-1, 3, 3) for t in triangles]), np.concatenate(owner)

    @cached_property
    def _caster(self) -> RayCaster:
        triangles, _ = self.proxies
        caster = Intersector(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
        return two_sided(caster, triangles, np.arange(len(triangles)))

    @cached_property
    def _shapes(self) -> list[int]:
        """The shapes that pieces have."""
        return distinct(self.shape).tolist()

    @cached_property
    def _table(self) -> Array:
        """Rows, area and radiance of each piece, ``(F, 16)`` float32: one gather instead of several."""
        return np.concatenate([self.rows, [self.area], self.radiance]).T.astype(np.float32, order="C")

    def __getstate__(self) -> dict[str, object]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def _by_shape(self, piece: Index) -> Iterator[tuple[int, Selection | None]]:
        """Yield each shape among the pieces `piece` ``(N,)``, and which of them have it; None: all."""
        shape = self.shape.take(piece)
        for kind in self._shapes:
            index = indices(shape == kind)
            if index is None or len(index):
                yield kind, index

    def sample(self, piece: Index, p: Array, u: Array) -> LightSample:
        """Sample a direction from each of the points `p` ``(3, N)`` to the `piece` ``(N,)``, `u` ``(2, N)``."""
        rows = columns(self._table, piece)
        to = rows[:3] - p
        spheres = None
        for kind, index in self._by_shape(piece):
            if kind == SPHERE:
                centre = take(to, index).copy()
                radius2 = take(rows[12], index) * INV_PI
                spheres = index, sphere_light_sample(centre, radius2, take(u, index), take(rows[13:], index))
                continue
            a, b = _WARPS[kind](take(u, index))
            at = slice(None) if index is None else index
            to[:, at] += take(rows[3:6], index) * a + take(rows[6:9], index) * b
        sample = flat_light_sample(to, rows[9:12], rows[12], rows[13:])
        sample.emits |= self.two_sided.take(piece)
        return sample if spheres is None else _placed(sample, *spheres)

    def hit(self, p: Array, wi: Array) -> tuple[LightSample, Index, Index]:
        """Return what unit directions `wi` ``(3, N)`` from `p` ``(3, N)`` see of the pieces.

        Returns
        -------
        light_sample
            Its pdf is that of `sample` for the piece that is met.
        index, piece
            The directions that meet a piece, ``(K,)``, and which, the nearest one, ``(K,)``.
        """
        distance, piece = self._nearest(p, wi)
        index = np.flatnonzero(piece >= 0)
        piece = piece.take(index)
        p = take(p, index)
        w = take(wi, index)
        rows = columns(self._table, piece)
        met = np.ones(len(index), bool)
        sample = flat_light_hit(w, distance.take(index), dot(rows[9:12], w), met, rows[12], rows[13:])
        sample.emits |= self.two_sided.take(piece)
        for kind, of_kind in self._by_shape(piece):
            if kind == SPHERE:
                to = take(rows[:3] - p, of_kind)
                radius2 = take(rows[12], of_kind) * INV_PI
                _placed(sample, of_kind, sphere_light_hit(take(w, of_kind), to, radius2, take(rows[13:], of_kind)))
        n = wi.shape[1]
        distance, pdf = np.zeros((2, n), np.float32)
        none = LightSample(wi, distance, np.zeros((3, n), np.float32), pdf, np.zeros(n, bool))
        return _placed(none, index, sample), index, piece

    def _nearest(self, p: Array, wi: Array) -> tuple[Array, Index]:
        """Return the distance ``(N,)`` and the number ``(N,)``, or -1, of the first piece along each direction."""
        owner = self.proxies[1]
        rough = (self.shape == DISK) | (self.shape == SPHERE)
        nearest = np.full(wi.shape[1], np.inf, np.float32)
        met = np.full(wi.shape[1], -1)
        ray = np.arange(wi.shape[1])
        start = np.zeros(wi.shape[1], np.float32)
        while len(ray):
            w = take(wi, ray)
            hits = self._caster.closest(take(p, ray) + w * start, w)
            reach = start + hits.distance
            kept = np.flatnonzero((hits.prim >= 0) & (reach < nearest.take(ray)))
            ray = ray.take(kept)
            reach = reach.take(kept)
            piece = owner.take(hits.prim.take(kept))
            start = reach * _STEP + self._least_step
            again = np.flatnonzero(rough.take(piece))
            reach[again] = self._distance(piece.take(again), take(p, ray.take(again)), take(wi, ray.take(again)))
            closer = np.flatnonzero(reach < nearest.take(ray))
            nearest[ray.take(closer)] = reach.take(closer)
            met[ray.take(closer)] = piece.take(closer)
            ray = ray.take(again)
            start = start.take(again)
        return nearest, met

    @cached_property
    def _least_step(self) -> np.float32:
        return np.float32(1e-7 * np.abs(self.proxies[0]).max())

    def _distance(self, piece: Index, p: Array, wi: Array) -> Array:
        """Return the distance of disks and spheres along unit directions, infinite where they are missed, ``(N,)``."""
        rows = columns(self._table, piece)
        to = rows[:3] - p
        radius2 = rows[12] * INV_PI
        distance, _, q = intersect_plane(-to, wi, rows[9:12])
        is_hit = (distance > 0) & (dot(q, q) < radius2)
        sphere = self.shape.take(piece) == SPHERE
        if sphere.any():
            sample = sphere_light_hit(wi, to, radius2, rows[13:])
            distance = np.where(sphere, sample.distance, distance)
            is_hit = np.where(sphere, sample.emits, is_hit)
        return np.where(is_hit, distance, np.float32(np.inf))


def _placed(sample: LightSample, index: Selection | None, other: LightSample) -> LightSample:
    """Return light samples with those of `other` in the places `index`; None: all."""
    for field in fields(LightSample):
        values = getattr(sample, field.name)
        values[..., slice(None) if index is None else index] = getattr(other, field.name)
    return sample
