"""Error against run time: slopes, and ratios to the balance heuristic, below 1 where a rule is better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from dmis.base.vectors import Array
from dmis.experiment.metrics import holm_levels, log_ratio, mean_and_error, ratio
from dmis.experiment.runs import PINNED, Budget, Run, median_seconds

Axis = Literal["spp", "rays", "seconds"]
"""Axis that errors are plotted over: camera samples per pixel, rays, or wall seconds."""


class Interval(NamedTuple):
    """Ratio with the ends of its 95 % confidence interval; NaN if unknown."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Gain:
    """Error and time of a rule at one budget, over those of the balance heuristic: below 1 the rule is better.

    Attributes
    ----------
    mse, over_balance, interval
        Mean over seeds; its ratio to that of the balance heuristic at the same budget, and half the width of the 95 %
        confidence interval (`nan` for one seed). Both are `nan` if the balance heuristic has no error above 0.
    over_pinned
        The same ratio to the pinned baseline (`dmis.experiment.runs.PINNED`); `nan` if it was not measured.
    seconds, cpu_seconds, overhead
        Medians over seeds, and the share of the seconds that pilot and fit take.
    rays
        Mean over seeds.
    error_time
        Mean over seeds of mean squared error times CPU seconds, over that of the balance heuristic, see `error_times`.
    error_time_over_pinned
        The same over that of the pinned baseline.
    equal_error
        Seconds over those that the balance heuristic needs for the same error.
    equal_time
        Mean squared error over that of the balance heuristic in the same seconds.
    extrapolated
        Whether either lies outside of the budgets that the balance heuristic was measured at.
    """

    rule: str
    spp: int
    mse: float
    over_balance: float
    interval: float
    over_pinned: float
    relmse: float
    seconds: float
    cpu_seconds: float
    overhead: float
    rays: float
    error_time: Interval
    error_time_over_pinned: Interval
    equal_error: float
    equal_time: float
    extrapolated: bool

    @property
    def wins(self) -> bool:
        """Whether this is a rule whose whole interval of error times CPU seconds is below the balance heuristic's."""
        return self.rule != PINNED and self.error_time.high < 1


def line(runs: Mapping[Budget, Sequence[Run]], rule: str, axis: Axis) -> tuple[Array, Array]:
    """Return the points of a rule's line of error against samples, rays or seconds, fewest samples first.

    That is the values on the axis ``(B,)``, medians over seeds of seconds or means of rays, and mean squared errors by
    seed ``(K, B)``.
    """
    budgets = [by_seed for (name, _), by_seed in sorted(runs.items(), key=lambda item: item[0][1]) if name == rule]
    x = {
        "spp": [by_seed[0].spp for by_seed in budgets],
        "rays": [np.mean([run.rays for run in by_seed]) for by_seed in budgets],
        "seconds": [median_seconds(by_seed) for by_seed in budgets],
    }[axis]
    return np.array(x, np.float64), np.array([[run.mse for run in by_seed] for by_seed in budgets]).T


def slope(x: Array, mse: Array) -> tuple[float, float]:
    """Return the slope of log RMSE over log `x` by least squares, and its standard error; it is -1/2 for N^-1/2.

    Arguments are those that `line` returns. The slope is that of the root of the mean over seeds, and its standard
    error that of the jackknife, which leaves out one seed at a time. They are `nan` if they are unknown: for one
    budget, for budgets with the same time, for errors below zero; the standard error also for one seed.
    """
    value, seeds = _log_slope(x, mse.mean(axis=0)), len(mse)
    if seeds < 2:
        return value, float("nan")
    others = np.array([_log_slope(x, np.delete(mse, k, axis=0).mean(axis=0)) for k in range(seeds)])
    return value, float(np.sqrt((seeds - 1) * others.var()))


def _log_slope(x: Array, mse: Array) -> float:
    """Return the slope of log RMSE over log `x`, NaN if it is unknown."""
    # means of the same times may differ in their last digit
    if not (x > 0).all() or not (mse > 0).all() or np.ptp(np.log(x)) < 1e-9:
        return float("nan")
    return float(np.polyfit(np.log(x), np.log(mse) / 2, 1)[0])


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


def error_times(rules: Sequence[Sequence[Run]], baseline: Sequence[Run]) -> list[Interval]:
    """Return the mean squared error times CPU seconds of each of `rules` over that of `baseline`.

    That is the inverse of the ratio of efficiencies, ``1 / (V T)``, which does not depend on the number of samples
    if error falls as 1 / N.

    Runs are of one number of samples, one per seed, in the same order of seeds: those of one seed are rendered in
    turns, so what slows the machine down slows both. Ratios are of means over seeds, with Student's intervals of their
    logarithms (`dmis.experiment.metrics.log_ratio`): the scatter of error and of time are both in them. Intervals of
    several rules have the levels of Holm (`dmis.experiment.metrics.holm_levels`). The ends are NaN for one seed, since
    one run does not show the scatter of times; all is NaN for errors that are not above 0, or without CPU seconds.
    """
    from scipy.stats import t  # imported where used: scipy.stats takes half a second

    products = [np.array([run.mse * run.cpu_seconds for run in runs]) for runs in (baseline, *rules)]
    logs = np.array([log_ratio(values, products[0]) for values in products[1:]]).reshape(-1, 2)
    degrees, (value, error) = max(1, len(baseline) - 1), logs.T
    with np.errstate(divide="ignore", invalid="ignore"):  # the same runs under two names have no scatter
        p = np.nan_to_num(2 * t.sf(np.abs(value / error), degrees), nan=1.0)
    half = t.isf(holm_levels(p) / 2, degrees) * error
    return [Interval(*ends) for ends in np.exp([value, value - half, value + half]).T.tolist()]


def gains(runs: Mapping[Budget, Sequence[Run]]) -> list[Gain]:
    """Return the `Gain` of every rule and budget in their order; the balance heuristic must be among them."""
    seconds, errors = line(runs, "balance", "seconds")
    baseline = errors.mean(axis=0)
    products, products_over_pinned = (_error_times_by_budget(runs, name) for name in ("balance", PINNED))
    gains_of_budgets = []
    for (rule, spp), by_seed in runs.items():
        mse, _ = mean_and_error(np.array([run.mse for run in by_seed]))
        time = median_seconds(by_seed)
        equal_error_seconds, between = interpolate_log_log(baseline, seconds, mse)
        equal_time_mse, within = interpolate_log_log(seconds, baseline, time)
        over_balance, interval = _error_ratio(by_seed, runs["balance", spp])
        over_pinned, _ = _error_ratio(by_seed, runs.get((PINNED, spp), ()))
        gains_of_budgets.append(
            Gain(
                rule=rule,
                spp=spp,
                mse=mse,
                over_balance=over_balance,
                interval=interval,
                over_pinned=over_pinned,
                relmse=float(np.mean([run.relmse for run in by_seed])),
                seconds=time,
                cpu_seconds=float(np.median([run.cpu_seconds for run in by_seed])),
                overhead=float(np.median([run.overhead / run.seconds for run in by_seed])),
                rays=float(np.mean([run.rays for run in by_seed])),
                error_time=products[rule, spp],
                error_time_over_pinned=products_over_pinned[rule, spp],
                equal_error=time / equal_error_seconds,
                equal_time=mse / equal_time_mse if mse > 0 else float("nan"),
                extrapolated=not (between and within),
            )
        )
    return gains_of_budgets


def _error_ratio(runs: Sequence[Run], baseline: Sequence[Run]) -> tuple[float, float]:
    """Return the ratio of errors and half of its interval; NaN without a baseline, or if it has no error above 0.

    The error of a black image is 0, and its estimate may be below 0 for a noisy reference.
    """
    base = np.array([run.mse for run in baseline])
    if not base.sum() > 0:
        return float("nan"), float("nan")
    return ratio(np.array([run.mse for run in runs]), base)


def _error_times_by_budget(runs: Mapping[Budget, Sequence[Run]], baseline: str) -> dict[Budget, Interval]:
    """Return `error_times` of all budgets over `baseline`; NaN where this was not measured.

    Rules with the same number of samples are one family of tests. The pinned baseline is not a rule among them.
    """
    by_budget = dict.fromkeys(runs, Interval(np.nan, np.nan, np.nan))
    for spp in (spp for rule, spp in runs if rule == baseline):
        by_budget[baseline, spp] = Interval(1.0, np.nan, np.nan)
        others = [rule for rule, n in runs if n == spp and rule != baseline]
        for family in ([rule for rule in others if rule != PINNED], [rule for rule in others if rule == PINNED]):
            intervals = error_times([runs[rule, spp] for rule in family], runs[baseline, spp])
            by_budget |= {(rule, spp): interval for rule, interval in zip(family, intervals, strict=True)}
    return by_budget
