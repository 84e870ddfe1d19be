"""Embree floor: the time of the Embree calls of a render alone.

Each tile is rendered once more with a caster that records its queries (a tile has the same rays every time), then the
queries are repeated alone, on the same number of threads. ``seconds / floor`` is the cost that NumPy adds to Embree.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dmis.base.vectors import Array
from dmis.intersect import Hits, RayCaster
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.scene import Scene

Query = tuple[Array, Array, Array | None]
"""Origins and directions of rays, and distances of an occlusion query, None for closest hits."""


class Recorder:
    """Ray caster that records every query and passes it on to another caster."""

    def __init__(self, caster: RayCaster) -> None:
        self._caster = caster
        self.queries: list[Query] = []

    def closest(self, origin: Array, direction: Array) -> Hits:
        """Return the closest hits, see `dmis.intersect.Intersector.closest`."""
        self.queries.append((origin, direction, None))
        return self._caster.closest(origin, direction)

    def occluded(self, origin: Array, direction: Array, distance: Array) -> np.ndarray:
        """Return whether rays are occluded, see `dmis.intersect.Intersector.occluded`."""
        self.queries.append((origin, direction, distance))
        return self._caster.occluded(origin, direction, distance)


def embree_seconds(scene: Scene, tiles: Sequence[Tile], threads: int) -> float:
    """Return the wall seconds of the Embree calls of `tiles` alone, on `threads` threads."""
    seconds = 0.0
    with ThreadPoolExecutor(threads) as executor:
        for k in range(0, len(tiles), 4 * threads):  # a few tiles at a time: their rays are all in memory
            queries_of_tiles = list(executor.map(lambda tile: _record(scene, tile), tiles[k : k + 4 * threads]))
            begin = time.perf_counter()
            list(executor.map(lambda queries: _repeat(scene.intersector, queries), queries_of_tiles))
            seconds += time.perf_counter() - begin
    return seconds


def _record(scene: Scene, tile: Tile) -> list[Query]:
    """Return the queries of a tile."""
    recorder = Recorder(scene.intersector)
    render_tile(scene, tile, recorder)
    return recorder.queries


def _repeat(caster: RayCaster, queries: Sequence[Query]) -> None:
    """Send queries to a caster."""
    for origin, direction, distance in queries:
        if distance is None:
            caster.closest(origin, direction)
        else:
            caster.occluded(origin, direction, distance)
