"""Uniform numbers for every (pixel, sample, dimension), as functions of (seed, pass, tile) only.

A tile has one random stream, so an image does not depend on how many threads, processes or machines rendered it, or in
which order.

All draws are two-dimensional. `Independent` numbers are just random. The others spread the numbers of one pixel
evenly: `Stratified` over a jittered grid, `Sobol` over a (0, 2)-sequence with a random digit shift per pixel and
draw, as pbrt's low-discrepancy sampler does.

Draws with different keys are independent of each other, because each key has its own order of the points. If sample i
had point i of the sequence in all of them, two draws would differ by their digit shifts alone: what depends on both,
such as a path's second surface, would be known on one plane of its four dimensions only, however many samples there
are. Orders of `Sobol` are nested (Owen 1995 scrambles digits so; Burley 2020 orders): halves change places at random,
and the halves of these, so that the first 2^k points are still 2^k neighbours in the sequence, and as even as they.
The camera's points are shuffled altogether, so that their order does not match in which samples techniques take turns.
"""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Sequence
from functools import lru_cache
from typing import Literal, Protocol

import numpy as np

from dmis.vec import Array, Selection, size, take

Kind = Literal["independent", "stratified", "sobol"]
KINDS = ("independent", "stratified", "sobol")


def stream(seed: int, pass_: int, tile: int) -> np.random.Generator:
    """The random stream of one tile of one pass."""
    if seed < 2**32:
        sequence = np.random.SeedSequence([seed, pass_, tile])
    else:  # several words, which in a list would be taken for the pass
        sequence = np.random.SeedSequence(seed, spawn_key=(pass_, tile))
    return np.random.Generator(np.random.SFC64(sequence))


class Sampler(Protocol):
    """Numbers for one tile."""

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """Begin a batch of camera samples: pixel, and number within the pixel, ``(N,)`` each."""
        ...

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """Two uniform numbers in [0, 1) for each of N points, ``(2, N)`` float32.

        Parameters
        ----------
        key
            What the numbers are for; the same key continues the same sequence in a later block.
        index
            Which camera samples of the batch; None: all of them.
        number
            Which point of its pixel's sequence each one takes, ``(N,)``; None: its sample's own number.
        """
        ...


class Independent:
    """Random numbers with no structure."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng, self._size = rng, 0

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `Sampler.start`."""
        self._size = len(pixel)

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `Sampler.draw`."""
        return self._rng.random((2, size(index, self._size)), dtype=np.float32)


class _Sequence:
    """What sampler with a sequence per pixel share: which point of it a sample takes."""

    def __init__(self, rng: np.random.Generator, pixels: int, stops: Sequence[int], shading_samples: int) -> None:
        self._rng, self._pixels, self._spp = rng, pixels, stops[-1]
        self._length = self._spp * shading_samples
        # shuffled between stops only: a pixel that stops early has the beginning of the sequence
        self._camera = np.concatenate([a + rng.permutation(b - a) for a, b in itertools.pairwise((0, *stops))])
        self._pixel = self._number = np.empty(0, np.int64)
        self._orders: dict[Hashable, np.ndarray] = {}
        self._begins: dict[Hashable, np.ndarray] = {}

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `Sampler.start`."""
        self._pixel, self._number = pixel, number

    def _place(self, key: Hashable, index: Selection | None, number: np.ndarray | None) -> np.ndarray:
        """Which point of its pixel's sequence each one takes, ``(N,)``."""
        if number is not None:
            return np.minimum(number, self._length - 1)
        own = take(self._number, index)
        return self._camera.take(own) if key == "camera" else own


class Stratified(_Sequence):
    """Jittered grid: n points fill ``floor(sqrt n)`` rows of equal columns; the few left over are random.

    Pixels take the cells of a draw in one order, each from a beginning of its own: were that the same, too, which cell
    of one draw comes with which of another would be the same in all pixels, and so would the errors of their products.
    """

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `Sampler.draw`."""
        n = self._spp if number is None else self._length
        if key not in self._orders:
            self._orders[key] = self._rng.permutation(n)
            self._begins[key] = self._rng.integers(n, size=self._pixels)
        rows = int(np.sqrt(n))
        columns = n // rows
        begin = self._begins[key].take(take(self._pixel, index))
        cell = self._orders[key].take(self._place(key, index, number) + begin, mode="wrap")
        out = self._rng.random((2, len(cell)), dtype=np.float32)
        inside = cell < rows * columns
        y, x = np.divmod(cell, columns)
        out[0] = np.where(inside, (out[0] + x) / np.float32(columns), out[0])
        out[1] = np.where(inside, (out[1] + y) / np.float32(rows), out[1])
        return np.minimum(out, np.float32(1 - 2**-24))


class Sobol(_Sequence):
    """The first two Sobol dimensions, a (0, 2)-sequence, with random digits per pixel and draw."""

    def __init__(self, rng: np.random.Generator, pixels: int, stops: Sequence[int], shading_samples: int) -> None:
        super().__init__(rng, pixels, stops, shading_samples)
        self._shifts: dict[Hashable, np.ndarray] = {}

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `Sampler.draw`."""
        bits = (self._length - 1).bit_length()
        if key not in self._orders:
            self._orders[key] = _nested(self._rng, bits)
            self._begins[key] = self._rng.integers(2**bits, size=self._pixels, dtype=np.int32)
            self._shifts[key] = self._rng.integers(2**32, size=(2, self._pixels), dtype=np.uint32)
        pixel = take(self._pixel, index)
        point = self._orders[key].take(self._place(key, index, number) ^ self._begins[key].take(pixel))
        digits = _sobol(bits).take(point, axis=1) ^ self._shifts[key].take(pixel, axis=1)
        return (digits >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)


def _nested(rng: np.random.Generator, bits: int) -> np.ndarray:
    """A random order of the first ``2^bits`` numbers in which every aligned block of 2^k of them stays together."""
    order = np.zeros(1, np.int32)
    for _ in range(bits):
        flip = rng.integers(2, size=len(order), dtype=np.int32)
        order = np.stack([2 * order + flip, 2 * order + (1 - flip)], axis=1).reshape(-1)
    return order


@lru_cache(maxsize=8)
def _sobol(bits: int) -> np.ndarray:
    """The first points of the two-dimensional Sobol sequence as 32-bit fractions, ``(2, 2^bits)``."""
    from scipy.stats import qmc  # imported here because scipy.stats takes most of a second

    points = qmc.Sobol(2, scramble=False, bits=32).random_base2(bits)
    return np.ascontiguousarray((points.T * 2**32).astype(np.uint32))


def make_sampler(
    kind: Kind, rng: np.random.Generator, pixels: int, stops: Sequence[int], shading_samples: int
) -> Independent | Stratified | Sobol:
    """The sampler `kind` for one tile of `pixels`, whose numbers come from `rng`.

    Parameters
    ----------
    stops
        Numbers of camera samples after which some pixels, and at the last all, have enough; ascending.
    shading_samples
        Of each camera sample.

    Raises
    ------
    ValueError
        If the kind is not one of `KINDS`.
    """
    if kind == "independent":
        return Independent(rng)
    if kind == "stratified":
        return Stratified(rng, pixels, stops, shading_samples)
    if kind == "sobol":
        return Sobol(rng, pixels, stops, shading_samples)
    raise ValueError(f"sampler must be one of {', '.join(KINDS)}; got {kind!r}")
