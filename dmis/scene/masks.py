"""Masks: holes that images cut into surfaces, such as the outlines of leaves, for all kinds of rays alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base.validate import number
from dmis.base.vectors import Array, Index
from dmis.brdf.texture import Image, check_values
from dmis.intersect import Hits, RayCaster

MAX_HOLES = 1000
"""Most holes in surfaces that one ray passes."""
ROUNDING = 2.0**-23
"""Rounding of a position on a ray, over the largest coordinate of the ray's origin and the distance from it."""


@dataclass(frozen=True, eq=False)
class Mask:
    """Where a surface is there, and where rays pass.

    Parameters
    ----------
    image
        One channel, from 0 to 1, looked up at the texture coordinates.
    cutoff
        Value from which on the surface is there, above 0, at most 1. None: the value is the probability that it is
        there for a ray, drawn from the bits of the ray and of the point, so that half of the light passes at 1/2.

    A ValueError if the image has three channels, or a number is out of its range.
    """

    image: Image
    cutoff: float | None = 0.5

    def __post_init__(self) -> None:
        if not isinstance(self.image, Image):
            raise ValueError(f"image of a mask must be an Image; got {self.image!r}. Write Mask(Image(...))")
        check_values("image of a mask", self.image, "from 0 to 1, of one channel", "it is a share", 0, 1, rgb=False)
        if self.cutoff is not None:
            number("cutoff of a mask", self.cutoff, 1e-9, 1)

    def is_hole(self, uv: Array, hits: Hits, direction: Array) -> np.ndarray:
        """Return whether rays along `direction` ``(3, N)`` pass at `hits`, at `uv` ``(2, N)``; ``(N,)`` bool."""
        value = self.image(uv)[0]
        return value < self.cutoff if self.cutoff is not None else value <= _chance(hits, direction)


def _chance(hits: Hits, direction: Array) -> Array:
    """Return numbers in [0, 1) that look random, ``(N,)``, hashed from triangles, barycentrics and directions."""
    mixed = hits.prim.astype(np.uint32)
    for values in (hits.u, hits.v, *direction):
        mixed = (mixed ^ np.ascontiguousarray(values, np.float32).view(np.uint32)) * np.uint32(0x9E3779B1)
        mixed ^= mixed >> np.uint32(15)
    return ((mixed * np.uint32(0x85EBCA6B)) >> np.uint32(8)) * np.float32(2**-24)


class MaskedCaster:
    """Ray caster whose rays pass the holes of `parts`; rays that meet none cost nothing more.

    A ray that meets a hole is traced once more by `solid`, over the triangles without a mask, so that it meets what is
    behind the hole, however close. Masks behind the hole are met by rays over all triangles, by `caster`, that begin
    behind it by the rounding of positions.

    `uv` returns the texture coordinates of triangles as columns ``(6, N)``, see `dmis.scene.shading_points.Surfaces`.
    """

    def __init__(self, caster: RayCaster, solid: RayCaster, parts: Sequence[Any], uv: Callable[[Index], Array]) -> None:
        self._caster = caster
        self._solid = solid
        self._uv = uv
        self._masks = list({id(part.mask): part.mask for part in parts if part.mask is not None}.values())
        numbers = [-1 if part.mask is None else self._masks.index(part.mask) for part in parts]
        # the last one is that of a miss
        self._mask_of = np.repeat([*numbers, -1], [*(len(part.mesh.faces) for part in parts), 1])
        uv(np.empty(0, np.int64))  # makes the table before threads ask for it

    def closest(self, origin: Array, direction: Array) -> Hits:
        """See `Intersector.closest`; behind `MAX_HOLES` holes a ray meets only triangles without a mask."""
        hits = self._caster.closest(origin, direction)
        ray = self._holes(hits, direction)
        if len(ray):
            hits.replace(ray, self._pass_holes(hits.take(ray), origin[:, ray], direction[:, ray]))
        return hits

    def occluded(self, origin: Array, direction: Array, distance: Array) -> np.ndarray:
        """See `Intersector.occluded`; only rays that meet something are traced again."""
        blocked = self._caster.occluded(origin, direction, distance)
        ray = np.flatnonzero(blocked)
        if len(ray):
            hits = self.closest(origin[:, ray], direction[:, ray])
            blocked[ray] = (hits.prim >= 0) & (hits.distance < distance[ray])
        return blocked

    def _pass_holes(self, hole: Hits, origin: Array, direction: Array) -> Hits:
        """Return what rays that meet holes, `hole` ``(N,)``, meet behind them."""
        hits = self._solid.closest(origin, direction)
        grain = np.float32(ROUNDING) * np.abs(origin).max(axis=0)
        ray = np.arange(len(grain))
        for _ in range(MAX_HOLES):
            start = hole.distance * np.float32(1 + ROUNDING) + grain[ray]
            index = np.flatnonzero(start < hits.distance[ray])
            ray, hole, start = ray[index], hole.take(index), start[index]
            if not len(ray):
                break
            along = direction[:, ray]
            beyond = self._caster.closest(origin[:, ray] + along * start, along)
            beyond.distance = beyond.distance + start
            is_hole = beyond.prim == hole.prim  # met again, because positions are rounded
            is_hole[self._holes(beyond, along)] = True
            nearer = (beyond.prim >= 0) & (beyond.distance < hits.distance[ray])
            surface, index = np.flatnonzero(nearer & ~is_hole), np.flatnonzero(nearer & is_hole)
            hits.replace(ray[surface], beyond.take(surface))
            ray, hole = ray[index], beyond.take(index)
        return hits

    def _holes(self, hits: Hits, direction: Array) -> Index:
        """Return the numbers of the rays along `direction` that met a hole."""
        mask_of = self._mask_of.take(hits.prim)
        holes = [np.empty(0, np.int64)]
        for k, mask in enumerate(self._masks):
            index = np.flatnonzero(mask_of == k)
            part = hits.take(index)
            rows = self._uv(part.prim)
            place = rows[2:4] * part.u + rows[4:6] * part.v + rows[:2]
            holes.append(index[mask.is_hole(place, part, direction[:, index])])
        return np.concatenate(holes)
