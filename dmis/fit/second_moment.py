"""Rules that learn weights, and numbers of samples, from one pilot at w = 1/2.

Statistics are shared between neighbours, decisions are not: what was gathered is averaged over patches and filtered,
then each patch takes its own minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dmis.base.patches import PATCH, patch_mean, patch_spread, patch_sum, row_blocks
from dmis.base.vectors import Array
from dmis.estimator.cost import camera_sample
from dmis.estimator.records import Statistic
from dmis.estimator.settings import MOST
from dmis.fit.choose_heuristic import SIDE, check_choice, choose
from dmis.fit.curve_minimum import Pooled, allowed, least
from dmis.fit.objectives import objective
from dmis.fit.pooling import check_sharing, pool
from dmis.fit.rule import Fit, Pilot, Rule, of_final
from dmis.fit.shrinkage import shrink
from dmis.variance.curves import GRID, GRID_SHARES, HALF, Curves

SPLITS = (1, 0.5, 2, 4, 8)
"""Times the shading samples that camera samples may have."""


@dataclass(frozen=True)
class Learned(Rule):
    """Weights that minimise an objective per patch.

    The objective ``second-moment`` is variance and cost, V(w) and C(w), weighed such that the image's error times its
    time is least (`dmis.fit.curve_minimum.weighed`): the pilot gives unbiased curves V(w) (`dmis.variance.curves`),
    which are averaged over patches, filtered, weighed with the cost of a camera sample at w (`dmis.estimator.cost`)
    and minimised on a grid of weights. The others, ``taylor``, ``inverse-variance``, ``neyman``, ``representativity``,
    ``kl``, ``tsallis`` and ``linear``, are those of the literature (`dmis.fit.objectives`). The closest relative of
    ``second-moment`` is Grittmann et al. 2022, "Efficiency-aware multiple importance sampling for bidirectional
    rendering algorithms" (ACM Transactions on Graphics 41(4)), where the samples of one combination of techniques give
    the efficiencies of many others.

    Parameters
    ----------
    objective
        Name of what is minimised.
    patch
        Side of a patch in pixels, a multiple of 4.
    spp
        Samples of the pilot, at w = 1/2: an even number of at least 4, see `dmis.pipeline.job.pilot_settings`.
    filter
        Of the statistics: ``gaussian`` or ``none``; or ``joint``, a Gaussian among neighbours that look alike
        (`dmis.filter.joint`, `dmis.scene.feature_buffers`).
    size, sigma
        Of the Gaussian, in patches.
    shrink
        Whether each patch's curve is moved towards that of its kind by as much as it is uncertain, after the filter
        (second-moment, see `dmis.fit.shrinkage`). Kinds are materials if the filter is ``joint``, else there is but
        one.
    cost
        Whether cost counts; otherwise variance alone.
    guard
        Leave w = 1/2 only where the gain is more than this many standard errors (second-moment).
    split
        Whether camera samples may have 2, 4 or 8 times the shading samples, and be fewer for it, or half of them, and
        be more, if that is best for the image (second-moment, and only if cost counts).
    counts
        Whether patches get different numbers of samples, in proportion to ``sqrt(V / C)`` (second-moment).
    floor
        Least number of samples of a patch, as a share of the mean.
    count_sigma
        Of the Gaussian over the variances that set the numbers of samples, in patches. Less than `sigma`, because a
        number of samples that is a little off costs little, and highlights are small.
    gamma
        Order of the divergence (tsallis); 1 is Kullback-Leibler, 2 the second moment.
    reuse
        Whether the pilot's samples are part of the image. None: as the settings say, and if these do not, where the
        final samples are independent too.
    combiner, sampler
        Of the final samples. Curves are those of the combiner if it is a heuristic (second-moment); of balance if not,
        and with ``frozen``. Of several heuristics, joined by ``+``, the pilot chooses the one that is best for the
        image, see `dmis.fit.choose_heuristic`.
    """

    objective: str = "second-moment"
    patch: int = 4
    spp: int = 6
    filter: str = "joint"
    size: int = 5
    sigma: float = 1.0
    shrink: bool = True
    cost: bool = True
    guard: float = 1.5
    split: bool = False
    counts: bool = False
    floor: float = 0.1
    count_sigma: float = 0.4
    gamma: float = 2.0
    reuse: bool | None = None
    combiner: str = "balance"
    sampler: str = ""

    def __post_init__(self) -> None:
        check_sharing(self.patch, self.size, self.sigma, self.guard)
        if self.spp < 4 or self.spp % 2:
            raise ValueError(
                f"spp of the pilot must be even and at least 4, because curves come from pairs of camera samples with "
                f"twice the shading samples; got {self.spp}"
            )
        if self.filter not in ("gaussian", "none", "joint"):
            raise ValueError(f"filter must be gaussian, none or joint; got {self.filter!r}")
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
                    raise ValueError(f"{name} needs variances, which the objective {self.objective} does not estimate")
        if "+" in self.combiner:
            check_choice(self.combiners)
        if self.filter == "gaussian" or (self.counts and not self.needs_features):
            import scipy.ndimage  # noqa: F401  what the filter needs: a fit should not take the time of an import

    @property
    def pilot(self) -> Mapping[float, int]:
        return {0.5: self.spp}

    @property
    def settings(self) -> Mapping[str, Any]:
        return {"combiner": self.combiners[0]} | of_final(self.sampler, self.reuse)

    @property
    def combiners(self) -> tuple[str, ...]:
        """Those that the pilot chooses from."""
        return tuple(self.combiner.split("+"))

    @property
    def needs_features(self) -> bool:
        """Whether the filter compares feature buffers."""
        return self.filter == "joint"

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        """What is gathered in the pilot."""
        if self.objective != "second-moment":
            return objective(self.objective, self.gamma).statistic
        return partial(Curves, combiners=self.combiners)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        found, combiner = pilot[0.5], None
        shape = found.moments.mean.shape[:2]
        if len(self.combiners) > 1:
            found, combiner = self._choose(found, shape)
        means, pixels = self._pool(found, shape, self.sigma)
        if self.objective != "second-moment":
            s, pair = found.shading_samples, [1.0, 1.0]
            if self.cost:
                pair = camera_sample(found.rays, np.array([[0, 1], [1, 0]]), s, s // 2, found.techniques).tolist()
            weight = np.clip(objective(self.objective, self.gamma).solve(means, (pair[0], pair[1])), 0, 1)
            return Fit(patch_spread(weight, self.patch, shape), {"patch": weight})
        curves = _pooled(means, pixels)
        area = patch_sum(np.ones(shape), self.patch)  # not `pixels`, which says how sure means are
        times, cost = self._split(curves, area, found)
        curves = self._prepare(curves, times, found)
        variance = curves.variance
        half = (np.maximum(variance[HALF], 0) * area).sum() / area.sum()
        price = None if self.counts else half / cost[HALF]
        best = self._least(curves, area, cost, price)
        weight = GRID[best]
        del means, curves  # they are large
        samples = None
        if self.counts:
            guides = found.guides if self.needs_features else None
            errors = ("square", "cross")  # which numbers of samples do without
            known = {name: a for name, a in found.sums.items() if name not in errors}
            sharp, n = pool(known, shape, self.patch, self.count_sigma, self.size // 2, guides)
            sharp |= dict.fromkeys(errors, np.broadcast_to(0.0, sharp["curve"].shape))
            v, c = _at(_pooled(sharp, n), cost, times, found.shading_samples // 2, best)
            samples = self._shares(np.sqrt(v / c), shape)
        maps = {"patch": weight, "variance": np.maximum(_take(variance, best), 0), "variances": variance}
        return Fit(patch_spread(weight, self.patch, shape), maps, samples, times, combiner)

    def _choose(self, pilot: Pilot, shape: tuple[int, int]) -> tuple[Pilot, str]:
        """The best combiner for the image, and what the pilot says of it."""
        each = [
            {name: a if name == "position" else a[k] for name, a in pilot.sums.items()}
            for k in range(len(self.combiners))
        ]
        area, found = patch_sum(np.ones(shape), SIDE), []
        for sums in each:
            means, pixels = pool(sums, shape, SIDE)
            curves = _pooled(means, pixels)
            times, cost = self._split(curves, area, pilot)
            found.append(_at(curves, cost, times, pilot.shading_samples // 2))
        variance, cost = (np.stack(a) for a in zip(*found, strict=True))
        k = choose(variance, cost, area, self.counts)
        return replace(pilot, sums=each[k]), self.combiners[k]

    def _prepare(self, curves: Pooled, times: float, pilot: Pilot) -> Pooled:
        """Return the curves for `times` the shading samples, shrunk if the rule is; those given may be written to."""
        s = pilot.shading_samples // 2
        if not self.shrink:
            return curves.split(times, s)
        material = pilot.guides.get("material") if self.needs_features else None
        kinds = None if material is None else patch_mean(material, self.patch // PATCH)
        return shrink(curves, kinds, lambda part: part.split(times, s), in_place=True)

    def _split(self, curves: Pooled, area: Array, pilot: Pilot) -> tuple[float, Array]:
        """Return how many times the shading samples are best for the image, and the cost of camera samples with them at
        the weights of the grid, ``(G,)``.
        """
        found = []
        s = pilot.shading_samples // 2
        for times in (t for t in SPLITS if t == 1 or (self.split and self.cost and s * t <= MOST)):
            cost = np.ones(len(GRID))
            if self.cost:
                cost = camera_sample(pilot.rays, GRID_SHARES, pilot.shading_samples, s * times, pilot.techniques)
            v, c = _at(curves, cost, times, s)
            total = (np.sqrt(v * c) * area).sum() ** 2
            if not self.counts:
                total = (v * area).sum() * (c * area).sum()
            found.append((total, times, cost))
        return min(found, key=lambda one: one[:2])[1:]

    def _pool(self, pilot: Pilot, shape: tuple[int, int], sigma: float) -> tuple[dict[str, Array], Array]:
        guides = pilot.guides if self.needs_features else None
        wide = sigma if self.filter in ("gaussian", "joint") else None
        return pool(pilot.sums, shape, self.patch, wide, self.size // 2, guides)

    def _least(self, curves: Pooled, area: Array, cost: Array, price: float | None) -> np.ndarray:
        may = allowed(np.einsum("gyx,yx->g", curves.curve, area))
        blocks = (curves.rows(rows) for rows in row_blocks(len(area)))
        return np.concatenate([least(block, cost, self.guard, may, price) for block in blocks])

    def _shares(self, wanted: Array, shape: tuple[int, int]) -> Array:
        """Numbers of samples in proportion to `wanted`, not below the floor."""
        wanted = wanted.astype(np.float32)
        least = self.floor * wanted.mean()
        return patch_spread(np.maximum(wanted, least) if least > 0 else np.ones_like(wanted), self.patch, shape)


def _pooled(means: Mapping[str, Any], pixels: Array) -> Pooled:
    """Return the curves of patches from the means of `dmis.variance.curves.Curves.sums` over them."""
    return Pooled(**means, pixels=pixels)


def _at(
    curves: Pooled, cost: Array, times: float, shading_samples: int, best: np.ndarray | None = None
) -> tuple[Array, Array]:
    """Return variance and cost of camera samples with `times` the `shading_samples`, at the index `best` into the grid;
    None: where variance times cost is least. Some rows at a time.
    """
    found = []
    for rows in row_blocks(len(curves.position)):
        variance = np.maximum(curves.rows(rows).split(times, shading_samples).variance, 0)
        index = (variance * cost[:, None, None]).argmin(axis=0) if best is None else best[rows]
        found.append((_take(variance, index), cost[index]))
    v, c = (np.concatenate(a) for a in zip(*found, strict=True))
    return v, c


def _take(values: Array, index: np.ndarray) -> Array:
    """Return the values ``(G, ...)`` at an index ``(...)`` into the grid."""
    return np.take_along_axis(values, index[None], axis=0)[0]
