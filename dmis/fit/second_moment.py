"""Rules that learn weights from one pilot at w = 1/2.

Statistics are shared between neighbours, decisions are not: what was gathered is averaged over patches and filtered,
then each patch takes its own minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Any

import numpy as np

from dmis.base.patches import patch_spread, patch_sum, row_blocks
from dmis.base.vectors import Array
from dmis.estimator.cost import camera_sample_cost
from dmis.estimator.records import Statistic
from dmis.fit.curve_minimum import PatchCurves, allowed_weights, guarded_argmin
from dmis.fit.objectives import objective
from dmis.fit.pooled_rule import PooledRule
from dmis.fit.rule import Fit, Pilot, final_settings
from dmis.variance.curves import GRID, GRID_SHARES, HALF, Curves


@dataclass(frozen=True)
class SecondMoment(PooledRule):
    """Shares that minimise an objective per patch.

    The objective ``second-moment`` is variance and cost, V(w) and C(w), weighed such that the image's error times its
    time is least (`dmis.fit.curve_minimum.cost_weighted`): the pilot gives unbiased curves V(w)
    (`dmis.variance.curves`), which are averaged over patches, filtered, weighed with the cost of a camera sample at w
    (`dmis.estimator.cost`) and minimised on a grid of shares. The others, ``taylor``, ``inverse-variance``, ``neyman``,
    ``representativity``, ``kl`` and ``tsallis``, are those of the literature (`dmis.fit.objectives`). The
    closest relative of ``second-moment`` is Grittmann et al. 2022, "Efficiency-aware multiple importance sampling for
    bidirectional rendering algorithms" (ACM Transactions on Graphics 41(4)), where the samples of one combination of
    techniques give the efficiencies of many others.

    Parameters
    ----------
    objective
        Name of the objective. All others than ``second-moment`` have no variance, and so not the option `guard`.
    spp
        Samples of the pilot, at w = 1/2: an even number of at least 4, see `dmis.pipeline.job.pilot_settings`.
    gamma
        Order of the divergence (tsallis); 1 is Kullback-Leibler, 2 the second moment.
    combiner
        Of the final samples. Curves are those of the combiner if it is a heuristic (second-moment); of balance if not,
        and with ``frozen``.
    patch, filter, size, sigma, cost, guard, reuse, sampler, compensation
        See `dmis.fit.pooled_rule.PooledRule`; the baseline point is w = 1/2.
    """

    objective: str = "second-moment"
    _: KW_ONLY
    gamma: float = 2.0

    shares_only = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.spp < 4 or self.spp % 2:
            raise ValueError(
                f"spp of the pilot must be even and at least 4, because curves come from pairs of camera samples with "
                f"twice the shading samples; got {self.spp}"
            )
        if not 0 < self.gamma < np.inf:
            raise ValueError(f"gamma must be positive and finite; got {self.gamma}")
        if self.filter == "gaussian":
            import scipy.ndimage  # noqa: F401  what the filter needs: a fit should not take the time of an import

    @property
    def pilot(self) -> Mapping[float, int]:
        return {0.5: self.spp}

    @property
    def settings(self) -> Mapping[str, Any]:
        return {"combiner": self.combiner} | final_settings(self.sampler, self.reuse, self.compensation)

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        """Makes the statistic that the pilot gathers."""
        if self.objective != "second-moment":
            return objective(self.objective, self.gamma).statistic
        return partial(Curves, combiner=self.combiner)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        """Return the shares from the pilot at w = 1/2."""
        samples = pilot[0.5]
        shape = samples.moments.mean.shape[:2]
        if self.objective != "second-moment":
            weight = self._solve_objective(samples)
            return Fit(patch_spread(weight, self.patch, shape), {"patch": weight})
        # V(w) of patches
        means, pixels = self._pool(samples)
        curves = PatchCurves(**means, pixels=pixels, baseline=HALF)
        area = patch_sum(np.ones(shape), self.patch)  # not `pixels`, which says how certain means are
        cost = self._cost(samples)
        # min over w of V + price C
        variance = curves.variance
        mean_half = (np.maximum(variance[HALF], 0) * area).sum() / area.sum()
        best = self._best_shares(curves, area, cost, mean_half / cost[HALF])
        weight = GRID[best]
        at_best = np.take_along_axis(variance, best[None], axis=0)[0]
        maps = {"patch": weight, "variance": np.maximum(at_best, 0), "variances": variance}
        return Fit(patch_spread(weight, self.patch, shape), maps)

    def _cost(self, pilot: Pilot) -> Array:
        """Return the cost of a camera sample at the shares of the grid, ``(G,)``."""
        s = pilot.shading_samples
        if not self.cost:
            return np.ones(len(GRID))
        return camera_sample_cost(pilot.rays, GRID_SHARES, s, s // 2, pilot.techniques)

    def _solve_objective(self, pilot: Pilot) -> Array:
        """Return the shares of the patches by an objective of the literature."""
        means, _ = self._pool(pilot)
        s, pair = pilot.shading_samples, [1.0, 1.0]
        if self.cost:
            ends = np.array([[0, 1], [1, 0]])
            pair = camera_sample_cost(pilot.rays, ends, s, s // 2, pilot.techniques).tolist()
        return np.clip(objective(self.objective, self.gamma).solve(means, (pair[0], pair[1])), 0, 1)

    def _best_shares(self, curves: PatchCurves, area: Array, cost: Array, price: float) -> np.ndarray:
        """Return the index into the grid of the best share of each patch, ``(rows, columns)``."""
        allowed = allowed_weights(np.einsum("gyx,yx->g", curves.curve, area))
        blocks = (curves.rows(rows) for rows in row_blocks(len(area)))
        return np.concatenate([guarded_argmin(block, cost, self.guard, allowed, price) for block in blocks])
