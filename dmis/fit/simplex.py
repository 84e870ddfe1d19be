"""The rule ``simplex``: shares of K techniques per patch, where the variance times cost is least."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from dmis.base.patches import PATCH, patch_mean, patch_spread, patch_sum, row_blocks
from dmis.base.vectors import Array
from dmis.estimator import technique
from dmis.estimator.cost import camera_sample
from dmis.estimator.records import Statistic
from dmis.fit.curve_minimum import Pooled, least
from dmis.fit.pooling import check_sharing, pool
from dmis.fit.rule import Fit, Pilot, Rule, Weight, of_final
from dmis.fit.shrinkage import shrink
from dmis.variance.simplex_curves import SimplexCurves, baseline_point, grid

PRICES = 2.0 ** -np.arange(6)
"""Of cost in variance, times that at `baseline_point`."""


def allowed(curve: Array, inside: np.ndarray) -> np.ndarray:
    """Which points of the grid may be used, ``(G,)`` bool, by the curve of the whole image ``(G,)``: those that leave
    techniques out only if they are as good for the image as those that just do not, see
    `dmis.fit.curve_minimum.allowed`.
    """
    return curve <= curve[inside]


def cheapest(curves: Pooled, cost: Array, guard: float, may: np.ndarray, area: Array) -> np.ndarray:
    """Points of the grid, ``(rows, columns)``, for which the image's error times its time is least, ``sum V sum C``
    over patches of the `area` ``(rows, columns)`` in pixels.

    Patches minimise ``V + price C`` (`dmis.fit.curve_minimum.weighed`). At the minimum the price is ``sum V / sum C``
    there, which may be far from that at `baseline_point`: a technique that costs twice as much may have a quarter of
    the variance. So prices from that at the baseline point downwards are tried.
    """
    variance = np.maximum(curves.variance, 0)
    home_price = (variance[curves.half] * area).sum() / area.sum() / cost[curves.half]
    found = []
    for price in home_price * PRICES:
        index = np.concatenate([least(curves.rows(rows), cost, guard, may, price) for rows in row_blocks(len(area))])
        error = (np.take_along_axis(variance, index[None], axis=0)[0] * area).sum()
        found.append((error * (cost[index] * area).sum(), index))
    return min(found, key=lambda one: one[0])[1]


@dataclass(frozen=True)
class Simplex(Rule):
    """Shares of several techniques that minimise variance and cost per patch, as `dmis.fit.second_moment.Learned` does
    for two.

    Parameters
    ----------
    mix
        Names of the techniques, joined by ``+``.
    spp
        Samples of the pilot, at equal shares: an even multiple of K of at least 2 K, which become camera samples with
        K times the shading samples, K times fewer.
    patch, filter, size, sigma, shrink, cost, guard, reuse, combiner, sampler
        See `dmis.fit.second_moment.Learned`; `filter` is ``joint``, ``gaussian`` or ``none``. What the `guard` keeps
        is `baseline_point`.

    Notes
    -----
    The maps of its `Fit` are ``patch``, shares of all techniques ``(K, rows, columns)``, ``variance``, and
    ``variances`` ``(G, rows, columns)``.
    """

    mix: str = "light+brdf+resampled"
    patch: int = 4
    spp: int = 6
    filter: str = "joint"
    size: int = 5
    sigma: float = 1.0
    shrink: bool = True
    cost: bool = True
    guard: float = 1.5
    reuse: bool | None = None
    combiner: str = "balance"
    sampler: str = ""
    multi_technique = True

    def __post_init__(self) -> None:
        names = self.techniques
        for name in names:
            technique.find(name)
        if len(names) < 2 or len(set(names)) < len(names):
            raise ValueError(f"mix must be two or more different techniques joined by +; got {self.mix!r}")
        check_sharing(self.patch, self.size, self.sigma, self.guard)
        if self.spp < 2 * len(names) or self.spp % 2 or self.spp % len(names):
            raise ValueError(
                f"spp of the pilot must be an even multiple of {len(names)}, the number of techniques, and at least "
                f"{2 * len(names)}; got {self.spp}"
            )
        if self.filter not in ("gaussian", "none", "joint"):
            raise ValueError(f"filter must be gaussian, none or joint; got {self.filter!r}")

    @property
    def techniques(self) -> tuple[str, ...]:
        """Their names, in the order of the shares."""
        return tuple(self.mix.split("+"))

    @property
    def pilot(self) -> Mapping[Weight, int]:
        k = len(self.techniques)
        return {0.5 if k == 2 else (1 / k,) * k: self.spp}

    @property
    def settings(self) -> Mapping[str, Any]:
        return {"combiner": self.combiner, "techniques": self.techniques} | of_final(self.sampler, self.reuse)

    @property
    def needs_features(self) -> bool:
        """Whether the filter compares feature buffers."""
        return self.filter == "joint"

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        """What is gathered in the pilot."""
        return partial(SimplexCurves, exact=self._exact)

    @property
    def _exact(self) -> tuple[bool, ...]:
        return tuple(technique.find(name).exact for name in self.techniques)

    def fit(self, pilot: Mapping[Weight, Pilot]) -> Fit:
        (found,) = pilot.values()
        shape = found.moments.mean.shape[:2]
        guides = found.guides if self.needs_features else None
        means, pixels = pool(
            found.sums, shape, self.patch, None if self.filter == "none" else self.sigma, self.size // 2, guides
        )
        shares, inside = grid(len(self.techniques))
        at = baseline_point(self._exact)
        curves = Pooled(**means, pattern=np.zeros(()), pixels=pixels, half=at)
        if self.shrink:
            material = found.guides.get("material") if self.needs_features else None
            kinds = None if material is None else patch_mean(material, self.patch // PATCH)
            curves = shrink(curves, kinds, in_place=True)
        cost = np.ones(shares.shape[1])
        if self.cost:
            s = found.shading_samples
            cost = camera_sample(found.rays, shares, s, s // len(self.techniques), self.techniques)
        area = patch_sum(np.ones(shape), self.patch)
        may = allowed((curves.curve * area).sum(axis=(1, 2)), inside)
        index = cheapest(curves, cost, self.guard, may, area)
        patches = shares[:, index]
        weight = np.stack([patch_spread(share, self.patch, shape) for share in patches])
        maps = {
            "patch": patches,
            "variance": np.maximum(np.take_along_axis(curves.variance, index[None], axis=0)[0], 0),
            "variances": curves.variance,
        }
        return Fit(weight, maps)
