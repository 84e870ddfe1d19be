"""The sampler ``lowdiscrepancy``: padded, shuffled (0, 2)-sequences, as pbrt-v2's sampler of that name.

M. Pharr and G. Humphreys, *Physically Based Rendering*, 2nd edition, Section 7.4. Each dimension of each pixel (the
camera sample, light and BRDF samples of each light, the continuation of a path) has a sequence of its own,

    u_0(i) = reversed bits of i (van der Corput) XOR s_0,    u_1(i) = Sobol' second dimension XOR s_1,

with random 32-bit words s_0, s_1. N camera samples with n samples each use its first 2^a 2^b points, where 2^a and 2^b
are the least powers of two that are not below N and n: 2^a blocks of 2^b neighbouring points, a block for each camera
sample. The blocks are shuffled, and so are the points of each block. From the third bounce of a path on numbers are
random, as in pbrt-v2.

Counts that are not powers of two: pbrt-v2 takes more samples, here N camera samples use the first N of the 2^a shuffled
blocks, and n samples the first n of the 2^b shuffled points. These are random subsets of even points, less even than a
power of two.

pbrt-v2 has the same n for all camera samples. Where a rule's shares make n differ, the samples of a technique in a
pixel are neighbours in its sequence instead, in a nested order (`nested_order`), so that every beginning is even.

This sampler belongs to the reproduction of the thesis, which was made with pbrt-v2: it must not change.
"""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np

from dmis.base.vectors import Array, Selection, size, take
from dmis.samplers.pixel_block import CONTINUE, PixelBlock
from dmis.samplers.sobol import shifted_points, shifts

BOUNCES = 3
"""Vertices of a path that have sequences; later ones have random numbers. pbrt-v2's SAMPLE_DEPTH."""
INNER_ORDERS = 2**10
"""Orders of the points of a block that a tile draws for each dimension; its blocks pick among them."""


class LowDiscrepancy:
    """Sampler of the pixels of one tile."""

    def __init__(self, block: PixelBlock) -> None:
        self._rng = block.rng
        self._pixels = len(block.pixels)
        self._length = block.stops[-1] * block.shading_samples
        self._bits = _bits(block.stops[-1])
        self._pixel = self._number = np.empty(0, np.int64)
        self._words: dict[Hashable, tuple[np.ndarray, np.ndarray]] = {}
        self._orders: dict[Hashable, np.ndarray] = {}
        self._inner_orders: dict[Hashable, np.ndarray] = {}

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `dmis.samplers.streams.Sampler.start`."""
        self._pixel = pixel
        self._number = number

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `dmis.samplers.streams.Sampler.draw`."""
        if number is None:
            return self.draw_block(key, index, 0, 1)
        if _bounce(key) >= BOUNCES:
            return self._random(index)
        bits = _bits(self._length)
        if key not in self._orders:
            self._orders[key] = nested_order(self._rng, bits)
        pixel = take(self._pixel, index)
        shift, begin = self._words_of(key)
        place = np.minimum(number, self._length - 1) ^ (begin.take(pixel) & np.uint32(2**bits - 1))
        return shifted_points(0, self._orders[key].take(place), shift, pixel)

    def draw_block(self, key: Hashable, index: Selection | None, sample: int, count: int) -> Array:
        """See `dmis.samplers.streams.BlockSampler.draw_block`."""
        if _bounce(key) >= BOUNCES:
            return self._random(index)
        bits = _bits(count)
        if key not in self._orders:
            self._orders[key] = _permutations(self._rng, self._pixels, self._bits)
            self._inner_orders[key] = _permutations(self._rng, INNER_ORDERS, bits)
        pixel = take(self._pixel, index)
        shift, begin = self._words_of(key)
        point = self._orders[key].take((pixel << self._bits) + take(self._number, index))
        if bits:
            row = (point + begin.take(pixel)) % INNER_ORDERS
            point = (point.astype(np.int64) << bits) + self._inner_orders[key].take((row << bits) + sample)
        return shifted_points(0, point, shift, pixel)

    def _random(self, index: Selection | None) -> Array:
        return self._rng.random((2, size(index, len(self._pixel))), dtype=np.float32)

    def _words_of(self, key: Hashable) -> tuple[np.ndarray, np.ndarray]:
        """Return s_0 and s_1 of each pixel, as `shifts` has them, and a random word for its orders, ``(P,)`` each."""
        if key not in self._words:
            words = self._rng.integers(2**32, size=(3, self._pixels), dtype=np.uint32)
            self._words[key] = shifts(words[:2].T.copy().view(np.uint64)[:, 0]), words[2]
        return self._words[key]


def _permutations(rng: np.random.Generator, rows: int, bits: int) -> np.ndarray:
    """Return random orders of ``2^bits`` numbers, ``(rows, 2^bits)``."""
    numbers = np.arange(2**bits, dtype=np.min_scalar_type(2**bits - 1))
    return rng.permuted(np.tile(numbers, (rows, 1)), axis=1)


def nested_order(rng: np.random.Generator, bits: int) -> np.ndarray:
    """Return a random order of ``2^bits`` numbers in which each aligned block of 2^k numbers stays together."""
    order = np.zeros(1, np.int32)
    for _ in range(bits):
        flip = rng.integers(2, size=len(order), dtype=np.int32)
        order = np.stack([2 * order + flip, 2 * order + (1 - flip)], axis=1).reshape(-1)
    return order


def _bounce(key: Hashable) -> int:
    """Return the number of bounces before the vertex that a key belongs to; the first vertex has 0."""
    if not isinstance(key, tuple):
        return 0
    return key.count(CONTINUE) - (key[-1] == CONTINUE)


def _bits(count: int) -> int:
    """Return the least k with ``2^k >= count``."""
    return (count - 1).bit_length()
