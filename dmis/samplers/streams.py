"""Samplers: uniform numbers for every (pixel, sample, dimension), as functions of (seed, pass, tile) only.

A tile has one random stream, so an image does not depend on how many threads, processes or machines rendered it, or in
which order.

All draws are two-dimensional. `Independent` numbers have no structure. The others spread the numbers of one pixel
evenly: `Stratified` over a jittered grid, `Sobol` over a (0, 2)-sequence with a random digit shift per pixel and
draw. `dmis.samplers.lowdiscrepancy` does as pbrt-v2's sampler of that name does.

Draws with different keys are independent of each other, because each key has its own order of the points. If sample i
had point i of the sequence in all of them, two draws would differ by their digit shifts alone: an integrand of both,
such as the light at a path's second surface, would be sampled in one plane of its four dimensions only, however many
samples there are. Orders of `Sobol` are nested (Owen 1995 scrambles digits so; Burley 2020 orders): the halves change
places at random, then the halves of each half, so that the first 2^k points are still 2^k neighbours in the sequence,
and as evenly spread. The camera's points are shuffled altogether, so that their order does not correlate with the
order in which samples are given to techniques.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np

from dmis.base.selection import Selection, size, take
from dmis.base.vectors import Array
from dmis.samplers.lowdiscrepancy import LowDiscrepancy, nested_order


def stream(seed: int, pass_: int, tile: int) -> np.random.Generator:
    """Return the random generator of one tile of one pass."""
    if seed < 2**32:
        sequence = np.random.SeedSequence([seed, pass_, tile])
    else:  # several words, which the list above would mix with the pass
        sequence = np.random.SeedSequence(seed, spawn_key=(pass_, tile))
    return np.random.Generator(np.random.SFC64(sequence))


class Sampler(Protocol):
    """Source of the uniform numbers of one tile."""

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """Begin a batch of camera samples: pixel, and number within the pixel, ``(N,)`` each."""
        ...

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """Return two uniform numbers in [0, 1) for each of N points, ``(2, N)`` float32.

        Parameters
        ----------
        key
            Name of the dimension, such as ``"camera"``; the same key continues the same sequence in a later batch.
        index
            Selection of camera samples from the batch; None selects all.
        number
            Index in its pixel's sequence for each number, ``(N,)``; None: the number of the camera sample.
        """
        ...


@runtime_checkable
class BlockSampler(Sampler, Protocol):
    """Sampler that keeps the samples which a camera sample has of one dimension together."""

    def draw_block(self, key: Hashable, index: Selection | None, sample: int, count: int) -> Array:
        """Return two uniform numbers in [0, 1) for each of N points, ``(2, N)`` float32.

        Parameters
        ----------
        key, index
            See `draw`.
        sample, count
            Which of how many samples of the dimension each camera sample has.
        """
        ...


class Independent:
    """Sampler of independent random numbers."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng, self._size = rng, 0

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `Sampler.start`."""
        self._size = len(pixel)

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `Sampler.draw`."""
        return self._rng.random((2, size(index, self._size)), dtype=np.float32)


class _Sequence:
    """Base of the samplers with a point sequence per pixel: the index in it that a sample uses."""

    def __init__(self, rng: np.random.Generator, pixels: int, stops: Sequence[int], shading_samples: int) -> None:
        self._rng, self._pixels, self._spp = rng, pixels, stops[-1]
        self._length = self._spp * shading_samples
        # shuffled between stops only: a pixel that stops early uses the beginning of the sequence
        self._camera = np.concatenate([a + rng.permutation(b - a) for a, b in itertools.pairwise((0, *stops))])
        self._pixel = self._number = np.empty(0, np.int64)
        self._orders: dict[Hashable, np.ndarray] = {}
        self._begins: dict[Hashable, np.ndarray] = {}

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `Sampler.start`."""
        self._pixel, self._number = pixel, number

    def _place(self, key: Hashable, index: Selection | None, number: np.ndarray | None) -> np.ndarray:
        """Return the index in its pixel's sequence for each selected sample, ``(N,)``."""
        if number is not None:
            return np.minimum(number, self._length - 1)
        sample_index = take(self._number, index)
        return self._camera.take(sample_index) if key == "camera" else sample_index


class Stratified(_Sequence):
    """Sampler of a jittered grid: n points fill ``floor(sqrt n)`` rows of equal columns; the rest are random.

    All pixels use the cells of a draw in one order, but each pixel starts it at a random cell. With one start for all,
    every pixel would combine the same cells of two draws, and the errors of their products would be correlated.
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
        u = self._rng.random((2, len(cell)), dtype=np.float32)
        inside = cell < rows * columns
        y, x = np.divmod(cell, columns)
        u[0] = np.where(inside, (u[0] + x) / np.float32(columns), u[0])
        u[1] = np.where(inside, (u[1] + y) / np.float32(rows), u[1])
        return np.minimum(u, np.float32(1 - 2**-24))


class Sobol(_Sequence):
    """Sampler of the first two Sobol dimensions, a (0, 2)-sequence, with a random digit shift per pixel and draw."""

    def __init__(self, rng: np.random.Generator, pixels: int, stops: Sequence[int], shading_samples: int) -> None:
        super().__init__(rng, pixels, stops, shading_samples)
        self._shifts: dict[Hashable, np.ndarray] = {}

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `Sampler.draw`."""
        bits = (self._length - 1).bit_length()
        if key not in self._orders:
            self._orders[key] = nested_order(self._rng, bits)
            self._begins[key] = self._rng.integers(2**bits, size=self._pixels, dtype=np.int32)
            self._shifts[key] = self._rng.integers(2**32, size=(2, self._pixels), dtype=np.uint32)
        pixel = take(self._pixel, index)
        point = self._orders[key].take(self._place(key, index, number) ^ self._begins[key].take(pixel))
        digits = _sobol(bits).take(point, axis=1) ^ self._shifts[key].take(pixel, axis=1)
        return (digits >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)


@lru_cache(maxsize=8)
def _sobol(bits: int) -> np.ndarray:
    """Return the first points of the two-dimensional Sobol sequence as 32-bit fractions, ``(2, 2^bits)``."""
    from scipy.stats import qmc  # imported here because scipy.stats takes most of a second

    points = qmc.Sobol(2, scramble=False, bits=32).random_base2(bits)
    return np.ascontiguousarray((points.T * 2**32).astype(np.uint32))


def _independent(rng: np.random.Generator, pixels: int, stops: Sequence[int], shading_samples: int) -> Sampler:
    return Independent(rng)


SamplerFactory = Callable[[np.random.Generator, int, Sequence[int], int], Sampler]
"""Makes the sampler of one tile from the arguments of `make_sampler` after the first."""
SAMPLERS: dict[str, SamplerFactory] = {
    "independent": _independent,
    "stratified": Stratified,
    "sobol": Sobol,
    "lowdiscrepancy": LowDiscrepancy,
}
"""By name; `register_sampler` adds to it."""


def register_sampler(name: str, factory: SamplerFactory) -> None:
    """Make a sampler known by its name: in `dmis.render`, `dmis.Settings`, rules and on the command line.

    Parameters
    ----------
    factory
        ``(rng, pixels, stops, shading_samples) -> Sampler``, such as a class; see `make_sampler` for the arguments.

    Raises
    ------
    ValueError
        If the name is not a word, or is that of another sampler, or `factory` cannot be called.
    """
    if not (isinstance(name, str) and name.isidentifier()):
        raise ValueError(f"a sampler's name must be a word of letters, digits and _; got {name!r}")
    if not callable(factory):
        raise ValueError(f"sampler {name} must be a class or function that makes it for a tile; got {factory!r}")
    if SAMPLERS.get(name, factory) is not factory:
        raise ValueError(f"there is a sampler {name!r} already; samplers are {', '.join(SAMPLERS)}")
    SAMPLERS[name] = factory


def make_sampler(
    kind: str, rng: np.random.Generator, pixels: int, stops: Sequence[int], shading_samples: int
) -> Sampler:
    """Return the sampler `kind` for one tile of `pixels`, whose numbers come from `rng`.

    Parameters
    ----------
    stops
        Numbers of camera samples after which some pixels stop, ascending; all stop at the last.
    shading_samples
        Shading samples per camera sample.

    Raises
    ------
    ValueError
        If the kind is not one of `SAMPLERS`.
    """
    if kind not in SAMPLERS:
        raise ValueError(f"sampler must be one of {', '.join(SAMPLERS)}; got {kind!r}")
    return SAMPLERS[kind](rng, pixels, stops, shading_samples)
