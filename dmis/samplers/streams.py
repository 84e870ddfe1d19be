"""Samplers: uniform numbers for every (pixel, sample, dimension), as functions of (seed, pass, tile) only.

A tile has one random stream, so an image does not depend on how many threads, processes or machines rendered it, or in
which order. Numbers of `sobol` are functions of (seed, pixel, sample, dimension), and do not even depend on passes and
tiles.

All draws are two-dimensional. `Independent` numbers have no structure. The others spread the numbers of one pixel
evenly: `Stratified` over a jittered grid, `dmis.samplers.sobol` over the points of a (0, 2)-sequence, so that pairs are
even together too. `dmis.samplers.lowdiscrepancy` does as pbrt-v2's sampler of that name does.

Draws with different keys must have different orders of the points, unless they are only ever added up. If sample i had
point i of the sequence in all of them, an integrand of two draws, such as the light at a path's second surface, would
be sampled in one plane of its four dimensions only, however many samples there are.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable
from typing import Protocol, runtime_checkable

import numpy as np

from dmis.base.vectors import Array, Selection, size, take
from dmis.samplers.lowdiscrepancy import LowDiscrepancy
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.sobol import Sobol


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


@runtime_checkable
class RoundingSampler(Sampler, Protocol):
    """Sampler that spreads the rounding of shares to whole samples over its points, too."""

    def rounding_offsets(self, count: int) -> Array:
        """Return `count` uniform offsets of systematic rounding for each pixel, ``(count, P)``."""
        ...

    def rounding_order(self, number: np.ndarray) -> np.ndarray:
        """Return the numbers of camera samples in the order in which their shading samples are divided, ``(N,)``."""
        ...


class Independent:
    """Sampler of independent random numbers."""

    def __init__(self, block: PixelBlock) -> None:
        self._rng, self._size = block.rng, 0

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `Sampler.start`."""
        self._size = len(pixel)

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `Sampler.draw`."""
        return self._rng.random((2, size(index, self._size)), dtype=np.float32)


class Stratified:
    """Sampler of a jittered grid: n points fill ``floor(sqrt n)`` rows of equal columns; the rest are random.

    All pixels use the cells of a draw in one order, but each pixel starts it at a random cell. With one start for all,
    every pixel would combine the same cells of two draws, and the errors of their products would be correlated.
    """

    def __init__(self, block: PixelBlock) -> None:
        self._rng, self._pixels, self._spp = block.rng, len(block.pixels), block.stops[-1]
        self._length = self._spp * block.shading_samples
        # shuffled between stops only: a pixel that stops early uses the beginning of the sequence
        steps = itertools.pairwise((0, *block.stops))
        self._camera = np.concatenate([a + block.rng.permutation(b - a) for a, b in steps])
        self._pixel = self._number = np.empty(0, np.int64)
        self._cells: dict[Hashable, tuple[np.ndarray, np.ndarray]] = {}

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `Sampler.start`."""
        self._pixel, self._number = pixel, number

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `Sampler.draw`."""
        n = self._spp if number is None else self._length
        if key not in self._cells:
            self._cells[key] = self._rng.permutation(n), self._rng.integers(n, size=self._pixels)
        order, begins = self._cells[key]
        place = take(self._number, index) if number is None else np.minimum(number, self._length - 1)
        if number is None and key == "camera":
            place = self._camera.take(place)
        cell = order.take(place + begins.take(take(self._pixel, index)), mode="wrap")
        rows = int(np.sqrt(n))
        columns = n // rows
        u = self._rng.random((2, len(cell)), dtype=np.float32)
        inside = cell < rows * columns
        y, x = np.divmod(cell, columns)
        u[0] = np.where(inside, (u[0] + x) / np.float32(columns), u[0])
        u[1] = np.where(inside, (u[1] + y) / np.float32(rows), u[1])
        return np.minimum(u, np.float32(1 - 2**-24))


SamplerFactory = Callable[[PixelBlock], Sampler]
"""Makes the sampler of the pixels of one tile."""
SAMPLERS: dict[str, SamplerFactory] = {
    "independent": Independent,
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
        ``(block) -> Sampler``, such as a class; `block` is a `dmis.samplers.pixel_block.PixelBlock`.

    A ValueError if the name is not a word, or is ``auto`` or that of another sampler, or `factory` cannot be called.
    """
    if not (isinstance(name, str) and name.isidentifier()):
        raise ValueError(f"a sampler's name must be a word of letters, digits and _; got {name!r}")
    if name == "auto":
        raise ValueError("a sampler cannot be named auto, which stands for the default one; give another name")
    if not callable(factory):
        raise ValueError(f"sampler {name} must be a class or function that makes it for a tile; got {factory!r}")
    if SAMPLERS.get(name, factory) is not factory:
        raise ValueError(f"there is a sampler {name!r} already; samplers are {', '.join(SAMPLERS)}")
    SAMPLERS[name] = factory


def is_sequence(kind: str) -> bool:
    """Return whether the sampler `kind` takes neighbours of a sequence, and says so by an attribute ``sequence``."""
    return getattr(SAMPLERS[kind], "sequence", False)
