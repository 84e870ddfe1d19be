"""Error against run time: slopes, efficiency, and what a rule gains at equal error and in equal time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dmis.experiment import Budget, Run, median_seconds
from dmis.metrics import mean_and_error, ratio
from dmis.vec import Array

Axis = Literal["spp", "rays", "seconds"]
"""What an error is held against: camera samples per pixel, rays, or wall seconds."""


@dataclass(frozen=True)
class Gain:
    """A rule at one budget beside the balance heuristic.

    Attributes
    ----------
    mse, over_balance, interval
        Mean over seeds; its ratio to that of the balance heuristic at the same budget, and half the width of the 95 %
        confidence interval (`nan` for one seed). Both are `nan` if the balance heuristic has no error above 0.
    seconds, cpu_seconds, overhead
        Medians over seeds, and the share of the seconds that pilot and fit take.
    rays
        Mean over seeds.
    equal_error
        Seconds that the balance heuristic needs for the same error, over those of the rule.
    equal_time
        Mean squared error of the balance heuristic in the same seconds, over that of the rule.
    extrapolated
        Whether either lies outside of the budgets that the balance heuristic was measured at.
    """

    rule: str
    spp: int
    mse: float
    over_balance: float
    interval: float
    relmse: float
    seconds: float
    cpu_seconds: float
    overhead: float
    rays: float
    equal_error: float
    equal_time: float
    extrapolated: bool

    @property
    def efficiency(self) -> float:
        """1 / (MSE seconds): what does not change with the number of samples. Of an estimate of the MSE below 0, which
        there is where the reference is as noisy, it is not known: NaN.
        """
        return 1 / (self.mse * self.seconds) if self.mse > 0 else float("nan" if self.mse else "inf")


def line(runs: Mapping[Budget, Sequence[Run]], rule: str, axis: Axis) -> tuple[Array, Array]:
    """A rule's budgets, fewest samples first: what they took ``(B,)``, and their errors, by seed, ``(K, B)``.

    Seconds are medians over seeds and rays are means.
    """
    mine = [of for (name, _), of in sorted(runs.items(), key=lambda item: item[0][1]) if name == rule]
    took = {
        "spp": [of[0].spp for of in mine],
        "rays": [np.mean([run.rays for run in of]) for of in mine],
        "seconds": [median_seconds(of) for of in mine],
    }[axis]
    return np.array(took, np.float64), np.array([[run.mse for run in of] for of in mine]).T


def slope(x: Array, mse: Array) -> tuple[float, float]:
    """Slope of the root of `mse` ``(K, B)`` over `x` ``(B,)``, both as logarithms, by least squares: -1/2 for N^-1/2.

    Returns
    -------
    The slope of the root of the mean over seeds, and its standard error: the spread of the slopes that leave out one
    seed (jackknife). Both are `nan` where they cannot be told: for one budget, for budgets that took the same time, for
    one seed, for errors below zero.
    """
    value = _fit(x, mse.mean(axis=0))
    seeds = len(mse)
    if seeds < 2:
        return value, float("nan")
    others = np.array([_fit(x, np.delete(mse, k, axis=0).mean(axis=0)) for k in range(seeds)])
    return value, float(np.sqrt((seeds - 1) * others.var()))


def _fit(x: Array, mse: Array) -> float:
    if not (x > 0).all() or not (mse > 0).all():
        return float("nan")
    log = np.log(x)
    if np.ptp(log) < 1e-9:  # means of the same times may differ in their last digit
        return float("nan")
    return float(np.polyfit(log, np.log(mse) / 2, 1)[0])


def read_off(x: Array, y: Array, at: float) -> tuple[float, bool]:
    """The value at `at` of the points ``x, y``, ``(B,)``, joined by lines in log-log, and whether it lies between them.

    Before the first point and after the last, y falls as 1 / x. `nan` if there is a value that has no logarithm.
    """
    if not ((x > 0).all() and (y > 0).all() and at > 0):
        return float("nan"), False
    order = np.argsort(x)
    x, y = x[order], y[order]
    nearest = np.clip(at, x[0], x[-1])
    value = np.exp(np.interp(np.log(nearest), np.log(x), np.log(y))) * nearest / at
    return float(value), bool(x[0] <= at <= x[-1])


def gains(runs: Mapping[Budget, Sequence[Run]]) -> list[Gain]:
    """Every rule and budget beside the balance heuristic, which must be among them, in their order."""
    seconds, errors = line(runs, "balance", "seconds")
    baseline = errors.mean(axis=0)
    found = []
    for (rule, spp), mine in runs.items():
        mse, _ = mean_and_error(np.array([run.mse for run in mine]))
        time = median_seconds(mine)
        needed, between = read_off(baseline, seconds, mse)
        reached, within = read_off(seconds, baseline, time)
        base, over, interval = np.array([run.mse for run in runs["balance", spp]]), np.nan, np.nan
        if base.mean() > 0:  # a black image has no error, and one whose reference is as noisy may have less
            over, interval = ratio(np.array([run.mse for run in mine]), base)
        found.append(
            Gain(
                rule=rule,
                spp=spp,
                mse=mse,
                over_balance=over,
                interval=interval,
                relmse=float(np.mean([run.relmse for run in mine])),
                seconds=time,
                cpu_seconds=float(np.median([run.cpu_seconds for run in mine])),
                overhead=float(np.median([run.overhead / run.seconds for run in mine])),
                rays=float(np.mean([run.rays for run in mine])),
                equal_error=needed / time,
                equal_time=reached / mse if mse > 0 else float("nan"),
                extrapolated=not (between and within),
            )
        )
    return found
