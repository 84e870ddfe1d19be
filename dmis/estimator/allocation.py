"""Camera samples of a tile, and the division of their shading samples between techniques.

A camera sample carries S shading samples. A share ``w`` of a pixel's ``n = S spp`` shading samples goes to the first
technique (light sampling), ``1 - w`` to the second (BRDF sampling). K techniques have shares ``w_1 .. w_K`` of sum 1,
a point of the simplex. Everywhere below a rule's fit they are an array ``(K, ...)``, see `shares_of`.

The shares are rounded to whole samples systematically, with a random offset per pixel: slot ``i`` goes to the first
technique where ``floor((i+1) w + xi) > floor(i w + xi)``. At w = 1/2 and S = 2 that is exactly one sample of each
technique per camera sample. Of more than two techniques, those behind the first divide what it leaves in the same way,
each with another random offset. For teaching, each shading sample may pick its technique at random instead.

Estimates are divided by the nominal shares, not by the realised counts: every slot belongs to the first
technique with probability w over the offset, whatever its neighbours do, so the estimate is unbiased even where a
technique's count happens to be 0.

The camera samples of a tile are cut into batches that stay in the cache (`sample_batches`), and each batch is ordered
by its counts (`SampleAllocation`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmis.base.vectors import Array, compose, take, take_optional
from dmis.estimator.patterns import LightSubsets
from dmis.estimator.records import Record
from dmis.estimator.settings import Settings
from dmis.samplers.streams import Numbers


def shares_of(weight: Array | float | Sequence[float]) -> Array:
    """Return the shares of all techniques, ``(K,)`` or ``(K, H, W)`` float32, from a rule's weight.

    A number or a map ``(H, W)`` is the share w of the first of two techniques, and becomes ``(w, 1 - w)``. An array
    ``(K,)`` or ``(K, H, W)`` has all shares already. This is the only place where the two forms meet.
    """
    shares = np.asarray(weight, np.float32)
    return shares if shares.ndim in (1, 3) else np.stack([shares, 1 - shares])


@dataclass(frozen=True, eq=False)
class Counts:
    """Numbers of shading samples of each technique, for each camera sample.

    Attributes
    ----------
    of_technique
        How many go to each of the K techniques: ``(N,)`` int8, or one int for all camera samples.
    samples_before
        How many of its pixel's shading samples went to each technique before this camera sample, ``(K, N)``; None if
        the same number goes there every time, or at random, or if it was not tracked.
    """

    of_technique: tuple[np.ndarray | int, ...]
    samples_before: np.ndarray | None = None

    @property
    def first(self) -> np.ndarray | int:
        """Number of samples of the first technique."""
        return self.of_technique[0]

    def of_every_camera_sample(self, technique: int) -> int | None:
        """See `dmis.samplers.streams.Places`."""
        count = self.of_technique[technique]
        return count if isinstance(count, int) else None

    def before(self, technique: int) -> Array | None:
        """See `dmis.samplers.streams.Places`."""
        return None if self.samples_before is None else self.samples_before[technique]

    def take(self, index: np.ndarray) -> Counts:
        """Return the counts of the camera samples `index`."""
        samples_before = None if self.samples_before is None else self.samples_before.take(index, axis=1)
        return Counts(tuple(n if isinstance(n, int) else n.take(index) for n in self.of_technique), samples_before)


def allocate(
    shares: Array,
    shading_samples: int,
    pixel: np.ndarray,
    number: np.ndarray,
    offset: Array,
    at_random: Numbers | None,
    track_sequence: bool = True,
) -> Counts:
    """Divide the shading samples of N camera samples.

    Parameters
    ----------
    shares
        Of K techniques, ``(K, P)`` for P pixels, or ``(K, 1)`` for all of them.
    shading_samples
        S, shading samples per camera sample.
    pixel, number
        Pixel of each camera sample, and number of the sample within it, ``(N,)``.
    offset
        Random offsets of the systematic rounding in [0, 1), ``(K - 1, P)``.
    at_random
        None for systematic rounding; otherwise each shading sample picks its technique at random (the one-sample
        model of MIS), with numbers from here.
    track_sequence
        Whether to count `Counts.samples_before`, which independent numbers do without.
    """
    if shares.shape[1] == 1 and (at_random is None or (shares == 1).any()):
        all_but_last = [float(shading_samples * share) for share in shares[:-1, 0]]
        if all(n.is_integer() for n in all_but_last):
            equal = [int(n) for n in all_but_last]
            return Counts((*equal, shading_samples - sum(equal)))
    if at_random is not None:
        return _random_counts(shares, at_random.techniques(shading_samples, len(pixel)), pixel)
    of_technique: list[np.ndarray] = []
    samples_before: list[np.ndarray] = []
    slot = number * shading_samples
    left = np.asarray(shading_samples)
    for k, (share, of_pixel) in enumerate(zip(shares[:-1], offset, strict=True)):
        fraction = share.astype(np.float64)  # of what the techniques before it have left
        if k:
            rest = shares[k:].sum(axis=0, dtype=np.float64)
            fraction = np.divide(fraction, rest, out=np.zeros_like(rest), where=rest > 0)
        fraction = _of_samples(fraction, pixel)
        start = of_pixel.take(pixel)
        before, after = ((n * fraction + start).astype(np.int32) for n in (slot, slot + left))  # rounded down
        of_technique.append(after - before)
        samples_before.append(before)
        slot = slot - before
        left = left - of_technique[-1]
    counts = tuple(n.astype(np.int8) for n in (*of_technique, left))
    return Counts(counts, np.stack([*samples_before, slot]) if track_sequence else None)


def _of_samples(of_pixels: Array, pixel: np.ndarray) -> Array:
    """Return the values of the camera samples' pixels, ``(N,)``; one value for all pixels stays one."""
    return of_pixels if of_pixels.size == 1 else of_pixels.take(pixel)


def _random_counts(shares: Array, u: Array, pixel: np.ndarray) -> Counts:
    """Return the counts of N camera samples, each of whose shading samples picks its technique by a number of u."""
    bounds = (_of_samples(bound, pixel) for bound in itertools.accumulate(shares[:-1]))
    below = [(u < bound).sum(axis=0, dtype=np.int8) for bound in bounds]
    all_of_them = np.full(len(pixel), len(u), np.int8)
    return Counts(tuple(np.diff([*below, all_of_them], axis=0, prepend=np.int8(0))))


# Camera samples of a tile --------------------------------------------------------------------------------------------


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


def values_of_blocks(blocks: Sequence[SampleBlock], values: Array) -> Iterator[tuple[SampleBlock, Array]]:
    """Yield each block and the `values` ``(..., N)`` of its camera samples, ``(..., count, A)``."""
    begin = 0
    for block in blocks:
        end = begin + block.count * len(block.pixels)
        yield block, values[..., begin:end].reshape(*values.shape[:-1], block.count, -1)
        begin = end


@dataclass(frozen=True, eq=False)
class CameraSamples:
    """N camera samples of one batch, and how their shading samples are divided.

    Attributes
    ----------
    pixel, number
        Pixel of each camera sample in the tile, and its number in the sequence of the pixel, ``(N,)``.
    shares
        Shares w_k of the K techniques, ``(K, N)``, or ``(K, 1)`` if those of all camera samples are the same.
    counts
        How many shading samples go to each technique; falling for the first, so that those with the same number are a
        slice at the first surface, and nothing needs to be gathered.
    tilt
        Shares t_k of the balance heuristic, shaped like `shares`; None: the heuristic uses `shares`.
    subsets
        Which of them sample each light at the first surface; None: all of them sample all lights.
    order
        Positions of the camera samples in the blocks, ``(N,)``; None: the order of the blocks.
    """

    pixel: np.ndarray
    number: np.ndarray
    shares: Array
    counts: Counts
    tilt: Array | None = None
    subsets: LightSubsets | None = None
    order: np.ndarray | None = None

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
    shares, tilt
        Of K techniques, ``(K, P)``, or ``(K, 1)`` if those of all P pixels are the same; see `CameraSamples`.
    pixels
        P, number of pixels of the tile.
    numbers
        Offsets of roundings, and techniques that are picked at random, come from here.
    spp, begin
        Camera samples of each pixel, and number of the first in its sequence, ``(P,)`` or one number each.
    halvings
        Of each light, ``(L + 1, P)``, see `dmis.estimator.patterns.PatternMap`; None: all samples sample all lights.
    """

    def __init__(
        self,
        shares: Array,
        pixels: int,
        settings: Settings,
        numbers: Numbers,
        *,
        spp: Array | int = 0,
        begin: Array | int = 0,
        tilt: Array | None = None,
        halvings: np.ndarray | None = None,
    ) -> None:
        self._shares, self._tilt = shares, tilt
        self._spp, self._begin = np.broadcast_to(spp, pixels), np.broadcast_to(begin, pixels)
        self._halvings = halvings
        self._settings, self._numbers = settings, numbers
        self._offset = numbers.rounding_offsets(len(shares) - 1, pixels)
        counts = settings.shading_samples * shares.astype(float)
        self._keeps_order = (np.abs(counts - np.rint(counts)) < 1e-5).all(axis=0)

    def camera_samples(self, blocks: Sequence[SampleBlock]) -> CameraSamples:
        """Return the camera samples of `blocks` in the order of their counts for the first technique, descending."""
        pixel, number = (
            np.concatenate(arrays) for arrays in zip(*(block.camera_samples() for block in blocks), strict=True)
        )
        number = number + self._begin.take(pixel)
        settings = self._settings
        counts = allocate(
            self._shares,
            settings.shading_samples,
            pixel,
            self._sequence_numbers(pixel, number),
            self._offset,
            self._numbers if settings.allocation == "random" else None,
            settings.sampler != "independent",
        )
        order = None
        first = counts.first
        if not isinstance(first, int):
            # few different numbers: this takes less time than a stable sort
            order = np.concatenate([np.flatnonzero(first == n) for n in range(first.max(), first.min() - 1, -1)])
            pixel, number, counts = pixel.take(order), number.take(order), counts.take(order)
        shares, tilt = take(self._shares, pixel), take_optional(self._tilt, pixel)
        return CameraSamples(pixel, number, shares, counts, tilt, self._subsets(pixel, number), order)

    def _subsets(self, pixel: np.ndarray, number: np.ndarray) -> LightSubsets | None:
        """Return which of the camera samples sample each light; None if all sample all lights."""
        if self._halvings is None:
            return None
        within_round = number - self._begin.take(pixel)
        return LightSubsets(self._halvings.take(pixel, axis=1), within_round, self._spp.take(pixel))

    def _sequence_numbers(self, pixel: np.ndarray, number: np.ndarray) -> np.ndarray:
        """Return the numbers of camera samples in the order in which their shading samples are divided, ``(N,)``.

        In the order of the points, regular counts would alias with the digits of the place in the pixel: at w = 1/2 and
        S = 1 all light samples would be in one half of it. Pixels whose counts need no rounding keep the order.
        """
        in_order = None if self._keeps_order.all() else self._numbers.rounding_order(number)
        return number if in_order is None else np.where(self._keeps_order.take(pixel, mode="clip"), number, in_order)


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
