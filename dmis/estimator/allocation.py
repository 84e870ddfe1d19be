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
by its counts (`allocate`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dmis.base.vectors import Array, compose, distinct, take, take_optional
from dmis.estimator.records import Record
from dmis.estimator.settings import Settings
from dmis.samplers.streams import Numbers

if TYPE_CHECKING:
    from dmis.estimator.patterns import LightSubsets


def shares_of(weight: Array | float | Sequence[float]) -> Array:
    """Return the shares of all techniques, ``(K,)`` or ``(K, H, W)`` float32, from a rule's weight.

    A number or a map ``(H, W)`` is the share w of the first of two techniques, and becomes ``(w, 1 - w)``. An array
    ``(K,)`` or ``(K, H, W)`` has all shares already. This is the only place where the two forms meet.
    """
    shares = np.asarray(weight, np.float32)
    return shares if shares.ndim in (1, 3) else np.stack([shares, 1 - shares])


def whole_counts(shares: Array, shading_samples: int, random: bool = False) -> tuple[int, ...] | None:
    """Return how many of S shading samples each technique has, where that is the same for all camera samples.

    That is so where one share ``(K, 1)`` for all pixels makes whole numbers; picked at `random`, where it is 1.
    """
    if shares.shape[1] > 1 or (random and not (shares == 1).any()):
        return None
    all_but_last = [float(shading_samples * share) for share in shares[:-1, 0]]
    if not all(n.is_integer() for n in all_but_last):
        return None
    counts = [int(n) for n in all_but_last]
    return (*counts, shading_samples - sum(counts))


def systematic_counts(
    shares: Array, shading_samples: int, pixel: np.ndarray, number: np.ndarray, offset: Array
) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Divide the shading samples of N camera samples by systematic rounding.

    Parameters
    ----------
    shares
        Of K techniques, ``(K, P)`` for P pixels, or ``(K, 1)`` for all of them.
    shading_samples
        S, shading samples per camera sample.
    pixel, number
        Pixel of each camera sample, and number of the sample within it, ``(N,)``.
    offset
        Random offsets of the rounding in [0, 1), ``(K - 1, P)``.

    Returns
    -------
    counts
        How many go to each technique, K arrays ``(N,)`` int8.
    before
        How many of its pixel's shading samples went to each technique before this camera sample, ``(K, N)``.
    """
    counts: list[np.ndarray] = []
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
        # m_k = floor((n + l) w' + U) - floor(n w' + U): n samples before these l, w' = w_k / (w_k + ... + w_K)
        before, after = ((n * fraction + start).astype(np.int32) for n in (slot, slot + left))
        counts.append(after - before)
        samples_before.append(before)
        slot = slot - before
        left = left - counts[-1]
    return tuple(n.astype(np.int8) for n in (*counts, left)), np.stack([*samples_before, slot])


def random_counts(shares: Array, u: Array, pixel: np.ndarray) -> tuple[np.ndarray, ...]:
    """Divide the shading samples of N camera samples by `u` ``(S, N)``, each of which picks a technique."""
    bounds = (_of_samples(bound, pixel) for bound in itertools.accumulate(shares[:-1]))
    below = [(u < bound).sum(axis=0, dtype=np.int8) for bound in bounds]
    all_of_them = np.full(len(pixel), len(u), np.int8)
    return tuple(np.diff([*below, all_of_them], axis=0, prepend=np.int8(0)))


def _of_samples(of_pixels: Array, pixel: np.ndarray) -> Array:
    """Return the values of the camera samples' pixels, ``(N,)``; one value for all pixels stays one."""
    return of_pixels if of_pixels.size == 1 else of_pixels.take(pixel)


# Camera samples of a tile --------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SampleBlock:
    """Camera samples `first` to ``first + count`` of each of some `pixels` of a tile, sample-major.

    In arrays of their batch ``(..., N)`` they are the `columns`.
    """

    pixels: np.ndarray
    first: int
    count: int
    columns: slice


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
        How many shading samples go to each of the K techniques, an int or ``(N,)`` int8; falling for the first, so that
        those with the same number are a slice at the first surface, and nothing needs to be gathered.
    samples_before
        How many of its pixel's shading samples went to each technique before this camera sample, ``(K, N)``; None if
        the same number goes there every time, or at random, or no sampler asks for it.
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
    counts: tuple[np.ndarray | int, ...]
    samples_before: np.ndarray | None = None
    tilt: Array | None = None
    subsets: LightSubsets | None = None
    order: np.ndarray | None = None


def restore_order(order: np.ndarray | None, values: Array, records: Sequence[Record]) -> tuple[Array, Sequence[Record]]:
    """Return `values` ``(3, N)`` of camera samples in an `order`, and `records` of them, in that of the blocks."""
    if order is None:
        return values, records
    restored = np.empty_like(values)
    for restored_channel, channel in zip(restored, values, strict=True):
        restored_channel[order] = channel
    return restored, [replace(record, sample=compose(order, record.sample)) for record in records]


def allocate(
    batches: Iterable[Sequence[SampleBlock]],
    shares: Array,
    offsets: Array,
    settings: Settings,
    numbers: Numbers,
    spp: Array | int = 0,
    begin: Array | int = 0,
    tilt: Array | None = None,
    halvings: np.ndarray | None = None,
) -> Iterator[tuple[Sequence[SampleBlock], CameraSamples]]:
    """Yield `batches` of a tile with their camera samples, whose shading samples are divided between techniques.

    The camera samples of a batch are in the order of their counts for the first technique, falling; equal ones keep the
    order of the blocks.

    Parameters
    ----------
    shares, tilt
        Of K techniques, ``(K, P)``, or ``(K, 1)`` if those of all P pixels are the same; see `CameraSamples`.
    offsets
        Random offsets of the rounding in [0, 1), ``(K - 1, P)``.
    numbers
        Techniques that are picked at random, and the order of the rounding, come from here.
    spp, begin
        Camera samples of each pixel, and number of the first in its sequence, ``(P,)`` or one number each.
    halvings
        Of each light, ``(L + 1, P)``, see `dmis.estimator.patterns.PatternMap`; None: all samples sample all lights.
    """
    spp, begin = (np.broadcast_to(n, offsets.shape[1]) for n in (spp, begin))
    s, random = settings.shading_samples, settings.allocation == "random"
    whole = whole_counts(shares, s, random)
    n = s * shares.astype(float)
    keeps_order = (np.abs(n - np.rint(n)) < 1e-5).all(axis=0)
    for blocks in batches:
        pixel = np.concatenate([np.tile(block.pixels, block.count) for block in blocks])
        of_blocks = [np.arange(block.first, block.first + block.count).repeat(len(block.pixels)) for block in blocks]
        number = np.concatenate(of_blocks) + begin.take(pixel)
        counts: tuple[np.ndarray | int, ...] | None = whole
        before: np.ndarray | None = None
        order: np.ndarray | None = None
        if counts is None:
            if random:
                divided = random_counts(shares, numbers.techniques(s, len(pixel)), pixel)
            else:
                in_sequence = _sequence_numbers(keeps_order, numbers, pixel, number)
                divided, before = systematic_counts(shares, s, pixel, in_sequence, offsets)
            first = divided[0]
            # few different numbers: this takes less time than a stable sort
            order = np.concatenate([np.flatnonzero(first == n) for n in range(first.max(), first.min() - 1, -1)])
            pixel, number = pixel.take(order), number.take(order)
            counts = tuple(n.take(order) for n in divided)
            before = None if settings.sampler == "independent" else take_optional(before, order)
        subsets: LightSubsets | None = None
        if halvings is not None:
            from dmis.estimator.patterns import LightSubsets

            subsets = LightSubsets(halvings.take(pixel, axis=1), number - begin.take(pixel), spp.take(pixel))
        of_samples = take(shares, pixel), counts, before, take_optional(tilt, pixel)
        yield blocks, CameraSamples(pixel, number, *of_samples, subsets, order)


def _sequence_numbers(keeps_order: np.ndarray, numbers: Numbers, pixel: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Return the numbers of camera samples in the order in which their shading samples are divided, ``(N,)``.

    In the order of the points, regular counts would alias with the digits of the place in the pixel: at w = 1/2 and
    S = 1 all light samples would be in one half of it. Pixels whose counts need no rounding keep the order.
    """
    in_order = None if keeps_order.all() else numbers.rounding_order(number)
    return number if in_order is None else np.where(keeps_order.take(pixel, mode="clip"), number, in_order)


def sample_batches(spp: np.ndarray | int, pixels: np.ndarray, size: int) -> Iterator[list[SampleBlock]]:
    """Yield all camera samples of `pixels` ``(A,)`` in batches of nearly equal size, about `size`, as blocks.

    Each block has the same samples of all its pixels. With one number `spp` there is one block in a batch; otherwise,
    where `spp` is ``(A,)``, pixels drop out where their samples end, and blocks end there.
    """
    stops = [0, *distinct(spp).tolist()]
    active = [pixels[np.broadcast_to(spp, len(pixels)) >= stop] for stop in stops[1:]]
    begins = np.cumsum([0, *(np.diff(stops) * [len(a) for a in active])])
    edges = np.linspace(0, begins[-1], max(1, round(begins[-1] / size)) + 1)
    cuts = [
        np.rint(np.clip((edges - begin) / len(of), 0, stop - start)).astype(int) + start
        for begin, of, (start, stop) in zip(begins[:-1], active, itertools.pairwise(stops), strict=True)
    ]
    for k in range(len(edges) - 1):
        blocks: list[SampleBlock] = []
        end = 0
        for of, cut in zip(active, cuts, strict=True):
            if count := cut[k + 1] - cut[k]:
                begin, end = end, end + count * len(of)
                blocks.append(SampleBlock(of, cut[k], count, slice(begin, end)))
        if blocks:
            yield blocks
