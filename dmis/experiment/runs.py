"""Runs of several rules on one scene, over several seeds, with their errors against one reference.

Rules take turns seed by seed, so that a slower machine slows all of them. Pilot and fit are part of a
rule's budget and of its time; imports and tables are not, since a few pixels are rendered before its first turn.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial
from itertools import product
from typing import Any

from dmis.base.validate import whole
from dmis.estimator.settings import Settings, make_settings
from dmis.experiment import alarm
from dmis.experiment.metrics import mean_over_blocks, relmse, squared_error
from dmis.experiment.reference import Reference
from dmis.fit.registry import RULES, make_rule
from dmis.pipeline.executor import Parallel, Workers, worker_processes
from dmis.pipeline.job import resolve
from dmis.pipeline.progress import Progress, reporting
from dmis.pipeline.render import render_job
from dmis.pipeline.result import Result
from dmis.scene.scene import Scene

Budget = tuple[str, int]
"""Rule as text, or `PINNED`, and camera samples per pixel, its pilot included."""
PINNED = "pinned"
"""Name of the pinned baseline in budgets and tables: rule ``balance`` with the preset ``thesis``.

That is one light and one BRDF sample, independent points and the balance heuristic, whatever the settings of the other
rules; their integrator and depth are its own, too.
"""
Turn = tuple[str, int, int]
"""Rule and samples per pixel of a budget, and seed."""


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
        Mean squared error over pixels and channels, and its standard error as estimated from this image, which is too
        small where rare samples matter, see `dmis.experiment.metrics.mean_over_blocks`.
    cpu_seconds
        CPU seconds of all threads and processes, from the call of `render` to its return.
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

    @classmethod
    def read(cls, row: Mapping[str, str | None]) -> Run:
        """Return the run of a row of a table, cells by the names of their columns; a ValueError if it is none."""
        kinds = {"str": str, "int": int, "float": float}
        return cls(**{field.name: kinds[str(field.type)](row[field.name] or "") for field in fields(cls)})

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
        ``parallel``, ``settings`` and fields of `dmis.Settings`, see `dmis.pipeline.render.render`.

    Returns
    -------
    The runs of each budget, in the order of the seeds.

    Warns
    -----
    dmis.experiment.alarm.ReferenceWarning
        Once for each rule whose image has another mean than the reference, see `dmis.experiment.alarm`.
    """
    runs: dict[Budget, list[Run]] = {budget: [] for budget in budgets}
    turns = [(rule, spp, seed) for seed, (rule, spp) in product(seed_list(seeds), runs)]
    finished = {(run.rule, run.spp, run.seed): run for run in done}
    alarmed: set[str] = set()
    renders = _renders(scene, [turn for turn in turns if turn not in finished], **options)
    with reporting(progress, "renders") as report:
        for n, turn in enumerate(turns, 1):
            run = finished.get(turn)
            if run is None:
                result, cpu_seconds = next(renders)
                mean_z = alarm.mean_z(result.image, reference, turn[1])
                pilot, fit, final = (result.seconds[stage] for stage in ("pilot", "fit", "render"))
                errors = *mean_over_blocks(squared_error(result, reference)), relmse(result, reference)
                run = Run(*turn, sum(result.rays.values()), pilot, fit, final, *errors, cpu_seconds, mean_z)
                if record:
                    record(run, result)
            if run.rule not in alarmed and abs(run.mean_z) > alarm.ALARM_LIMIT:
                alarmed.add(run.rule)
                warnings.warn(alarm.ReferenceWarning(alarm.summary([run])), stacklevel=2)
            runs[run.rule, run.spp].append(run)
            if report:
                report(run.rule, n, len(turns))
    return runs


def seed_list(seeds: int | Iterable[int]) -> list[int]:
    """Return the seeds that a number K stands for, 0 to K - 1 as with ``--seeds K``; or those of a list, checked."""
    if not isinstance(seeds, Iterable):
        return list(range(whole("seeds", seeds, 1, more="or a list of seeds")))
    return [whole("a seed", seed, 0) for seed in seeds]


def _renders(
    scene: Scene, turns: Sequence[Turn], parallel: Parallel = None, **options: Any
) -> Iterator[tuple[Result, float]]:
    """Yield the result of each turn, and its CPU seconds of all threads and processes."""
    settings, processes = make_settings(**options), worker_processes(parallel)
    scene.in_float32[0].prepare()  # now, so that it is not part of the CPU seconds of the first run
    if processes and all(rule == PINNED or rule.partition(":")[0] in RULES.shipped for rule, _, _ in turns):
        with closing(Workers(scene.in_float32[0], parallel)) as workers:
            list(workers.calls(partial(_warm_up, settings), [turns] * processes))
    for turn in turns:
        _warm_up(settings, scene, [turn])
        name, of_turn = _rule_and_settings(turn, settings)
        begin = time.process_time()
        result = render_alone(scene, name, turn[1], seed=turn[2], parallel=parallel, settings=of_turn)
        yield result, time.process_time() - begin + result.seconds["workers"]


def render_alone(scene: Scene, rule: str, spp: int, *, seed: int, settings: Settings, parallel: Parallel) -> Result:
    """Render a scene; of a window nothing around it, because fixed shares must not pay for what others leave out."""
    return render_job(resolve(scene, rule, spp, seed, settings).alone, parallel)


def _warm_up(settings: Settings, scene: Scene, turns: Sequence[Turn]) -> None:
    """Render 8x8 pixels once for each budget, so that imports and tables are not part of its first time."""
    small, done = _small_scene(scene)
    for turn in turns:
        rule, of_rule = _rule_and_settings(turn, settings)
        if (rule, turn[1], of_rule) not in done:
            done.add((rule, turn[1], of_rule))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # which the render will give
                render_job(resolve(small, rule, turn[1], 0, of_rule), 1)


@lru_cache(maxsize=1)
def _small_scene(scene: Scene) -> tuple[Scene, set[tuple[str, int, Settings]]]:
    """Return `scene` in 8x8 pixels with the same tables, and the set, shared by all calls, of renders made with it."""
    scene = scene.in_float32[0]
    return scene.seen_by(replace(scene.camera, resolution=(8, 8), corner=(0, 0), frame=None)), set()


def _rule_and_settings(turn: Turn, settings: Settings) -> tuple[str, Settings]:
    """Return the rule of a turn as `render` has it, and its settings."""
    if turn[0] != PINNED:
        return turn[0], settings
    return "balance", make_settings(preset="thesis", integrator=settings.integrator, max_depth=settings.max_depth)


def fallbacks(budgets: Iterable[Budget]) -> list[str]:
    """Return a line for each budget that is too small for its rule, such as ``auto``, with the rule that rendered it.

    Budgets of a rule that have the same reason share a line.
    """
    spp: dict[tuple[str, str], list[int]] = {}
    for rule, n in budgets:
        if rule != PINNED and (reason := make_rule(rule).fallback(n)):
            spp.setdefault((rule, reason), []).append(n)
    return [f"{rule} at {', '.join(map(str, n))} spp: {reason}." for (rule, reason), n in spp.items()]
