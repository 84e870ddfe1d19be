"""Camera samples of a tile: cut into batches that stay in the cache, and ordered by their allocation to techniques."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmis.base.vectors import Array, compose
from dmis.estimator.allocation import Counts, allocate
from dmis.estimator.records import Record
from dmis.estimator.settings import Settings
from dmis.samplers.streams import RoundingSampler, Sampler


@dataclass(frozen=True, eq=False)
class SampleBlock:
    """Camera samples `first` to ``first + count`` of each of some `pixels` of a tile."""

    pixels: np.ndarray
    first: int
    count: int

    def camera_samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the pixel of each camera sample and its number within the pixel, sample-major."""
        numbers = np.arange(self.first, self.first + self.count)
        return np.tile(self.pixels, self.count), np.repeat(numbers, len(self.pixels))


@dataclass(frozen=True, eq=False)
class CameraSamples:
    """N camera samples of one batch and the allocation of their shading samples.

    Attributes
    ----------
    pixel, number
        Pixel of each camera sample in the tile, and its number in the sequence of the pixel, ``(N,)``.
    counts
        Shading samples of each technique, descending for the first technique, as `dmis.estimator.batch.Batch` needs.
    order
        Positions of the camera samples in the blocks, ``(N,)``; None: the order of the blocks.
    """

    pixel: np.ndarray
    number: np.ndarray
    counts: Counts
    order: np.ndarray | None

    def restore_order(self, values: Array, records: Sequence[Record] | None) -> tuple[Array, Sequence[Record]]:
        """Return `values` ``(3, N)`` of the camera samples, and `records` of them, in the order of the blocks."""
        records = records or []
        if self.order is None:
            return values, records
        restored = np.empty_like(values)
        for restored_channel, channel in zip(restored, values, strict=True):
            restored_channel[self.order] = channel
        return restored, [replace(record, sample=compose(self.order, record.sample)) for record in records]


class SampleAllocation:
    """Divides the shading samples of a tile's camera samples between techniques, see `dmis.estimator.allocation`.

    Parameters
    ----------
    shares
        Of K techniques, ``(K, P)``, or ``(K, 1)`` if those of all pixels are the same.
    begin
        Number of the first camera sample of each pixel in its sequence, ``(P,)`` or one number.
    pixels
        P, number of pixels of the tile.
    rng
        Source of the offsets, and of techniques that are picked at random.
    sampler
        Sampler of the tile; a `RoundingSampler` makes the offsets.
    """

    def __init__(
        self,
        shares: Array,
        begin: Array | int,
        pixels: int,
        settings: Settings,
        rng: np.random.Generator,
        sampler: Sampler,
    ) -> None:
        self._shares, self._begin, self._shading_samples = shares, begin, settings.shading_samples
        self._offset, self._whole = rng.random((len(shares) - 1, pixels)), None
        self._reordered: Callable[[np.ndarray], np.ndarray] = np.asarray
        if isinstance(sampler, RoundingSampler):
            # numbers of the pixels, and not of the tile
            self._offset = sampler.rounding_offsets(len(self._offset)).astype(float)
            self._reordered = sampler.rounding_order
            counts = self._shading_samples * shares.astype(float)
            self._whole = (np.abs(counts - np.rint(counts)) < 1e-5).all(axis=0)
        self._random_allocation = rng if settings.allocation == "random" else None
        self._track_sequence = settings.sampler != "independent"

    def camera_samples(self, blocks: Sequence[SampleBlock]) -> CameraSamples:
        """Return the camera samples of `blocks` in the order of their counts for the first technique, descending."""
        pixel, number = (
            np.concatenate(arrays) for arrays in zip(*(block.camera_samples() for block in blocks), strict=True)
        )
        number = number + (self._begin if isinstance(self._begin, int) else self._begin.take(pixel))
        counts = allocate(
            self._shares,
            self._shading_samples,
            pixel,
            self._sequence_numbers(pixel, number),
            self._offset,
            self._random_allocation,
            self._track_sequence,
        )
        if isinstance(counts.first, int):
            return CameraSamples(pixel, number, counts, None)
        order = descending_order(counts.first)
        return CameraSamples(pixel.take(order), number.take(order), counts.take(order), order)

    def _sequence_numbers(self, pixel: np.ndarray, number: np.ndarray) -> np.ndarray:
        """Return the numbers of camera samples in the order in which their shading samples are divided, ``(N,)``.

        In the order of the points, regular counts would alias with the digits of the place in the pixel: at w = 1/2 and
        S = 1 all light samples would be in one half of it. Pixels whose counts need no rounding keep the order.
        """
        if self._whole is None or self._whole.all():
            return number
        order = self._reordered(number)
        return order if not self._whole.any() else np.where(self._whole.take(pixel, mode="clip"), number, order)


def descending_order(counts: np.ndarray) -> np.ndarray:
    """Return the stable order that sorts whole numbers `counts` ``(N,)`` of a small range from the largest down."""
    return np.concatenate([np.flatnonzero(counts == n) for n in range(counts.max(), counts.min() - 1, -1)])


def sample_batches(spp: np.ndarray | int, pixels: np.ndarray, size: int) -> Iterator[list[SampleBlock]]:
    """Yield all camera samples of `pixels` ``(A,)`` in batches of nearly equal size, about `size`, as blocks.

    Each block has the same samples of all its pixels. With one number `spp` there is one block in a batch; otherwise,
    where `spp` is ``(A,)``, pixels drop out where their samples end, and blocks end there.
    """
    stops = [0, *np.unique(spp).tolist()]
    active = [pixels[np.broadcast_to(spp, len(pixels)) >= stop] for stop in stops[1:]]
    begins = np.cumsum([0, *(np.diff(stops) * [len(a) for a in active])])
    edges = np.linspace(0, begins[-1], max(1, round(begins[-1] / size)) + 1)
    cuts = [
        np.rint(np.clip((edges - begin) / len(of), 0, stop - start)).astype(int) + start
        for begin, of, (start, stop) in zip(begins[:-1], active, itertools.pairwise(stops), strict=True)
    ]
    for k in range(len(edges) - 1):
        blocks = [SampleBlock(of, cut[k], cut[k + 1] - cut[k]) for of, cut in zip(active, cuts, strict=True)]
        if blocks := [block for block in blocks if block.count]:
            yield blocks
