"""Experiments: rules side by side on one scene, against one reference, over several seeds.

Rules take turns seed by seed, so that whatever slows the machine down slows all of them. Pilot and fit are part of a
rule's budget and of its time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmis.metrics import mean_over_blocks, relmse, squared_error
from dmis.reference import Reference
from dmis.render import Result, render
from dmis.rules import make_rule
from dmis.scene import Scene
from dmis.settings import Settings

Budget = tuple[str, int]
"""A rule as text, and camera samples per pixel, its pilot included."""


@dataclass(frozen=True)
class Run:
    """One render and how far it is from the reference.

    Attributes
    ----------
    rays
        Of all kinds.
    pilot_seconds, fit_seconds, render_seconds
        Wall times of the three stages.
    mse, mse_error
        Mean squared error over pixels and channels, and its standard error, see `dmis.metrics.mean_over_blocks`.
    cpu_seconds
        Of all threads of this process, from the call of `render` to its return.
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

    @property
    def overhead(self) -> float:
        """Seconds of pilot and fit."""
        return self.pilot_seconds + self.fit_seconds

    @property
    def seconds(self) -> float:
        """Seconds from the pilot to the last sample."""
        return self.overhead + self.render_seconds


def measure(
    scene: Scene,
    budgets: Sequence[Budget],
    seeds: Sequence[int],
    reference: Reference,
    *,
    settings: Settings | None = None,
    threads: int | None = None,
    done: Iterable[Run] = (),
    keep: Callable[[Budget, Result], None] | None = None,
    record: Callable[[Run], None] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[Budget, list[Run]]:
    """Render `scene` with every rule and budget, and with every seed.

    Parameters
    ----------
    settings
        Of all rules, see `dmis.render.render`.
    done
        Runs of an earlier call, which are not rendered again.
    keep
        Called with each budget and its result, before `record`.
    record
        Called with each run as soon as it is finished.
    progress
        Called as ``progress(rule, done, total)`` after each render.

    Returns
    -------
    The runs of each budget, in the order of the seeds.
    """
    runs: dict[Budget, list[Run]] = {budget: [] for budget in budgets}
    known = {(run.rule, run.spp, run.seed): run for run in done}
    total = len(runs) * len(seeds)
    for k, seed in enumerate(seeds):
        for n, (rule, spp) in enumerate(runs):
            run = known.get((rule, spp, seed))
            if run is None:
                begin = time.process_time()
                result = render(scene, rule, spp, seed=seed, settings=settings, threads=threads)
                run = _measured(result, rule, spp, seed, time.process_time() - begin, reference)
                if keep:
                    keep((rule, spp), result)
                if record:
                    record(run)
            runs[rule, spp].append(run)
            if progress:
                progress(rule, k * len(runs) + n + 1, total)
    return runs


def _measured(result: Result, rule: str, spp: int, seed: int, cpu_seconds: float, reference: Reference) -> Run:
    mse, error = mean_over_blocks(squared_error(result.image, reference.first, reference.second))
    return Run(
        rule=rule,
        spp=spp,
        seed=seed,
        rays=sum(result.rays.values()),
        pilot_seconds=result.seconds["pilot"],
        fit_seconds=result.seconds["fit"],
        render_seconds=result.seconds["render"],
        mse=mse,
        mse_error=error,
        relmse=relmse(result.image, reference.first, reference.second),
        cpu_seconds=cpu_seconds,
    )


def on_cpu(runs: Sequence[Run]) -> list[Run]:
    """`runs` with processor time in place of wall time, divided between the stages as wall time was.

    Wall times depend on what else a machine does; on one thread the two are the same where it does nothing else.
    """
    stages = "pilot_seconds", "fit_seconds", "render_seconds"
    shares = (run.cpu_seconds / run.seconds for run in runs)
    return [replace(run, **{s: share * getattr(run, s) for s in stages}) for run, share in zip(runs, shares)]


def median_seconds(runs: Sequence[Run]) -> float:
    """The middle one of the times of `runs`."""
    return float(np.median([run.seconds for run in runs]))


def spp_in_time(seconds: float, runs: Sequence[Run]) -> int:
    """Camera samples per pixel with which the rule of `runs` would take `seconds`, rounded to the nearest.

    Pilot and fit take what they took; the final samples take time in proportion to their number. At least one final
    sample is left. The answer is an estimate: render with it, and compare the times.
    """
    pilot = sum(make_rule(runs[0].rule).pilot.values())
    overhead = float(np.median([run.overhead for run in runs]))
    each = float(np.median([(run.seconds - run.overhead) / (run.spp - pilot) for run in runs]))
    return pilot + max(1, round((seconds - overhead) / each))
