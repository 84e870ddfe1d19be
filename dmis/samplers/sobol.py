"""The sampler ``sobol``: one sequence of even points in the square, reordered for each pair of numbers.

**One sequence.** Point i has two coordinates, whose binary digits are sums modulo 2 of binary digits of i::

    u_0(i): digits of i in reverse (van der Corput)        u_1(i): digits of i times Pascal's triangle (Sobol)

The first 2^m points have exactly one in each rectangle of 2^-a by 2^-(m-a), for every a, and so has each later block of
2^m: this is a (0, 2)-sequence. The error of a smooth function's mean falls like 1/n, and that of an edge like n^-3/4,
where independent points have n^-1/2.

**An order for each pair.** A camera sample uses several pairs: its place in the pixel, a point on the light, a
direction of the BRDF, the direction in which a path goes on. If all of them were point i, they would be copies of each
other, and all pairs together would stay in a plane of their many dimensions, however many samples there are. So camera
sample i has point i for its place in the pixel, and point A(i) for the light, where A is a matrix over the binary
digits: bit j of A(i) is the parity of some bits of i. A is triangular (bit j depends on bits j, j + 1, ... alone), so
that the first 2^k indices stay the first 2^k, in another order, and each pair by itself keeps all of its evenness. A
was searched so that the pairs are even *together*, too, as points in four dimensions: see `COLUMNS`.

Pairs that are added up may share an order: those of all lights and techniques at one vertex, and the direction in which
the path goes on from there. Pairs whose numbers meet in one product must not: these are the pairs on one path, one
after the other. So the order is the number of pairs before, see `order_of`. If each camera sample takes n samples of a
technique, camera sample i has the n points i n, i n + 1, ... of that technique's sequence. Where n would be a fraction,
see `dmis.estimator.allocation.allocate`.

**A shift for each pixel and pair.** The digits of all points of a pixel and pair are XORed with one word (a digit
shift). It keeps the evenness, makes each point uniform, and pixels and pairs independent of each other. The word is an
integer hash of (seed, pixel, pair), so a number depends on (seed, pixel, pair, index) and on nothing else: neither on
tiles, nor on passes, nor on how many samples follow.

References: Sobol' 1967; Niederreiter, *Random Number Generation and Quasi-Monte Carlo Methods*, 1992, chapter 4 (nets
and t); Kollig and Keller, "Efficient Multidimensional Sampling", 2002 (digit shifts per pixel).
"""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache

import numpy as np

from dmis.base.vectors import Array, Selection, take
from dmis.samplers.pixel_block import CONTINUE, LENS, MORE, PICK, ROUNDING, PixelBlock

DIGITS = 24
"""Binary digits of a coordinate: as many as float32 has below 1."""
COLUMNS: dict[int, tuple[int, ...]] = {
    1: (1, 3, 4, 13, 18, 42, 79, 209, 454, 927, 1248, 2666, 4675, 10323, 17956, 50135),
    2: (1, 2, 5, 10, 16, 33, 100, 134, 452, 1023, 1339, 2704, 7879, 11794, 22365, 47299),
    3: (1, 3, 7, 14, 26, 55, 117, 222, 367, 878, 1944, 3453, 7335, 12196, 21838, 46404),
    4: (1, 3, 4, 12, 22, 45, 66, 186, 492, 737, 2015, 3011, 6888, 11690, 20928, 40435),
    5: (1, 3, 6, 9, 31, 39, 101, 184, 348, 724, 1944, 3858, 5901, 12371, 27368, 41682),
    6: (1, 2, 4, 13, 23, 61, 81, 173, 486, 878, 1956, 2833, 4926, 9955, 26592, 64726),
    LENS: (1, 3, 4, 13, 19, 36, 127, 165, 441, 560, 1862, 2977, 6049, 11987, 21458, 53324),
    ROUNDING: (1, 2, 4, 9, 22, 47, 97, 174, 306, 807, 1462, 2468, 4220, 14329, 29791, 64769),
}
"""Matrices by the number of their order: column c is the index A(2^c) of the point that sample 2^c takes.

Camera pair and light pair are a net in four dimensions with t = 0, 1, 1, 1, 2, 2, 2 for 2^1 ... 2^7 samples, and t = 3
up to 2^16: each box of volume 2^(t - m) has 2^t of the first 2^m points. Camera and lens pair have t = 0, 1, 1, 1, 2, 2
for 2^1 ... 2^6, then 3 up to 2^12, and 4 up to 2^16. `benchmarks/search_net.py` of commit 9db2350c searched
them. Further columns and matrices are pseudo-random.
"""
_OF_CAMERA = {(): 0, (LENS,): LENS}
"""Orders of the place in the pixel and on the lens: a path's pairs meet both in one product."""
PART = 12
"""Bits of an index that one table has the points of: 32 kB, which stay in the cache."""
LOW = 2**PART - 1
"""Mask of these bits."""
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
"""2^64 over the golden ratio: the step of SplitMix64."""


class Sobol:
    """Sampler of one (0, 2)-sequence in several orders, with a digit shift per pixel and pair."""

    sequence = True

    def __init__(self, block: PixelBlock) -> None:
        seed = np.random.SeedSequence(block.seed).generate_state(1, np.uint64)
        self._pixel_words = mix(seed + np.asarray(block.pixels).astype(np.uint64) * GOLDEN)
        self._shifts: dict[Hashable, np.ndarray] = {}
        self._pixels = len(block.pixels)
        self._pixel = self._number = np.empty(0, np.int64)

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `dmis.samplers.streams.Sampler.start`."""
        self._pixel = pixel
        self._number = number

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `dmis.samplers.streams.Sampler.draw`. Keys are tuples of whole numbers, or ``"camera"``."""
        pair = () if key == "camera" else key
        assert isinstance(pair, tuple)
        if pair not in self._shifts:
            self._shifts[pair] = shifts(mix(self._pixel_words + _word(pair)))
        i = take(self._number, index) if number is None else number
        return shifted_points(order_of(pair), i, self._shifts[pair], take(self._pixel, index))

    def draw_block(self, key: Hashable, index: Selection | None, sample: int, count: int) -> Array:
        """See `dmis.samplers.streams.BlockSampler.draw_block`."""
        return self.draw(key, index, None if count == 1 else take(self._number, index) * count + sample)

    def rounding_offsets(self, count: int) -> Array:
        """See `dmis.samplers.streams.RoundingSampler.rounding_offsets`."""
        self.start(np.arange(self._pixels), np.zeros(self._pixels, np.int64))
        return np.stack([self.draw((ROUNDING, k), None)[0] for k in range(count)])

    def rounding_order(self, number: np.ndarray) -> np.ndarray:
        """See `dmis.samplers.streams.RoundingSampler.rounding_order`."""
        return reordered(ROUNDING, number)


def shifts(words: np.ndarray) -> np.ndarray:
    """Return digit shifts of points, as `points` has their digits, of random `words` ``(N,)`` uint64."""
    return (words.view(np.uint32) >> np.uint32(32 - DIGITS)).view(np.uint64)


def shifted_points(order: int, i: np.ndarray, shift: np.ndarray, pixel: np.ndarray) -> Array:
    """Return points A(i) of an order in N pixels, whose digit shifts are `shift` ``(P,)``; ``(2, N)`` in [0, 1)."""
    bits = int(i.max(initial=0)).bit_length()
    # A(i) = A(low bits of i) XOR A(high bits of i), and so are the points
    digits = points(order, 0).take(i if bits <= PART else i & LOW, mode="wrap")
    for part in range(1, -(-bits // PART)):
        digits ^= points(order, part).take(i >> PART * part & LOW, mode="wrap")
    digits ^= take(shift, pixel)
    u = digits.view(np.int32).reshape(-1, 2).T.astype(np.float32, order="C")
    u *= np.float32(2**-DIGITS)
    return u


def order_of(pair: tuple[int, ...]) -> int:
    """Return the number of the order of a pair: how many pairs its path has before it, 0 for the camera's."""
    if pair in _OF_CAMERA:
        return _OF_CAMERA[pair]
    # a light is picked, and then a point of it: two pairs that meet
    return pair.count(CONTINUE) + pair.count(MORE) + (pair[-1] != CONTINUE) + (PICK in pair)


def reordered(order: int, i: np.ndarray) -> np.ndarray:
    """Return the indices A(i) of an order, ``(N,)`` whole numbers."""
    index = np.zeros_like(i)
    for c in range(int(i.max(initial=0)).bit_length()):
        index ^= (i >> c & 1) * _column(order, c)
    return index


@lru_cache(maxsize=256)
def points(order: int, part: int) -> np.ndarray:
    """Return the points ``A(i 2^(12 part))`` for i = 0 ... 4095, without shift: ``(4096,)`` uint64, two uint32 each."""
    table = np.zeros((1, 2), np.uint32)
    for c in range(PART * part, PART * (part + 1)):
        # A(i + 2^c) = A(i) XOR A(2^c) for i < 2^c
        table = np.concatenate([table, table ^ _point(_column(order, c))])
    return table.view(np.uint64)[:, 0]


def _column(order: int, c: int) -> int:
    """Return ``A(2^c)``, column c of the matrix of an order: bit c is set, and bits above it are not."""
    if order == 0:
        return 2**c
    columns = COLUMNS.get(order, ())
    return columns[c] if c < len(columns) else 2**c + int(_word((order, c))[0]) % 2**c


def _point(i: int) -> np.ndarray:
    """Return the digits of point i of the sequence, without shift, ``(2,)`` uint32."""
    van_der_corput = sobol = 0
    reversed_digit = pascal = 2 ** (DIGITS - 1)
    for j in range(DIGITS):
        if i >> j & 1:
            van_der_corput ^= reversed_digit
            sobol ^= pascal
        # column j + 1 of Pascal's triangle modulo 2 is column j plus itself, moved down by one
        reversed_digit >>= 1
        pascal ^= pascal >> 1
    return np.array([van_der_corput, sobol], np.uint32)


def mix(words: np.ndarray) -> np.ndarray:
    """Return a hash of each of the `words` ``(N,)`` uint64: the finaliser of SplitMix64 (Steele et al. 2014)."""
    words = (words ^ words >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    words = (words ^ words >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    return words ^ words >> np.uint64(31)


def _word(numbers: tuple[int, ...]) -> np.ndarray:
    """Return a hash of whole numbers, ``(1,)`` uint64."""
    word = np.zeros(1, np.uint64)
    for number in numbers:
        word = mix(word + GOLDEN + np.uint64(number % 2**64))
    return word
