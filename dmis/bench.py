"""Speed against the Embree floor: ``python -m dmis bench``.

The floor of a render is the time of the same Embree calls when nothing else happens (`dmis.replay`). Machines are
noisy and differ; the ratio of total to floor, measured in turns, says what NumPy adds.
"""

from __future__ import annotations

import cProfile
import pstats
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from dmis.load import load_scene
from dmis.render import Result, render
from dmis.replay import embree_seconds
from dmis.scene import Scene
from dmis.settings import Settings
from dmis.tile import Tile, render_tile

HEADER = """| scene | rule | Msamples/s | Mrays/s | rays per sample | seconds | Embree alone | total / floor | range |
|---|---|---|---|---|---|---|---|---|"""
PARTS = {
    "embree": {"intersect.py": {"closest", "occluded"}},
    "random numbers": {"samplers.py": {"draw", "start", "stream", "make_sampler"}},
    "statistics": {"curves.py": {"add", "sums"}, "objectives.py": {"add", "sums"}, "estimator.py": {"_record"}},
    "film": {"variance.py": {"of", "merge"}},
}
"""Functions whose time, with what they call, is that of a part of a tile's work; the rest is shading."""


@dataclass(frozen=True)
class Speed:
    """A rule on a scene, rendered several times.

    Attributes
    ----------
    samples
        Camera samples of one render.
    rays
        Of one render, by kind.
    seconds, floor
        Wall seconds of each render, and of its Embree calls alone.
    pilot, fit
        Share of the pilot, and of statistics made into weights, in the time of a render, the median.
    parts
        Share of each of `PARTS`, and of shading, in the tiles of the last render.
    """

    scene: str
    rule: str
    threads: int
    samples: int
    rays: dict[str, int]
    seconds: list[float]
    floor: list[float]
    pilot: float
    fit: float
    parts: dict[str, float]

    @property
    def ratios(self) -> list[float]:
        """Total over floor, of each render."""
        return [total / floor for total, floor in zip(self.seconds, self.floor)]

    def row(self) -> str:
        """The row of the table, below `HEADER`."""
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
    threads: int = 1,
    repeats: int = 3,
    seed: int = 0,
    settings: Settings | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[Speed]:
    """Render every scene with every rule `repeats` times, in turns, each time followed by its Embree calls alone.

    Parameters
    ----------
    sources
        Names or files of scenes, see `dmis.load.load_scene`.
    progress
        Called as ``progress(rule, done, total)`` after each render.
    """
    if repeats < 1:
        raise ValueError(f"repeats must be at least 1; got {repeats}")
    scenes = [load_scene(source, resolution=resolution) for source in sources]
    cases = [(scene, rule) for scene in scenes for rule in rules]
    runs: list[list[tuple[Mapping[str, float], float]]] = [[] for _ in cases]
    last: list[Result] = []
    for k in range(repeats):
        for n, (scene, rule) in enumerate(cases):
            result = render(scene, rule, spp, seed=seed + k, settings=settings, threads=threads)
            runs[n].append((result.seconds, embree_seconds(scene, result.tiles, threads)))
            if k == repeats - 1:
                last.append(result)
            if progress:
                progress(f"{scene.name} {rule}", k * len(cases) + n + 1, repeats * len(cases))
    return [_speed(*case, spp, threads, found, result) for case, found, result in zip(cases, runs, last)]


def _speed(
    scene: Scene, rule: str, spp: int, threads: int, runs: Sequence[tuple[Mapping[str, float], float]], last: Result
) -> Speed:
    height, width = last.image.shape[:2]
    pilot, fit = (statistics.median(times[stage] / times["total"] for times, _ in runs) for stage in ("pilot", "fit"))
    return Speed(
        scene=scene.name,
        rule=rule,
        threads=threads,
        samples=height * width * spp,
        rays=dict(last.rays),
        seconds=[times["total"] for times, _ in runs],
        floor=[floor for _, floor in runs],
        pilot=pilot,
        fit=fit,
        parts=parts(scene, last.tiles),
    )


def parts(scene: Scene, tiles: Sequence[Tile], limit: float = 10.0) -> dict[str, float]:
    """Where the time of `tiles` goes: shares of `PARTS` and of shading, which add up to 1.

    Tiles from all over the image, and of all passes, are rendered under Python's profiler, in a random order, for
    `limit` seconds or so.
    """
    profile = cProfile.Profile(time.thread_time)
    end = time.perf_counter() + limit
    for k in np.random.default_rng(0).permutation(len(tiles)):
        profile.runcall(render_tile, scene, tiles[k])
        if time.perf_counter() > end:
            break
    found = dict.fromkeys((*PARTS, "shading"), 0.0)
    for (file, _, function), (_, _, _, inclusive, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        name = PurePath(file).name
        if name == "tile.py" and function == "render_tile":
            found["shading"] += inclusive
        for part, files in PARTS.items():
            if "dmis" in file and function in files.get(name, ()):
                found[part] += inclusive
    total = found["shading"]
    found["shading"] -= sum(found[part] for part in PARTS)
    return {part: seconds / total for part, seconds in found.items()}


def peak_memory(source: str, rule: str, resolution: tuple[int, int], spp: int, threads: int = 2) -> int:
    """Peak resident memory of a process that loads a scene and renders it, in bytes (POSIX)."""
    code = (
        "import dmis, dmis.memory; "
        f"dmis.render(dmis.load_scene({source!r}, resolution={resolution!r}), {rule!r}, {spp}, threads={threads}); "
        "print(dmis.memory.peak())"
    )
    return int(fresh_python(code))


def fresh_python(code: str) -> str:
    """What another Python process prints when it runs `code`, which must be our own."""
    import subprocess

    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
