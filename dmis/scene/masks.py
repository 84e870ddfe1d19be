"""Masks: holes that images cut into surfaces, such as the outlines of leaves, for all kinds of rays alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base.validate import number
from dmis.base.vectors import Array, Index
from dmis.brdf.texture import Image, check_values
from dmis.intersect import Hits, HoleCaster, RayCaster


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


def see_through(caster: RayCaster, parts: Sequence[Any], uv: Callable[[Index], Array], step: float) -> RayCaster:
    """Return a caster whose rays pass the holes of `parts`, begun `step` behind them; `caster` if there is no mask.

    `uv` returns the texture coordinates of triangles as columns ``(6, N)``, see `dmis.scene.triangle_tables.Tables`.
    """
    masks = list({id(part.mask): part.mask for part in parts if part.mask is not None}.values())
    if not masks:
        return caster
    uv(np.empty(0, np.int64))  # makes the table before threads ask for it
    numbers = [-1 if part.mask is None else masks.index(part.mask) for part in parts]
    of_triangle = np.repeat([*numbers, -1], [*(len(part.mesh.faces) for part in parts), 1])  # the last one of a miss

    def holes(hits: Hits, direction: Array) -> Index:
        mask_of, holes_of_masks = of_triangle.take(hits.prim), [np.empty(0, np.int64)]
        for k, mask in enumerate(masks):
            index = np.flatnonzero(mask_of == k)
            part = hits.take(index)
            rows = uv(part.prim)
            place = rows[2:4] * part.u + rows[4:6] * part.v + rows[:2]
            holes_of_masks.append(index[mask.is_hole(place, part, direction[:, index])])
        return np.concatenate(holes_of_masks)

    return HoleCaster(caster, holes, step)
