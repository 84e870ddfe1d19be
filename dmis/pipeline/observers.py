"""Observers: what is gathered from the camera samples of a tile while it is rendered, batch by batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmis.base.patches import COLOURS, PATCH, by_colour, patch_sum
from dmis.base.vectors import Array
from dmis.estimator.allocation import CameraSamples, SampleBlock
from dmis.estimator.mis import Collector, combiner_by_name
from dmis.estimator.records import Record, Statistic
from dmis.fit.round import Round
from dmis.samplers.streams import is_sequence
from dmis.variance.moments import Moments, PixelMoments, SubBlocks


def make_observers(round_: Round, shape: tuple[int, int]) -> Observers:
    """Return the observers of a round for a tile of `shape` (rows, columns): moments, statistic and collector."""
    pixels, settings = shape[0] * shape[1], round_.settings
    shading_samples = round_.spp * np.full(pixels, settings.shading_samples)
    statistic = None if round_.statistic is None else round_.statistic(pixels, settings.shading_samples)
    colour = np.zeros(shape, np.uint8)  # tiles begin at multiples of two
    for number, at in enumerate(COLOURS):
        colour[at] = number
    return Observers(
        shape,
        SubBlocks(round_.spp, pixels) if is_sequence(settings.sampler) else PixelMoments(pixels),
        statistic,
        combiner_by_name(settings.combiner).collector(round_.shares, shading_samples),
        settings.shading_samples,
        colour.reshape(-1) if getattr(statistic, "by_colour", False) else None,
    )


@dataclass(eq=False)
class Observers:
    """All that observes the P camera samples of a tile.

    Attributes
    ----------
    shape
        Rows and columns of the tile.
    pixel_moments
        Mean and variance of the pixels, for the image.
    statistic
        Statistic of the shading samples that a rule asked for; None: there is none.
    collector
        Sums from which a combiner corrects the pixels; None: it does not.
    shading_samples
        S of each camera sample by the settings of the round, which `Round.patterns` replace.
    colour
        Colour of each pixel, by which rays are counted for the statistic, ``(P,)``; None: they are not.
    """

    shape: tuple[int, int]
    pixel_moments: SubBlocks | PixelMoments
    statistic: Statistic | None
    collector: Collector | None
    shading_samples: int
    colour: np.ndarray | None

    def new_records(self) -> list[Record] | None:
        """Return an empty list for the shading samples of a batch, or None if nobody reads them."""
        return None if self.statistic is None and self.collector is None else []

    def colours(self, pixel: np.ndarray) -> np.ndarray | None:
        """Return the colours of camera samples, by which their rays are counted; None if they are not."""
        return None if self.colour is None else self.colour.take(pixel)

    def add(
        self, blocks: Sequence[SampleBlock], samples: CameraSamples, records: list[Record] | None, values: Array
    ) -> None:
        """Add the camera samples of one batch, their radiance ``(3, N)`` and their shading samples."""
        if self.collector is not None:
            first = np.broadcast_to(samples.counts.first, len(samples.pixel))
            self.collector.add(records or [], samples.pixel, first, self.shading_samples)
        values, ordered = samples.restore_order(values, records)
        if self.statistic is not None:
            self.statistic.add(ordered, values, blocks[0].count)
        # mean = sum_i L_i / n,  m2 = sum_i (L_i - mean)^2
        begin = 0
        for block in blocks:
            end = begin + block.count * len(block.pixels)
            of_block = values[:, begin:end].reshape(3, block.count, -1).swapaxes(0, 1)
            self.pixel_moments.add(of_block, block.pixels, block.first)
            begin = end

    def moments(self, camera_samples: int) -> Moments:
        """Return the moments of the pixels ``(3, P)``, corrected by the combiner; 0 if there were no samples."""
        if not camera_samples:
            return Moments(0, *np.zeros((2, 3, self.shape[0] * self.shape[1])))
        total = self.pixel_moments.total()
        correction = 0.0 if self.collector is None else self.collector.correction()
        return Moments(total.n, total.mean + correction, total.m2)

    def patch_sums(self) -> dict[str, Array]:
        """Return the sums of the statistic over patches of `PATCH` pixels, by name; none if there is no statistic."""
        sums = {} if self.statistic is None else self.statistic.sums()
        images = {name: a.reshape(*a.shape[:-1], *self.shape) for name, a in sums.items()}
        if self.colour is not None:
            images = {name: by_colour(image) for name, image in images.items()}
        return {name: patch_sum(image, PATCH) for name, image in images.items()}
