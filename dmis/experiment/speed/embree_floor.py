"""Embree floor: the time of the Embree calls of a render alone.

Each tile is rendered once more with a caster that records its queries (a tile has the same rays every time), then the
queries are repeated alone, on the same number of threads. ``seconds / floor`` is the cost that NumPy adds to Embree.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.intersect import Hits, RayCaster
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.scene import Scene


class Recorder:
    """Ray caster that passes queries on to another one, and keeps them to be repeated."""

    def __init__(self, caster: RayCaster) -> None:
        self._caster = caster
        self.queries: list[partial[Any]] = []

    def closest(self, origin: Array, direction: Array) -> Hits:
        """Return the closest hits, see `dmis.intersect.Intersector.closest`."""
        self.queries.append(partial(self._caster.closest, origin, direction))
        return self.queries[-1]()

    def occluded(self, origin: Array, direction: Array, distance: Array) -> np.ndarray:
        """Return whether rays are occluded, see `dmis.intersect.Intersector.occluded`."""
        self.queries.append(partial(self._caster.occluded, origin, direction, distance))
        return self.queries[-1]()


def embree_seconds(scene: Scene, tiles: Sequence[Tile], threads: int) -> float:
    """Return the wall seconds of the Embree calls of `tiles` alone, on `threads` threads."""

    def record(tile: Tile) -> list[partial[Any]]:
        recorder = Recorder(scene.intersector)
        render_tile(scene, tile, recorder)
        return recorder.queries

    def repeat(queries: Sequence[partial[Any]]) -> None:
        for query in queries:
            query()

    seconds = 0.0
    with ThreadPoolExecutor(threads) as executor:
        for k in range(0, len(tiles), 4 * threads):  # a few tiles at a time: their rays are all in memory
            queries_of_tiles = list(executor.map(record, tiles[k : k + 4 * threads]))
            begin = time.perf_counter()
            list(executor.map(repeat, queries_of_tiles))
            seconds += time.perf_counter() - begin
    return seconds
