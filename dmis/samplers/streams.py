"""Samplers: uniform numbers for every (pixel, sample, dimension), which seed, pass and tile determine.

A tile has one random stream, so an image does not depend on how many threads, processes or machines rendered it, or in
which order. Numbers of `sobol` are functions of (seed, pixel, sample, dimension), and do not even depend on passes and
tiles.

Draws of samplers are two-dimensional. `Independent` numbers have no structure. The others spread the numbers of a pixel
evenly: `Stratified` over a jittered grid, `dmis.samplers.sobol` over the points of a (0, 2)-sequence, so that pairs are
even together too. `dmis.samplers.lowdiscrepancy` does as pbrt-v2's sampler of that name does.

Draws with different keys must have different orders of the points, unless they are only ever added up. If sample i had
point i of the sequence in all of them, an integrand of two draws, such as the light at a path's second surface, would
be sampled in one plane of its four dimensions only, however many samples there are.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, Protocol, runtime_checkable

import numpy as np

from dmis.base.plugins import Later, Registry, checked, guarded
from dmis.base.validate import check_array
from dmis.base.vectors import Array, Selection, size, take
from dmis.samplers.pixel_block import CONTINUE, LENS, MORE, PICK, PixelBlock


def stream(seed: int, pass_: int, tile: int) -> np.random.Generator:
    """Return the random generator of one tile of one pass."""
    if seed < 2**32:
        sequence = np.random.SeedSequence([seed, pass_, tile])
    else:  # several words, which the list above would mix with the pass
        sequence = np.random.SeedSequence(seed, spawn_key=(pass_, tile))
    return np.random.Generator(np.random.SFC64(sequence))


@runtime_checkable
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


class Numbers:
    """Which uniform numbers the camera samples of a tile draw: one method for each decision that numbers make.

    Pairs come from the `sampler` of this name, which may spread them evenly over the samples of a pixel; single numbers
    are independent, and come from the generator of the `block`.
    """

    def __init__(self, sampler: str, block: PixelBlock) -> None:
        self.rng = block.rng
        self._own = sampler not in SAMPLERS.shipped
        self._sampler = _own_sampler(sampler, block) if self._own else SAMPLERS[sampler](block)
        self._blocks = self._sampler if isinstance(self._sampler, BlockSampler) else None  # once: to ask takes 10 µs

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """Begin a batch of camera samples, see `Sampler.start`."""
        self._size = len(pixel)
        self._sampler.start(pixel, number)

    def _draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        return self._checked("draw", self._sampler.draw(key, index, number), "(2, N)", size(index, self._size))

    def _checked(self, method: str, numbers: Any, shape: str, count: int) -> Array:
        """Return the numbers of a method of the sampler; a ValueError unless one that is not shipped is right."""
        if self._own:
            check_array(f"{type(self._sampler).__name__}.{method}", numbers, count, shape, below=1.0)
        return numbers

    def camera(self, lens: bool = False) -> Array:
        """Return where the rays of all camera samples go through their pixels, or leave the lens, ``(2, N)``."""
        return self._draw((LENS,) if lens else "camera", None)

    def light(self, key: tuple[int, ...], sample: Selection | None) -> Array:
        """Return what picks one of several lights at the vertices of N camera samples, ``(N,)`` in [0, 1)."""
        return self._draw((PICK, *key), sample)[0]

    def direction(
        self,
        key: tuple[int, ...],
        i: int,
        sample: Selection | None,
        count: Array | int,
        before: Array | None,
        numbers: int = 2,
    ) -> Array:
        """Return the numbers of one shading sample of each of N camera samples, ``(numbers, N)``.

        Structured samplers spread the numbers of a pixel over all its samples of one technique, so where counts are
        uneven, a sample's place in its technique's sequence is the number of samples before it.

        Parameters
        ----------
        key
            Tells the technique, the light and the path from others.
        i, count
            Which of the camera sample's samples of the technique it is, and how many there are; no int: they differ.
        sample
            Selection of camera samples; None: all.
        before
            How many samples of the technique the pixel has before each camera sample; None: they are not counted.
        """
        if numbers > 2:
            *path, technique = key
            keys = key, (*path, MORE, technique)
            return np.concatenate([self.direction(pair, i, sample, count, before) for pair in keys])[:numbers]
        if before is not None:
            return self._draw(key, sample, take(before, sample) + i)
        if isinstance(count, int) and self._blocks is not None:
            block = self._blocks.draw_block(key, sample, i, count)
            return self._checked("draw_block", block, "(2, N)", size(sample, self._size))
        return self._draw((*key, i), sample)

    def onward(self, path: tuple[int, ...], sample: Selection | None) -> Array:
        """Return the directions in which paths go on, ``(2, N)``; lobes and roulette take numbers of `rng`."""
        return self._draw((*path, CONTINUE), sample)

    def techniques(self, shading_samples: int, samples: int) -> Array:
        """Return what picks the technique of each shading sample at random, ``(shading_samples, samples)``."""
        return self.rng.random((shading_samples, samples), dtype=np.float32)

    def rounding_offsets(self, count: int, pixels: int) -> Array:
        """Return `count` offsets of systematic rounding for each pixel, ``(count, P)`` float64."""
        offsets = self.rng.random((count, pixels))
        if not isinstance(self._sampler, RoundingSampler):
            return offsets
        offsets = self._sampler.rounding_offsets(count)  # of the pixels, and not of the tile
        return self._checked("rounding_offsets", offsets, f"({count}, N)", pixels).astype(float)

    def rounding_order(self, number: np.ndarray) -> np.ndarray | None:
        """Return the numbers of camera samples in the order in which counts are rounded, ``(N,)``; None: in theirs."""
        return self._sampler.rounding_order(number) if isinstance(self._sampler, RoundingSampler) else None


def _own_sampler(name: str, block: PixelBlock) -> Sampler:
    """Return a sampler that is not shipped, with guarded methods; a ValueError unless it is one."""
    methods = dict.fromkeys(("start", "draw", "draw_block", "rounding_offsets", "rounding_order"))
    sampler: Sampler = checked(guarded(f"sampler {name}", SAMPLERS[name])(block), methods, in_place=True)
    if not isinstance(sampler, Sampler):
        raise ValueError(f"sampler {type(sampler).__name__} must have methods start and draw: docs/extending.md")
    return sampler


SamplerFactory = Callable[[PixelBlock], Sampler]
"""Makes the sampler of the pixels of one tile."""
SAMPLERS: Registry[SamplerFactory] = Registry(
    "sampler",
    {
        "independent": Independent,
        "stratified": Later("dmis.samplers.stratified", "Stratified"),
        "sobol": Later("dmis.samplers.sobol", "Sobol"),
        "lowdiscrepancy": Later("dmis.samplers.lowdiscrepancy", "LowDiscrepancy"),
    },
    reserved={"auto": "it stands for the default one"},
)
"""By name; `register_sampler` adds to it."""


def register_sampler(name: str, factory: SamplerFactory) -> None:
    """Make a sampler known by its name: in `dmis.render`, `dmis.Settings`, rules and on the command line.

    Parameters
    ----------
    factory
        ``(block) -> Sampler``, such as a class; `block` is a `dmis.samplers.pixel_block.PixelBlock`.

    A ValueError if the name is not right, see `dmis.base.plugins.Registry.check`, or `factory` cannot be called.
    """
    SAMPLERS.add(name, factory)


def is_sequence(kind: str) -> bool:
    """Return whether the sampler `kind` takes neighbours of a sequence, and says so by an attribute ``sequence``."""
    if kind not in SAMPLERS:
        raise ValueError(
            f"sampler {kind!r} is not registered in this process. Worker processes know what a plug-in, or a module "
            f"that they import, registers at its top level: call dmis.register_sampler there"
        )
    return getattr(SAMPLERS[kind], "sequence", False)
