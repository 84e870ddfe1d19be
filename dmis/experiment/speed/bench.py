"""Speed of renders against the Embree floor, as ``python -m dmis bench`` measures it.

The floor of a render is the time of its Embree calls alone (`embree_seconds`). Machines differ and
their speed varies; the ratio of total to floor, measured in turns, is the cost that NumPy adds.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.settings import make_settings
from dmis.fit.registry import make_rule
from dmis.formats.load_scene import load_scene
from dmis.intersect import Hits, RayCaster
from dmis.pipeline.job import resolve
from dmis.pipeline.progress import Progress
from dmis.pipeline.render import render_job
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
    """Return the wall seconds of the Embree calls of `tiles` alone, on `threads` threads.

    Each tile is rendered once more with a caster that records its queries (a tile has the same rays every time), then
    the queries are repeated alone.
    """

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


HEADER = """| scene | rule | Msamples/s | Mrays/s | rays per sample | seconds | Embree alone | total / floor | range |
|---|---|---|---|---|---|---|---|---|"""


@dataclass(frozen=True)
class Speed:
    """Times of several renders of a scene with one rule.

    Attributes
    ----------
    samples
        Number of camera samples of one render.
    rays
        Number of rays of the first render, by kind.
    seconds, floor
        Wall seconds of each render, and of its Embree calls alone.
    """

    scene: str
    rule: str
    threads: int
    samples: int
    rays: dict[str, int]
    seconds: list[float]
    floor: list[float]

    @property
    def ratios(self) -> list[float]:
        """Ratio of total time to floor of each render."""
        return [total / floor for total, floor in zip(self.seconds, self.floor)]

    def row(self) -> str:
        """Return the row of the table below `HEADER`."""
        seconds, floor = statistics.median(self.seconds), statistics.median(self.floor)
        rays = sum(self.rays.values())
        return (
            f"| {self.scene} | {self.rule} | {self.samples / seconds / 1e6:.2f} | {rays / seconds / 1e6:.2f} "
            f"| {rays / self.samples:.2f} | {seconds:.2f} | {floor:.2f} | {statistics.median(self.ratios):.2f} "
            f"| {min(self.ratios):.2f} – {max(self.ratios):.2f} |"
        )


def bench(
    sources: Sequence[str],
    rules: Sequence[str],
    resolution: tuple[int, int],
    spp: int,
    *,
    parallel: int = 1,
    repeats: int = 3,
    seed: int = 0,
    progress: Progress | None = None,
    **options: Any,
) -> list[Speed]:
    """Render every scene with every rule `repeats` times, in turns, each time followed by its Embree calls alone.

    Parameters
    ----------
    sources
        Names or files of scenes, see `dmis.formats.load_scene.load_scene`.
    parallel
        Number of threads, of renders and of Embree alone.
    progress
        Called as ``progress(case, done, total)`` after each render.
    options
        ``settings`` and fields of `dmis.Settings` by name, for all rules, see `dmis.pipeline.render.render`.

    A ValueError if there is no repeat, or no sample beside the pilot of a rule.
    """
    if repeats < 1:
        raise ValueError(f"repeats must be at least 1; got {repeats}")
    for rule in rules:  # before the first render, so that no finished one is lost
        if spp <= (pilot := sum(make_rule(rule).pilot.values())):
            raise ValueError(f"spp must be more than the pilot's {pilot} camera samples of rule {rule}; got {spp}")
    scenes = [load_scene(source, resolution=resolution) for source in sources]
    cases = [(scene, rule) for scene in scenes for rule in rules]
    speeds: dict[int, Speed] = {}
    for k in range(repeats):
        for n, (scene, rule) in enumerate(cases):
            tiles: list[Tile] = []
            job = resolve(scene, rule, spp, seed + k, make_settings(**options))
            result = render_job(job, parallel, observer=tiles.extend)
            samples = math.prod(scene.camera.resolution) * job.spp
            begun = Speed(scene.name, job.rule_text, parallel, samples, dict(result.rays), [], [])
            speeds.setdefault(n, begun).seconds.append(result.seconds["total"])
            speeds[n].floor.append(embree_seconds(job.scene, tiles, parallel))
            if progress:
                progress(f"{scene.name} {rule}", k * len(cases) + n + 1, repeats * len(cases))
    return list(speeds.values())
