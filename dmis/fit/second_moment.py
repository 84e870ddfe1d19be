"""The rule ``second-moment``: the shares of least variance and cost, by curves V(w) from one pilot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from dmis.base.patches import patch_spread, patch_sum
from dmis.estimator.records import Statistic
from dmis.estimator.settings import DEFAULTS
from dmis.fit.pooling import PatchCurves, PooledRule, allowed_weights, guarded_argmin
from dmis.fit.round import Fit
from dmis.variance.curves import GRID, GRID_SHARES, HALF, Curves
from dmis.variance.moments import Film


@dataclass(frozen=True)
class SecondMoment(PooledRule):
    """Choose shares per patch of least variance times cost, by curves V(w) from a pilot at w = 1/2.

    The pilot gives unbiased curves V(w) (`dmis.variance.curves`), which are averaged over patches, filtered, weighed
    with the cost of a camera sample at w (`dmis.estimator.cost`) such that the image's error times its time is least
    (`dmis.fit.pooling.guarded_argmin`), and minimised on a grid of shares. The closest relative is Grittmann et
    al. 2022, "Efficiency-aware multiple importance sampling for bidirectional rendering algorithms" (ACM Transactions
    on Graphics 41(4)), where the samples of one combination of techniques give the efficiencies of many others.

    Options are those of `dmis.fit.pooling.PooledRule`; the baseline point is w = 1/2. Curves are those of the
    `combiner` if it is a heuristic; of balance if not, and with ``frozen``.
    """

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        """Makes the statistic that the pilot gathers."""
        return partial(Curves, combiner=self.combiner or DEFAULTS["combiner"])

    def fit(self, pilot: Mapping[Any, Film]) -> Fit:
        """Return the shares from the pilot at w = 1/2."""
        samples = pilot[0.5]
        shape = samples.mean.shape[:2]
        # V(w) of patches
        means, pixels = self.pooled(samples)
        curves = PatchCurves(**means, pixels=pixels, baseline=HALF)
        variance = curves.variance
        cost = self.sample_cost(samples, GRID_SHARES)
        area = patch_sum(np.ones(shape), self.patch)  # not `pixels`, which says how certain means are
        # min over w of V + price C,  price = V(1/2) / C(1/2) of the image
        mean_half = (np.maximum(variance[HALF], 0) * area).sum() / area.sum()
        allowed = allowed_weights(np.einsum("gyx,yx->g", curves.curve, area))
        best = guarded_argmin(curves, cost, self.guard, allowed, mean_half / cost[HALF])
        at_best = np.take_along_axis(variance, best[None], axis=0)[0]
        maps = {"patch": GRID[best], "variance": np.maximum(at_best, 0), "variances": variance}
        return Fit(patch_spread(GRID[best], self.patch, shape), maps)
