"""Error against run time: lines, and ratios to the balance heuristic, below 1 where a rule is better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from dmis.base.vectors import Array
from dmis.experiment.metrics import holm_levels, log_ratio
from dmis.experiment.runs import PINNED, Budget, Run

Axis = Literal["rays", "seconds"]
"""Axis that errors are plotted over: rays, or CPU seconds."""
Measure = Literal["relmse", "mse"]
"""Measure of error, a field of `dmis.experiment.runs.Run`."""
MEASURES: dict[Measure, str] = {"relmse": "relMSE", "mse": "MSE"}
"""Names of the measures in tables; "error" alone is the first."""
METRICS = {**{str(name): title for name, title in MEASURES.items()}, "flip": "FLIP"}
"""Measures of an image beside its reference, and their names."""


class Interval(NamedTuple):
    """Ratio with the ends of its 95 % confidence interval; NaN if unknown."""

    value: float
    low: float
    high: float

    @property
    def is_wide(self) -> bool:
        """Whether the ends are more than a factor of 100 apart: there are too few seeds for an interval."""
        return self.high > 100 * self.low

    def text(self, ends: str = "({} – {})") -> str:
        """Return the ratio and, if they are known, its `ends`; a dash for these if they are `is_wide`."""
        value, *limits = map(ratio_text, self)
        return value if np.isnan(self.high) else f"{value} {'(–)' if self.is_wide else ends.format(*limits)}"


def ratio_text(value: float) -> str:
    """Return a ratio with three decimals, three digits below 0.1, none after the point from 100 on; a dash for NaN."""
    if np.isnan(value):
        return "–"
    return f"{value:#.3g}" if value < 0.1 else f"{value:.3f}" if value < 100 else f"{value:.0f}"


@dataclass(frozen=True)
class ErrorRatios:
    """Error of a rule at one budget by one measure, over those of the baselines: below 1 the rule is better.

    Attributes
    ----------
    error
        Mean over seeds.
    over_balance
        Its ratio to that of the balance heuristic at the same budget.
    over_pinned
        The same ratio to the pinned baseline (`dmis.experiment.runs.PINNED`); NaN if it was not measured.
    error_time, error_time_over_pinned
        Ratios of means over seeds of error times CPU seconds.
    equal_time
        Error over that of the balance heuristic in the same CPU seconds.
    extrapolated
        Whether these lie outside of the budgets that the balance heuristic was measured at.
    """

    error: float
    over_balance: Interval
    over_pinned: Interval
    error_time: Interval
    error_time_over_pinned: Interval
    equal_time: float
    extrapolated: bool


@dataclass(frozen=True)
class Gain:
    """Errors by both measures and time of a rule at one budget.

    Attributes
    ----------
    cpu_seconds, overhead
        Medians over seeds, and the share of the time that pilot and fit take.
    rays
        Mean over seeds.
    """

    rule: str
    spp: int
    relmse: ErrorRatios
    mse: ErrorRatios
    cpu_seconds: float
    overhead: float
    rays: float

    @property
    def measures(self) -> tuple[ErrorRatios, ErrorRatios]:
        """Both measures, in the order of `MEASURES`."""
        return self.relmse, self.mse


def median_seconds(runs: Sequence[Run]) -> float:
    """Return the median of the CPU seconds of `runs`."""
    return float(np.median([run.cpu_seconds for run in runs]))


def line(runs: Mapping[Budget, Sequence[Run]], rule: str, axis: Axis, measure: Measure = "mse") -> tuple[Array, Array]:
    """Return the points of a rule's line of error against rays or seconds, fewest samples first.

    That is the values on the axis ``(B,)``, medians over seeds of CPU seconds or means of rays, and errors by seed
    ``(K, B)``.
    """
    budgets = [by_seed for (name, _), by_seed in sorted(runs.items(), key=lambda item: item[0][1]) if name == rule]
    if axis == "seconds":
        x = [median_seconds(by_seed) for by_seed in budgets]
    else:
        x = [float(np.mean([run.rays for run in by_seed])) for by_seed in budgets]
    return np.array(x, np.float64), np.array([_errors(by_seed, measure) for by_seed in budgets]).T


def interpolate_log_log(x: Array, y: Array, at: float) -> tuple[float, bool]:
    """Return y at `at` by linear interpolation in log-log between points ``(B,)``, and whether it lies between them.

    Before the first point and after the last, y falls as 1 / x. `nan` if a value is not above 0.
    """
    if not ((x > 0).all() and (y > 0).all() and at > 0):
        return float("nan"), False
    order = np.argsort(x)
    x, y = x[order], y[order]
    nearest = np.clip(at, x[0], x[-1])
    value = np.exp(np.interp(np.log(nearest), np.log(x), np.log(y))) * nearest / at
    return float(value), bool(x[0] <= at <= x[-1])


def _errors(runs: Sequence[Run], measure: Measure, times_cpu: bool = False) -> Array:
    """Return the errors of `runs` by one measure, or these times CPU seconds, ``(K,)``."""
    return np.array([getattr(run, measure) * (run.cpu_seconds if times_cpu else 1) for run in runs], np.float64)


def intervals(logs: Array, degrees: int) -> list[Interval]:
    """Return ratios with Student's intervals, at the levels of Holm (`dmis.experiment.metrics.holm_levels`).

    Parameters
    ----------
    logs
        Logarithms of the ratios and their standard errors, ``(N, 2)``, see `dmis.experiment.metrics.log_ratio`.
    degrees
        Degrees of freedom; of 0, for one seed, ends are NaN, since one run does not show the scatter.
    """
    from scipy.stats import t  # imported where used: scipy.stats takes half a second

    value, error = np.reshape(logs, (-1, 2)).T
    with np.errstate(divide="ignore", invalid="ignore"):  # the same runs under two names have no scatter
        p = np.nan_to_num(2 * t.sf(np.abs(value / error), max(1, degrees)), nan=1.0)
    half = t.isf(holm_levels(p) / 2, max(1, degrees)) * error
    return [Interval(*ends) for ends in np.exp([value, value - half, value + half]).T.tolist()]


def over_scenes(scenes: Sequence[Mapping[Budget, Sequence[Run]]], measure: Measure = "relmse") -> dict[str, Interval]:
    """Return by rule the geometric mean over scenes of error times CPU seconds over that of the balance heuristic.

    Each scene counts at its largest budget; a rule that one of them lacks there is left out. Intervals are of seeds,
    not of scenes: other scenes may have other ratios.

    Parameters
    ----------
    scenes
        Runs of each scene by budget, `balance` among them; at least one scene.
    measure
        Of the error, one of `MEASURES`.
    """
    errors = []
    for runs in scenes:
        largest = max(spp for _, spp in runs)
        errors.append({rule: _errors(of, measure, True) for (rule, spp), of in runs.items() if spp == largest})
    rules = [rule for rule in errors[0] if rule not in ("balance", PINNED) and all(rule in of for of in errors)]
    logs = np.array([[log_ratio(of[rule], of["balance"]) for of in errors] for rule in rules]).reshape(
        -1, len(errors), 2
    )
    seeds = min(len(by_seed) for runs in scenes for by_seed in runs.values())
    error = np.sqrt((logs[..., 1] ** 2).sum(axis=1)) / len(scenes)
    means = np.stack([logs[..., 0].mean(axis=1), error], axis=1)
    return dict(zip(rules, intervals(means, seeds - 1), strict=True))


def gains(runs: Mapping[Budget, Sequence[Run]]) -> list[Gain]:
    """Return the `Gain` of every rule and budget in their order; the balance heuristic must be among them."""
    relmse, mse = (_error_ratios(runs, measure) for measure in MEASURES)
    return [
        Gain(
            rule=rule,
            spp=spp,
            relmse=relmse[rule, spp],
            mse=mse[rule, spp],
            cpu_seconds=median_seconds(by_seed),
            overhead=float(np.median([run.overhead / run.seconds for run in by_seed])),
            rays=float(np.mean([run.rays for run in by_seed])),
        )
        for (rule, spp), by_seed in runs.items()
    ]


def _error_ratios(runs: Mapping[Budget, Sequence[Run]], measure: Measure) -> dict[Budget, ErrorRatios]:
    """Return the errors of all rules and budgets by one measure, and their ratios to the baselines."""
    seconds, errors = line(runs, "balance", "seconds", measure)
    over = [_ratios(runs, name, measure, times_cpu) for times_cpu in (False, True) for name in ("balance", PINNED)]
    result = {}
    for budget, by_seed in runs.items():
        error = float(_errors(by_seed, measure).mean())
        of_balance, within = interpolate_log_log(seconds, errors.mean(axis=0), median_seconds(by_seed))
        equal_time = error / of_balance if error > 0 else float("nan")
        balance, pinned, time_balance, time_pinned = (ratios[budget] for ratios in over)
        result[budget] = ErrorRatios(error, balance, pinned, time_balance, time_pinned, equal_time, not within)
    return result


def _ratios(
    runs: Mapping[Budget, Sequence[Run]], baseline: str, measure: Measure, times_cpu: bool
) -> dict[Budget, Interval]:
    """Return the ratios of the means over seeds of `_errors` to those of `baseline`; NaN where it was not measured.

    Rules with the same number of samples are one family of tests. The pinned baseline is not a rule among them.
    """
    ratios = dict.fromkeys(runs, Interval(np.nan, np.nan, np.nan))
    for spp in [spp for rule, spp in runs if rule == baseline]:
        ratios[baseline, spp] = Interval(1.0, np.nan, np.nan)
        errors = _errors(runs[baseline, spp], measure, times_cpu)
        for is_pinned in (False, True):
            family = [of for of in runs if of[1] == spp and of[0] != baseline and (of[0] == PINNED) == is_pinned]
            logs = [log_ratio(_errors(runs[budget], measure, times_cpu), errors) for budget in family]
            ratios |= dict(zip(family, intervals(np.array(logs), len(errors) - 1), strict=True))
    return ratios
