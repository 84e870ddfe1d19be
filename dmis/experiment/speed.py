"""Speed of renders against the Embree floor, as ``python -m dmis bench`` measures it.

The floor of a render is the time in its Embree calls. Machines differ and their speed varies; the ratio of total to
floor is the cost that NumPy adds.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dmis.estimator.settings import make_settings
from dmis.fit.registry import make_rule
from dmis.formats.load_scene import load_scene
from dmis.pipeline.job import resolve
from dmis.pipeline.progress import Progress
from dmis.pipeline.render import render_job

HEADER = """| scene | rule | Msamples/s | Mrays/s | rays per sample | seconds | in Embree | total / floor | range |
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
        Wall seconds of each render, and those in its Embree calls, the mean over threads.
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
    """Render every scene with every rule `repeats` times, in turns.

    Parameters
    ----------
    sources
        Names or files of scenes, see `dmis.formats.load_scene.load_scene`.
    parallel
        Number of threads.
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
            job = resolve(scene, rule, spp, seed + k, make_settings(**options)).alone
            job.scene.prepare()  # once, before the first render
            result = render_job(job, parallel)
            samples = math.prod(scene.camera.resolution) * job.spp
            begun = Speed(scene.name, job.rule_text, parallel, samples, dict(result.rays), [], [])
            speeds.setdefault(n, begun).seconds.append(result.seconds["total"])
            speeds[n].floor.append(result.seconds["embree"] / parallel)
            if progress:
                progress(f"{scene.name} {rule}", k * len(cases) + n + 1, repeats * len(cases))
    return list(speeds.values())
