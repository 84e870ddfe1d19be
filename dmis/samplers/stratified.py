"""Stratified points: a jittered grid for each pixel and draw."""

from __future__ import annotations

import itertools
from collections.abc import Hashable

import numpy as np

from dmis.base.vectors import Array, Selection, take
from dmis.samplers.pixel_block import PixelBlock


class Stratified:
    """Sampler of a jittered grid: n points fill ``floor(sqrt n)`` rows of equal columns; the rest are random.

    All pixels use the cells of a draw in one order, but each pixel starts it at a random cell. With one start for all,
    every pixel would combine the same cells of two draws, and the errors of their products would be correlated.
    """

    def __init__(self, block: PixelBlock) -> None:
        self._rng = block.rng
        self._pixels = len(block.pixels)
        self._spp = block.stops[-1]
        self._length = self._spp * block.shading_samples
        # shuffled between stops only: a pixel that stops early uses the beginning of the sequence
        steps = itertools.pairwise((0, *block.stops))
        self._camera = np.concatenate([a + block.rng.permutation(b - a) for a, b in steps])
        self._pixel = self._number = np.empty(0, np.int64)
        self._cells: dict[Hashable, tuple[np.ndarray, np.ndarray]] = {}

    def start(self, pixel: np.ndarray, number: np.ndarray) -> None:
        """See `dmis.samplers.streams.Sampler.start`."""
        self._pixel = pixel
        self._number = number

    def draw(self, key: Hashable, index: Selection | None, number: np.ndarray | None = None) -> Array:
        """See `dmis.samplers.streams.Sampler.draw`."""
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
