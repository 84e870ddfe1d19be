"""Uniform numbers for every (pixel, sample, dimension), as functions of (seed, pass, tile) only.

A tile has one random stream, so an image does not depend on how many threads, processes or machines rendered it, or in
which order.

All draws are two-dimensional. `Independent` numbers are just random. The others spread the numbers of one pixel
evenly: `Stratified` over a jittered grid, `Sobol` over a (0, 2)-sequence with a random digit shift per pixel and
draw, as pbrt's low-discrepancy sampler does. Draws with different keys are independent of each other: the camera's
points are shuffled once per tile, so that their order matches nothing.
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
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence([seed, pass_, tile])))


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
        self._order = np.concatenate([a + rng.permutation(b - a) for a, b in itertools.pairwise((0, *stops))])
        self._pixel = self._number = np.empty(0, np.int64)
        self._state: dict[Hashable, np.ndarray] = {}

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `Sampler.start`."""
        self._pixel, self._number = pixel, number

    def _points(
        self, key: Hashable, index: Selection | None, number: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Position in the sequence and pixel of each point, ``(N,)``."""
        pixel = take(self._pixel, index)
        if number is not None:
            return np.minimum(number, self._length - 1), pixel
        own = take(self._number, index)
        return (self._order.take(own) if key == "camera" else own), pixel


class Stratified(_Sequence):
    """Jittered grid: n points fill ``floor(sqrt n)`` rows of equal columns; the few left over are random."""

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `Sampler.draw`."""
        point, _ = self._points(key, index, number)
        n = self._spp if number is None else self._length
        order = self._state.get(key)
        if order is None:  # which cell comes first differs from draw to draw, and is the same for the tile
            order = self._state[key] = self._rng.permutation(n)
        rows = int(np.sqrt(n))
        columns = n // rows
        cell = order.take(point)
        out = self._rng.random((2, len(point)), dtype=np.float32)
        inside = cell < rows * columns
        y, x = np.divmod(cell, columns)
        out[0] = np.where(inside, (out[0] + x) / np.float32(columns), out[0])
        out[1] = np.where(inside, (out[1] + y) / np.float32(rows), out[1])
        return np.minimum(out, np.float32(1 - 2**-24))


class Sobol(_Sequence):
    """The first two Sobol dimensions, a (0, 2)-sequence, with random digits per pixel and draw."""

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `Sampler.draw`."""
        point, pixel = self._points(key, index, number)
        shift = self._state.get(key)
        if shift is None:
            shift = self._state[key] = self._rng.integers(2**32, size=(2, self._pixels), dtype=np.uint32)
        digits = _sobol(self._length).take(point, axis=1) ^ shift.take(pixel, axis=1)
        return (digits >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)


@lru_cache(maxsize=8)
def _sobol(length: int) -> np.ndarray:
    """The first points of the two-dimensional Sobol sequence as 32-bit fractions, ``(2, length)``."""
    from scipy.stats import qmc  # imported here because scipy.stats takes most of a second

    bits = max(int(length - 1).bit_length(), 1)
    points = qmc.Sobol(2, scramble=False, bits=32).random_base2(bits)[:length]
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
