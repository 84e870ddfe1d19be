"""Oracle: converged variance curves of an image, the best weights by them, and the harm of other weights.

The curves V(w) give the error of any share map without rendering it; `dmis.experiment.oracle_renders` makes them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dmis.base.patches import patch_mean, patch_sum
from dmis.base.vectors import Array
from dmis.variance.curves import GRID

HARM_LIMIT = 1.02
"""Ratio of the variance of a weight to that of w = 1/2 above which the weight counts as harmful."""


@dataclass(frozen=True, eq=False)
class Oracle:
    """Converged curves V(w) of an image, for one combiner.

    Attributes
    ----------
    variance
        Variance of a camera sample at the shares of `dmis.variance.curves.GRID`, per patch, ``(G, rows, columns)``, of
        the mean of the channels' radiance.
    cost
        Cost of a camera sample at these shares, ``(G,)``, or in each patch, as `variance`; see `dmis.estimator.cost`.
    patch
        Side of a patch in pixels.
    spp
        Samples per pixel of the pilot.
    shape
        ``(H, W)`` of the image: patches at its border may be smaller, and count for less; None: all are whole.
    weight
        Pixels that each patch stands for, ``(rows, columns)``; None: its own.
    """

    variance: Array
    cost: Array
    patch: int
    spp: int
    shape: tuple[int, int] | None = None
    weight: Array | None = field(default=None, kw_only=True)

    @cached_property
    def pixel_share(self) -> Array:
        """Share of the image's pixels in each patch, ``(rows, columns)``."""
        rows, columns = self.variance.shape[1:]
        area = self.weight
        if area is None:
            area = patch_sum(np.ones(self.shape or (rows * self.patch, columns * self.patch)), self.patch)
        return area / area.sum()

    @cached_property
    def costs(self) -> Array:
        """Cost of a camera sample in each patch, ``(G, rows, columns)``."""
        return np.broadcast_to(self.cost if self.cost.ndim > 1 else self.cost[:, None, None], self.variance.shape)

    @property
    def half(self) -> int:
        """Index of w = 1/2 in the grid, its middle."""
        return len(self.variance) // 2

    def mean(self, values: Array) -> float:
        """Return the mean over the image of values per patch."""
        return float((values * self.pixel_share).sum())

    def best(self) -> Array:
        """Return the weight of least variance per patch, ``(rows, columns)``."""
        return GRID[self.best_index()]

    def best_index(self, costly: bool = False) -> np.ndarray:
        """Return the indices in the grid of `best`.

        If `costly`, of the map of least variance of the image times its cost, with the same number of samples in all
        patches.
        """
        best = self.variance.argmin(axis=0)
        for _ in range(10 if costly else 0):  # the price of cost depends on the map: a fixed point
            price = self.mean(_at_index(self.variance, best)) / self.mean(_at_index(self.costs, best))
            best = (self.variance + price * self.costs).argmin(axis=0)
        return best

    def at(self, weight: Array | float) -> Array:
        """Return the variance of a camera sample per patch at a share map ``(H, W)``, or at one share for all."""
        rows, columns = self.variance.shape[1:]
        w = patch_mean(np.asarray(weight), self.patch) if np.ndim(weight) else np.full((rows, columns), float(weight))
        return between(self.variance, w)

    def limit(self, costly: bool = False) -> float:
        """Return the variance of the image with the best weights over that with w = 1/2, at equal samples.

        If `costly`, in equal time by the cost model, without a pilot. 1 where there is no variance.
        """
        best = self.best_index(costly)
        cost = self.mean(_at_index(self.costs, best)) / self.mean(self.costs[self.half]) if costly else 1.0
        half = self.mean(self.variance[self.half])
        return float(self.mean(_at_index(self.variance, best)) / half * cost) if half > 0 else 1.0

    def limit_with_counts(self) -> float:
        """Return variance times cost with the best weights and allocation, over that with w = 1/2 and even samples.

        That is ``mean(sqrt(V C))^2 / (mean(V) C)`` without a pilot; 1 if there is no variance.
        """
        half = self.mean(self.variance[self.half])
        if not half > 0:
            return 1.0
        # n ~ sqrt(V / C)   (docs/theory.md, Eq. 20)
        least = (np.maximum(self.variance, 0) * self.costs).min(axis=0)
        return self.mean(np.sqrt(least)) ** 2 / (half * self.mean(self.costs[self.half]))

    def harm(self, weight: Array) -> tuple[float, float]:
        """Return the share of lit patches that a share map harms, and its standard error; 0 if no patch is lit.

        A patch is harmed if its variance is more than `HARM_LIMIT` times that of w = 1/2.
        """
        lit = self.variance[self.half] > 0
        if not lit.any():
            return 0.0, 0.0
        harmed = (self.at(weight) > HARM_LIMIT * self.variance[self.half])[lit]
        return float(harmed.mean()), float(harmed.std() / np.sqrt(harmed.size))


def between(curves: Array, weight: Array) -> Array:
    """Return curves ``(G, rows, columns)`` at shares ``(rows, columns)``, linear between the shares of `GRID`."""
    k = np.clip(np.searchsorted(GRID, weight, "right") - 1, 0, len(GRID) - 2)
    low, high = (_at_index(curves, i) for i in (k, k + 1))
    return low + (weight - GRID[k]) / (GRID[k + 1] - GRID[k]) * (high - low)


def _at_index(values: Array, index: np.ndarray) -> Array:
    """Return the values ``(G, ...)`` at an index ``(...)`` into the grid."""
    return np.take_along_axis(values, index[None], axis=0)[0]
