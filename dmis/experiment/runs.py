"""Runs of several rules on one scene, over several seeds, with their errors against one reference.

Rules take turns seed by seed, so that a slower machine slows all of them. Pilot and fit are part of a
rule's budget and of its time.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from dmis.base.validate import whole
from dmis.estimator.settings import make_settings
from dmis.experiment import alarm
from dmis.experiment.metrics import mean_over_blocks, relmse, squared_error
from dmis.experiment.reference import Reference, crop_area
from dmis.fit.registry import make_rule
from dmis.pipeline.executor import Parallel
from dmis.pipeline.progress import Progress, reporting
from dmis.pipeline.render import render
from dmis.pipeline.result import Result
from dmis.scene.scene import Scene

Budget = tuple[str, int]
"""Rule as text, or `PINNED`, and camera samples per pixel, its pilot included."""
PINNED = "pinned"
"""Name of the pinned baseline in budgets and tables: rule ``balance`` with the preset ``thesis``.

That is one light and one BRDF sample, independent points and the balance heuristic, whatever the settings of the other
rules; their integrator and depth are its own, too.
"""


@dataclass(frozen=True)
class Run:
    """Time and error of one render.

    Attributes
    ----------
    rays
        Number of rays of all kinds.
    pilot_seconds, fit_seconds, render_seconds
        Wall times of the three stages.
    mse, mse_error
        Mean squared error over pixels and channels, and its standard error, see
        `dmis.experiment.metrics.mean_over_blocks`.
    cpu_seconds
        CPU seconds of all threads of this process, from the call of `render` to its return.
    mean_z
        Mean of the image less that of the reference, in standard errors, see `dmis.experiment.alarm.mean_z`.
    """

    rule: str
    spp: int
    seed: int
    rays: int
    pilot_seconds: float
    fit_seconds: float
    render_seconds: float
    mse: float
    mse_error: float
    relmse: float
    cpu_seconds: float = float("nan")
    mean_z: float = float("nan")

    @property
    def overhead(self) -> float:
        """Wall seconds of pilot and fit."""
        return self.pilot_seconds + self.fit_seconds

    @property
    def seconds(self) -> float:
        """Wall seconds from the pilot to the last sample."""
        return self.overhead + self.render_seconds


def measure(
    scene: Scene,
    budgets: Sequence[Budget],
    seeds: int | Sequence[int],
    reference: Reference,
    *,
    done: Iterable[Run] = (),
    record: Callable[[Run, Result], None] | None = None,
    progress: Progress | bool | None = None,
    **options: Any,
) -> dict[Budget, list[Run]]:
    """Render `scene` with every rule, budget and seed, and measure time and error of each render.

    Parameters
    ----------
    budgets
        Rules, or `PINNED`, with their numbers of samples.
    seeds
        See `seed_list`.
    done
        Runs of an earlier call, which are not rendered again.
    record
        Called with each run and its result as soon as it is finished.
    progress
        Called as ``progress(rule, done, total)`` after each render; True for a bar.
    options
        ``parallel``, ``settings`` and fields of `dmis.Settings` by name, for all renders; see
        `dmis.pipeline.render.render`. ``crop``: window of the errors (`dmis.experiment.reference.crop_area`). CPU
        seconds are those of this process, and not of others that ``parallel`` names.

    Returns
    -------
    The runs of each budget, in the order of the seeds.

    Warns
    -----
    dmis.experiment.alarm.ReferenceWarning
        Once for each rule whose image has another mean than the reference, see `dmis.experiment.alarm`.
    """
    runs: dict[Budget, list[Run]] = {budget: [] for budget in budgets}
    turns = list(product(seed_list(seeds), runs))
    finished = {(run.rule, run.spp, run.seed): run for run in done}
    alarmed: set[str] = set()
    with reporting(progress, "renders") as report:
        for n, (seed, (rule, spp)) in enumerate(turns, 1):
            run = finished.get((rule, spp, seed))
            if run is None:
                run, result = timed_run(scene, (rule, spp), seed, reference, **options)
                if record:
                    record(run, result)
            if rule not in alarmed and abs(run.mean_z) > alarm.ALARM_LIMIT:
                alarmed.add(rule)
                warnings.warn(alarm.ReferenceWarning(alarm.summary([run])), stacklevel=2)
            runs[rule, spp].append(run)
            if report:
                report(rule, n, len(turns))
    return runs


def seed_list(seeds: int | Iterable[int]) -> list[int]:
    """Return the seeds that a number K stands for, 0 to K - 1 as with ``--seeds K``; or those of a list, checked."""
    if not isinstance(seeds, Iterable):
        return list(range(whole("seeds", seeds, 1, more="or a list of seeds")))
    return [whole("a seed", seed, 0) for seed in seeds]


def timed_run(
    scene: Scene,
    budget: Budget,
    seed: int,
    reference: Reference,
    crop: Sequence[int] | None = None,
    parallel: Parallel = None,
    **options: Any,
) -> tuple[Run, Result]:
    """Render a budget with the `options` of `measure`; return its time and error, and the result."""
    rule, spp = budget
    settings = make_settings(**options)
    if rule == PINNED:
        settings = make_settings(preset="thesis", integrator=settings.integrator, max_depth=settings.max_depth)
    scene.prepare()  # now, so that it is not part of the CPU seconds of the first run
    begin = time.process_time()
    name = "balance" if rule == PINNED else rule
    result = render(scene, name, spp, seed=seed, parallel=parallel, settings=settings)
    cpu_seconds = time.process_time() - begin
    pilot, fit, final = (result.seconds[stage] for stage in ("pilot", "fit", "render"))
    area = crop_area(crop, scene.camera.resolution)
    image, reference = result.image[area], reference.cropped(area)
    mse, mse_error = mean_over_blocks(squared_error(image, reference))
    mean_z = alarm.mean_z(image, reference, spp)
    run = Run(
        rule, spp, seed, sum(result.rays.values()), pilot, fit, final, mse, mse_error, relmse(image, reference),
        cpu_seconds, mean_z,
    )  # fmt: skip
    return run, result


def median_seconds(runs: Sequence[Run]) -> float:
    """Return the median of the seconds of `runs`."""
    return float(np.median([run.seconds for run in runs]))


def fallbacks(budgets: Iterable[Budget]) -> list[str]:
    """Return a line for each budget that is too small for its rule, such as ``auto``, with the rule that rendered it.

    Budgets of a rule that have the same reason share a line.
    """
    spp: dict[tuple[str, str], list[int]] = {}
    for rule, n in budgets:
        if rule != PINNED and (reason := make_rule(rule).fallback(n)):
            spp.setdefault((rule, reason), []).append(n)
    return [f"{rule} at {', '.join(map(str, n))} spp: {reason}." for (rule, reason), n in spp.items()]
