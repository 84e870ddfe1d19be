"""The rule ``simplex``: shares of K techniques per patch, where the variance times cost is least."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from dmis.base.patches import patch_spread, patch_sum
from dmis.base.vectors import Array
from dmis.estimator.records import Statistic
from dmis.estimator.technique import technique_by_name
from dmis.fit.curve_minimum import PatchCurves, guarded_argmin
from dmis.fit.pooled_rule import PooledRule
from dmis.fit.round import Fit, Pilot, Weight
from dmis.variance.simplex_curves import SimplexCurves, baseline_point, grid

PRICES = 2.0 ** -np.arange(6)
"""Prices of cost in variance that are tried, times that at `baseline_point`."""


def best_points(curves: PatchCurves, cost: Array, guard: float, allowed: np.ndarray, area: Array) -> np.ndarray:
    """Return the points of the grid, ``(rows, columns)``, for which the image's error times its time is least.

    That is ``sum V sum C`` over patches of the `area` ``(rows, columns)`` in pixels. Patches minimise ``V + price C``
    (`dmis.fit.curve_minimum.cost_weighted`). At the minimum the price is ``sum V / sum C`` there, which may be far from
    that at `baseline_point`: a technique that costs twice as much may have a quarter of the variance. So prices from
    that at the baseline point downwards are tried.
    """
    variance = np.maximum(curves.variance, 0)
    baseline_price = (variance[curves.baseline] * area).sum() / area.sum() / cost[curves.baseline]
    candidates = []
    for price in baseline_price * PRICES:
        index = guarded_argmin(curves, cost, guard, allowed, price)
        error = (np.take_along_axis(variance, index[None], axis=0)[0] * area).sum()
        candidates.append((error * (cost[index] * area).sum(), index))
    return min(candidates, key=lambda candidate: candidate[0])[1]


@dataclass(frozen=True)
class Simplex(PooledRule):
    """Choose shares of several techniques that minimise variance and cost per patch.

    `dmis.fit.second_moment.SecondMoment` does the same for two, on a finer grid.

    Parameters
    ----------
    mix
        Names of the techniques, joined by ``+``.
    spp
        Samples of the pilot, at equal shares: an even multiple of K of at least 2 K, which become camera samples with
        K times the shading samples, K times fewer.
    patch, filter, size, sigma, cost, guard, reuse, combiner, sampler, compensation
        See `dmis.fit.pooled_rule.PooledRule`; the baseline point is `baseline_point`.

    Notes
    -----
    The maps of its `Fit` are ``patch``, shares of all techniques ``(K, rows, columns)``, ``variance``, and
    ``variances`` ``(G, rows, columns)``.
    """

    mix: str = "light+brdf+resampled"
    multi_technique = shares_only = True

    def __post_init__(self) -> None:
        super().__post_init__()
        names = self.techniques
        for name in names:
            technique_by_name(name)
        if len(names) < 2 or len(set(names)) < len(names):
            raise ValueError(f"mix must be two or more different techniques joined by +; got {self.mix!r}")
        if self.spp < 2 * len(names) or self.spp % 2 or self.spp % len(names):
            raise ValueError(
                f"spp of the pilot must be an even multiple of {len(names)}, the number of techniques, and at least "
                f"{2 * len(names)}; got {self.spp}"
            )

    @property
    def techniques(self) -> tuple[str, ...]:
        """Names of the techniques, in the order of the shares."""
        return tuple(self.mix.split("+"))

    @property
    def pilot(self) -> Mapping[Weight, int]:
        k = len(self.techniques)
        return {0.5 if k == 2 else (1 / k,) * k: self.spp}

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        """Makes the statistic that the pilot gathers."""
        return partial(SimplexCurves, exact=self._exact)

    @property
    def _exact(self) -> tuple[bool, ...]:
        return tuple(technique_by_name(name).exact for name in self.techniques)

    def fit(self, pilot: Mapping[Weight, Pilot]) -> Fit:
        """Return the shares of all techniques, from the pilot at equal shares."""
        (samples,) = pilot.values()
        shape = samples.moments.mean.shape[:2]
        means, pixels = self._pool(samples)
        shares, inside = grid(len(self.techniques))
        curves = PatchCurves(**means, pixels=pixels, baseline=baseline_point(self._exact))
        area = patch_sum(np.ones(shape), self.patch)
        # a technique may be left out where that is as good for the image as `SMALLEST_SHARE`, see `allowed_weights`
        of_image = (curves.curve * area).sum(axis=(1, 2))
        allowed = of_image <= of_image[inside]
        index = best_points(curves, self._cost(samples, shares), self.guard, allowed, area)
        patches = shares[:, index]
        maps = {
            "patch": patches,
            "variance": np.maximum(np.take_along_axis(curves.variance, index[None], axis=0)[0], 0),
            "variances": curves.variance,
        }
        return Fit(np.stack([patch_spread(share, self.patch, shape) for share in patches]), maps)
