"""Rules that learn weights, and numbers of samples, from one pilot at w = 1/2.

Statistics are shared between neighbours, decisions are not: what was gathered is averaged over patches and filtered,
then each patch takes its own minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dmis.base.patches import patch_spread, patch_sum, row_blocks
from dmis.base.vectors import Array
from dmis.estimator.cost import camera_sample_cost
from dmis.estimator.records import Statistic
from dmis.estimator.settings import MOST
from dmis.fit.choose_heuristic import CHOICE_PATCH, check_choice, choose
from dmis.fit.curve_minimum import PatchCurves, allowed_weights, guarded_argmin
from dmis.fit.objectives import objective
from dmis.fit.pooled_rule import PooledRule
from dmis.fit.pooling import pool
from dmis.fit.rule import Fit, Pilot, final_settings
from dmis.fit.shrinkage import shrink_in_place
from dmis.variance.curves import GRID, GRID_SHARES, HALF, Curves

SHADING_FACTORS = (1, 0.5, 2, 4, 8)
"""Factors of the shading samples that final camera samples may have."""


@dataclass(frozen=True)
class SecondMoment(PooledRule):
    """Shares that minimise an objective per patch.

    The objective ``second-moment`` is variance and cost, V(w) and C(w), weighed such that the image's error times its
    time is least (`dmis.fit.curve_minimum.cost_weighted`): the pilot gives unbiased curves V(w)
    (`dmis.variance.curves`), which are averaged over patches, filtered, weighed with the cost of a camera sample at w
    (`dmis.estimator.cost`) and minimised on a grid of shares. The others, ``taylor``, ``inverse-variance``, ``neyman``,
    ``representativity``, ``kl``, ``tsallis`` and ``linear``, are those of the literature (`dmis.fit.objectives`). The
    closest relative of ``second-moment`` is Grittmann et al. 2022, "Efficiency-aware multiple importance sampling for
    bidirectional rendering algorithms" (ACM Transactions on Graphics 41(4)), where the samples of one combination of
    techniques give the efficiencies of many others.

    Parameters
    ----------
    objective
        Name of the objective. All others than ``second-moment`` have no variance, and so none of the options `shrink`,
        `guard`, `split` and `counts`.
    spp
        Samples of the pilot, at w = 1/2: an even number of at least 4, see `dmis.pipeline.job.pilot_settings`.
    split
        Whether camera samples may have 2, 4 or 8 times the shading samples, and be fewer for it, or half of them, and
        be more, if that is best for the image; only if cost counts.
    counts
        Whether patches get different numbers of samples, in proportion to ``sqrt(V / C)``.
    floor
        Least number of samples of a patch, as a share of the mean.
    count_sigma
        Of the Gaussian over the variances that set the numbers of samples, in patches. Less than `sigma`, because a
        number of samples that is a little off costs little, and highlights are small.
    gamma
        Order of the divergence (tsallis); 1 is Kullback-Leibler, 2 the second moment.
    combiner
        Of the final samples. Curves are those of the combiner if it is a heuristic (second-moment); of balance if not,
        and with ``frozen``. Of several heuristics, joined by ``+``, the pilot chooses the one that is best for the
        image, see `dmis.fit.choose_heuristic`.
    patch, filter, size, sigma, shrink, cost, guard, reuse, sampler, compensation
        See `dmis.fit.pooled_rule.PooledRule`; the baseline point is w = 1/2.
    """

    objective: str = "second-moment"
    _: KW_ONLY
    split: bool = False
    counts: bool = False
    floor: float = 0.1
    count_sigma: float = 0.4
    gamma: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.spp < 4 or self.spp % 2:
            raise ValueError(
                f"spp of the pilot must be even and at least 4, because curves come from pairs of camera samples with "
                f"twice the shading samples; got {self.spp}"
            )
        for name, value in (("count_sigma", self.count_sigma), ("gamma", self.gamma)):
            if not 0 < value < np.inf:
                raise ValueError(f"{name} must be positive and finite; got {value}")
        if not 0 < self.floor <= 1:
            raise ValueError(f"floor must be in (0, 1], a share of the mean number of samples; got {self.floor}")
        if self.objective != "second-moment":
            for name, chosen in (
                ("shrink", self.shrink),
                ("split", self.split),
                ("counts", self.counts),
                (f"combiner {self.combiner}", "+" in self.combiner),
            ):
                if chosen:
                    raise ValueError(f"{name} needs variances, which objective {self.objective} does not estimate")
        if "+" in self.combiner:
            check_choice(self.combiners)
        if self.filter == "gaussian" or (self.counts and not self.needs_features):
            import scipy.ndimage  # noqa: F401  what the filter needs: a fit should not take the time of an import

    @property
    def pilot(self) -> Mapping[float, int]:
        return {0.5: self.spp}

    @property
    def settings(self) -> Mapping[str, Any]:
        return {"combiner": self.combiners[0]} | final_settings(self.sampler, self.reuse, self.compensation)

    @property
    def shares_only(self) -> bool:
        """Whether numbers of camera samples and of shading samples stay as they are."""
        return not (self.counts or self.split)

    @property
    def combiners(self) -> tuple[str, ...]:
        """Combiners that the pilot chooses from."""
        return tuple(self.combiner.split("+"))

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        """Makes the statistic that the pilot gathers."""
        if self.objective != "second-moment":
            return objective(self.objective, self.gamma).statistic
        return partial(Curves, combiners=self.combiners)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        """Return the shares, and numbers of samples if asked for, from the pilot at w = 1/2."""
        samples = pilot[0.5]
        shape = samples.moments.mean.shape[:2]
        if self.objective != "second-moment":
            weight = self._solve_objective(samples)
            return Fit(patch_spread(weight, self.patch, shape), {"patch": weight})
        combiner = None
        if len(self.combiners) > 1:
            samples, combiner = self._choose_combiner(samples, shape)
        # V(w) of patches
        means, pixels = self._pool(samples)
        curves = _patch_curves(means, pixels)
        area = patch_sum(np.ones(shape), self.patch)  # not `pixels`, which says how certain means are
        factor, cost = self._choose_shading_samples(curves, area, samples)
        curves = self._shrunk(curves, factor, samples)
        # min over w of V + price C, or of V C where the numbers of samples differ
        variance = curves.variance
        mean_half = (np.maximum(variance[HALF], 0) * area).sum() / area.sum()
        best = self._best_shares(curves, area, cost, None if self.counts else mean_half / cost[HALF])
        weight = GRID[best]
        del means, curves  # they are large
        counts = self._sample_counts(samples, shape, factor, cost, best) if self.counts else None
        maps = {"patch": weight, "variance": np.maximum(_at_index(variance, best), 0), "variances": variance}
        return Fit(patch_spread(weight, self.patch, shape), maps, counts, factor, combiner)

    def _solve_objective(self, pilot: Pilot) -> Array:
        """Return the shares of the patches by an objective of the literature."""
        means, _ = self._pool(pilot)
        s, pair = pilot.shading_samples, [1.0, 1.0]
        if self.cost:
            ends = np.array([[0, 1], [1, 0]])
            pair = camera_sample_cost(pilot.rays, ends, s, s // 2, pilot.techniques).tolist()
        return np.clip(objective(self.objective, self.gamma).solve(means, (pair[0], pair[1])), 0, 1)

    def _choose_combiner(self, pilot: Pilot, shape: tuple[int, int]) -> tuple[Pilot, str]:
        """Return the best combiner for the image, and the pilot with the sums of its curves."""
        sums_of_each = [
            {name: a if name == "position" else a[k] for name, a in pilot.sums.items()}
            for k in range(len(self.combiners))
        ]
        area, of_each = patch_sum(np.ones(shape), CHOICE_PATCH), []
        for sums in sums_of_each:
            curves = _patch_curves(*pool(sums, shape, CHOICE_PATCH))
            factor, cost = self._choose_shading_samples(curves, area, pilot)
            of_each.append(_variance_and_cost(curves, cost, factor, pilot.shading_samples // 2))
        variance, cost = (np.stack(a) for a in zip(*of_each, strict=True))
        k = choose(variance, cost, area, self.counts)
        return replace(pilot, sums=sums_of_each[k]), self.combiners[k]

    def _shrunk(self, curves: PatchCurves, factor: float, pilot: Pilot) -> PatchCurves:
        """Return the curves for `factor` times the shading samples, shrunk if the rule says so.

        The arrays of `curves` may be overwritten.
        """
        s = pilot.shading_samples // 2
        if not self.shrink:
            return curves.with_shading_samples(factor, s)
        return shrink_in_place(curves, self._kinds(pilot), lambda part: part.with_shading_samples(factor, s))

    def _choose_shading_samples(self, curves: PatchCurves, area: Array, pilot: Pilot) -> tuple[float, Array]:
        """Return the factor of the shading samples that is best for the image, and the cost of a camera sample with it.

        The cost is at the shares of the grid, ``(G,)``.
        """
        candidates = []
        s = pilot.shading_samples // 2
        for factor in (f for f in SHADING_FACTORS if f == 1 or (self.split and self.cost and s * f <= MOST)):
            cost = np.ones(len(GRID))
            if self.cost:
                cost = camera_sample_cost(pilot.rays, GRID_SHARES, pilot.shading_samples, s * factor, pilot.techniques)
            v, c = _variance_and_cost(curves, cost, factor, s)
            # error times time: (sum sqrt(V C))^2, or sum V sum C at equal numbers of samples
            total = (np.sqrt(v * c) * area).sum() ** 2
            if not self.counts:
                total = (v * area).sum() * (c * area).sum()
            candidates.append((total, factor, cost))
        return min(candidates, key=lambda candidate: candidate[:2])[1:]

    def _best_shares(self, curves: PatchCurves, area: Array, cost: Array, price: float | None) -> np.ndarray:
        """Return the index into the grid of the best share of each patch, ``(rows, columns)``."""
        allowed = allowed_weights(np.einsum("gyx,yx->g", curves.curve, area))
        blocks = (curves.rows(rows) for rows in row_blocks(len(area)))
        return np.concatenate([guarded_argmin(block, cost, self.guard, allowed, price) for block in blocks])

    def _sample_counts(
        self, pilot: Pilot, shape: tuple[int, int], factor: float, cost: Array, best: np.ndarray
    ) -> Array:
        """Return numbers of samples in proportion to ``sqrt(V / C)``, not below the floor, ``(H, W)``."""
        errors = ("square", "cross")  # not needed here
        sums = {name: a for name, a in pilot.sums.items() if name not in errors}
        means, pixels = pool(sums, shape, self.patch, self.count_sigma, self.size // 2, self._features(pilot))
        means |= dict.fromkeys(errors, np.broadcast_to(0.0, means["curve"].shape))
        curves = _patch_curves(means, pixels)
        v, c = _variance_and_cost(curves, cost, factor, pilot.shading_samples // 2, best)
        counts = np.sqrt(v / c).astype(np.float32)
        least = self.floor * counts.mean()
        return patch_spread(np.maximum(counts, least) if least > 0 else np.ones_like(counts), self.patch, shape)


def _patch_curves(means: Mapping[str, Any], pixels: Array) -> PatchCurves:
    """Return the curves of patches from the means of `dmis.variance.curves.Curves.sums` over them."""
    return PatchCurves(**means, pixels=pixels)


def _variance_and_cost(
    curves: PatchCurves, cost: Array, factor: float, shading_samples: int, best: np.ndarray | None = None
) -> tuple[Array, Array]:
    """Return variance and cost of camera samples with `factor` times the `shading_samples`, ``(rows, columns)`` each.

    They are at the index `best` into the grid; None: where variance times cost is least.
    """
    blocks = []
    for rows in row_blocks(len(curves.position)):  # some rows at a time, because curves are large
        part = curves.rows(rows).with_shading_samples(factor, shading_samples)
        variance = np.maximum(part.variance, 0)
        index = (variance * cost[:, None, None]).argmin(axis=0) if best is None else best[rows]
        blocks.append((_at_index(variance, index), cost[index]))
    v, c = (np.concatenate(a) for a in zip(*blocks, strict=True))
    return v, c


def _at_index(values: Array, index: np.ndarray) -> Array:
    """Return the values ``(G, ...)`` at an index ``(...)`` into the grid."""
    return np.take_along_axis(values, index[None], axis=0)[0]
