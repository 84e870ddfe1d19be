"""The floor: how long the Embree calls of a render take when nothing else happens.

Each tile is rendered once more with a caster that writes down its queries (tiles give the same rays every time), then
the queries are asked again alone, on the same number of threads. ``seconds / floor`` tells what NumPy adds to Embree.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dmis.intersect import Hits, RayCaster
from dmis.scene import Scene
from dmis.tile import Tile, render_tile
from dmis.vec import Array

Query = tuple[Array, Array, Array | None]
"""Origins, directions, and distances if it is an occlusion query."""


class Recorder:
    """A caster that answers from another and keeps every query."""

    def __init__(self, caster: RayCaster) -> None:
        self._caster = caster
        self.queries: list[Query] = []

    def closest(self, origin: Array, direction: Array) -> Hits:
        """See `dmis.intersect.Intersector.closest`."""
        self.queries.append((origin, direction, None))
        return self._caster.closest(origin, direction)

    def occluded(self, origin: Array, direction: Array, distance: Array) -> np.ndarray:
        """See `dmis.intersect.Intersector.occluded`."""
        self.queries.append((origin, direction, distance))
        return self._caster.occluded(origin, direction, distance)


def embree_seconds(scene: Scene, tiles: Sequence[Tile], threads: int) -> float:
    """Wall seconds of the Embree calls of `tiles` alone, on `threads` threads."""
    seconds = 0.0
    with ThreadPoolExecutor(threads) as executor:
        for k in range(0, len(tiles), 4 * threads):  # a few tiles at a time: their rays are all in memory
            recorded = list(executor.map(lambda tile: _record(scene, tile), tiles[k : k + 4 * threads]))
            begin = time.perf_counter()
            list(executor.map(lambda queries: _ask(scene.intersector, queries), recorded))
            seconds += time.perf_counter() - begin
    return seconds


def _record(scene: Scene, tile: Tile) -> list[Query]:
    recorder = Recorder(scene.intersector)
    render_tile(scene, tile, recorder)
    return recorder.queries


def _ask(caster: RayCaster, queries: Sequence[Query]) -> None:
    for origin, direction, distance in queries:
        if distance is None:
            caster.closest(origin, direction)
        else:
            caster.occluded(origin, direction, distance)
