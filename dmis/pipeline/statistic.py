"""The statistic of a tile: what a rule gathers from the shading samples of a round, summed over patches of pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from dmis.base.patches import PATCH, by_colour, patch_sum, pixels_apart
from dmis.base.plugins import checked, guarded, is_shipped
from dmis.base.vectors import Array
from dmis.estimator.allocation import SampleBlock, values_of_blocks
from dmis.estimator.records import PIXEL_SUMS, Record, Statistic, Wants, wants_of
from dmis.fit.round import Round


class TileStatistic:
    """The statistic of a round, made for the pixels of a tile that have samples.

    Parameters
    ----------
    round_
        The round of the tile's P pixels, which has a statistic.
    shape
        Rows and columns of the tile.

    Attributes
    ----------
    wants
        What the statistic wants.
    pixel_sums
        Closest hits, occlusion rays, and squared samples of each pixel, ``(3, P)``, those of halved lights left out;
        None: the statistic does not want them.
    """

    def __init__(self, round_: Round, shape: tuple[int, int]) -> None:
        self._shape = shape
        self._observed = np.flatnonzero(np.broadcast_to(round_.spp, math.prod(shape)))
        assert round_.statistic is not None
        # without the shading samples of `Round.patterns`
        statistic = guarded("", round_.statistic)(len(self._observed), round_.settings.shading_samples)
        self._statistic: Statistic = checked(statistic, {"add": None, "sums": None}, in_place=True)
        self.wants = wants_of(self._statistic)
        self.pixel_sums = np.zeros((3, math.prod(shape))) if self.wants.pixel_sums else None

    def add(self, blocks: Sequence[SampleBlock], values: Array, records: Sequence[Record]) -> None:
        """Add the radiance ``(3, N)`` of the camera samples of one batch, and the records of their shading samples."""
        self._statistic.add(records, values, blocks[0].count)
        if self.pixel_sums is not None:
            for block, of_block in values_of_blocks(blocks, values):
                squares = np.square(of_block).mean(axis=0)
                self.pixel_sums[2, block.pixels] += squares.sum(axis=0, dtype=np.float64)

    def sums(self) -> dict[str, Array]:
        """Return the sums of the statistic over the patches, and the rays of their pixels if it wants them.

        A ValueError unless sums of a statistic that is not shipped are finite, one for each pixel with samples.
        """
        sums = dict(self._statistic.sums())
        count = len(self._observed)
        if not is_shipped(type(self._statistic)):
            for name, values in sums.items():
                if np.shape(values)[-1:] != (count,) or not np.isfinite(values).all():
                    must = f"of shape (..., {count}) and finite, one for each pixel"
                    call = f"{type(self._statistic).__name__}.sums"
                    raise ValueError(f"{call}: {name} must be {must}; got shape {np.shape(values)}")
        if count < math.prod(self._shape):
            sums = {name: self._spread(values) for name, values in sums.items()}
        if self.pixel_sums is not None:
            sums |= dict(zip(PIXEL_SUMS, self.pixel_sums, strict=True))
        return patch_sums(sums, self._shape, self.wants)

    def _spread(self, values: Array) -> Array:
        """Return values of the pixels with samples in their places, 0 elsewhere, ``(..., P)``."""
        spread = np.zeros((*values.shape[:-1], math.prod(self._shape)), values.dtype)
        spread[..., self._observed] = values
        return spread


def patch_sums(sums: Mapping[str, Array], shape: tuple[int, int], wants: Wants) -> dict[str, Array]:
    """Return sums of pixels ``(..., P)``, by name, over the patches of an area, as a statistic wants them."""
    images = {name: a.reshape(*a.shape[:-1], *shape) for name, a in sums.items()}
    if wants.sums == "pixels":
        return {name: pixels_apart(image) for name, image in images.items()}
    if wants.sums == "colours":
        images = {name: by_colour(image) for name, image in images.items()}
    return {name: patch_sum(image, PATCH) for name, image in images.items()}
