"""Rules that learn weights from one pilot at w = 1/2.

Statistics are shared between neighbours, decisions are not: what was gathered is averaged over patches and filtered,
then each patch takes its own minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from functools import partial

import numpy as np

from dmis.base.patches import patch_spread, patch_sum
from dmis.base.validate import positive
from dmis.estimator.records import Statistic
from dmis.estimator.settings import Settings
from dmis.fit.curve_minimum import PatchCurves, allowed_weights, guarded_argmin
from dmis.fit.objectives import Gather, objective
from dmis.fit.pooled_rule import PooledRule
from dmis.fit.round import Fit, Pilot
from dmis.variance.curves import GRID, GRID_SHARES, HALF, Curves


@dataclass(frozen=True)
class SecondMoment(PooledRule):
    """Choose shares that minimise an objective per patch.

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
        Name of the objective. All others than ``second-moment`` have no variance, and leave `guard` unused.
    spp
        Samples of the pilot, at w = 1/2: an even number of at least 4, see `dmis.fit.round.pilot_settings`.
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
        positive("gamma", self.gamma)

    @property
    def pilot(self) -> Mapping[float, int]:
        return {0.5: self.spp}

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        """Makes the statistic that the pilot gathers."""
        if self.objective != "second-moment":
            return partial(Gather, objective(self.objective, self.gamma))
        return partial(Curves, combiner=self.combiner or Settings.combiner)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        """Return the shares from the pilot at w = 1/2."""
        samples = pilot[0.5]
        shape = samples.moments.mean.shape[:2]
        means, pixels = self._pool(samples)
        if self.objective != "second-moment":
            # cost of a camera sample at w = 0 and at w = 1
            brdf, light = self._cost(samples, np.array([[0, 1], [1, 0]])).tolist()
            weight = np.clip(objective(self.objective, self.gamma).solve(means["values"], (brdf, light)), 0, 1)
            return Fit(patch_spread(weight, self.patch, shape), {"patch": weight})
        # V(w) of patches
        curves = PatchCurves(**means, pixels=pixels, baseline=HALF)
        variance = curves.variance
        cost = self._cost(samples, GRID_SHARES)
        area = patch_sum(np.ones(shape), self.patch)  # not `pixels`, which says how certain means are
        # min over w of V + price C,  price = V(1/2) / C(1/2) of the image
        mean_half = (np.maximum(variance[HALF], 0) * area).sum() / area.sum()
        allowed = allowed_weights(np.einsum("gyx,yx->g", curves.curve, area))
        best = guarded_argmin(curves, cost, self.guard, allowed, mean_half / cost[HALF])
        at_best = np.take_along_axis(variance, best[None], axis=0)[0]
        maps = {"patch": GRID[best], "variance": np.maximum(at_best, 0), "variances": variance}
        return Fit(patch_spread(GRID[best], self.patch, shape), maps)
