"""Error times counted time of any map of shares and numbers of samples, from curves of variance and cost per patch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dmis.base.patches import patch_mean
from dmis.base.vectors import Array
from dmis.estimator.cost import RAY, UNTRACED, camera_sample_cost
from dmis.estimator.records import Record, Statistic
from dmis.estimator.settings import Settings
from dmis.estimator.technique import technique_by_name
from dmis.experiment.oracle import Oracle, between
from dmis.fit.round import Fit, Pilot
from dmis.fit.second_moment import SecondMoment
from dmis.pipeline.render import render
from dmis.scene.scene import Scene
from dmis.variance.curves import GRID, GRID_SHARES, HALF, Curves

MOST_SAMPLES = 16
"""Largest number of samples of a patch in `ErrorTime.best_with_samples`, over the mean; its inverse is the smallest."""
EPSILON = 0.01
"""Bound of the denominator of relative errors, as of `dmis.experiment.metrics.relmse`."""
_SPP = 256
"""Camera samples per pixel from which rays are counted and errors are compared."""


class ErrorTime(Oracle):
    """An oracle whose cost differs from patch to patch, ``(G, rows, columns)``; variances are absolute or relative."""

    def value(self, weight: Array, samples: Array | float = 1.0) -> float:
        """Return error times time over that of w = 1/2 and even samples, at shares and numbers per patch."""
        # mean(V / n) mean(n C)
        error, time = between(self.variance, weight) / samples, between(self.cost, weight) * samples
        half = self.mean(self.variance[HALF]) * self.mean(self.cost[HALF])
        return self.mean(error) * self.mean(time) / half

    def best_even(self) -> Array:
        """Return the best shares per patch, ``(rows, columns)``, with even samples.

        They are those of `GRID` without its ends: where one technique alone misses a light, its variance is in samples
        too rare to be seen, and the best share by some samples may be the worst by others.
        """
        inner = replace(self, variance=self.variance[1:-1], cost=self.cost[1:-1])
        return GRID[1:-1][inner.best_index(costly=True)]

    def best_with_samples(self) -> tuple[Array, Array]:
        """Return the best shares and numbers of samples per patch, ``(rows, columns)`` each, the numbers of mean 1."""
        # n ~ sqrt(V / C),  w = argmin V C   (docs/theory.md, Eq. 20)
        w = GRID[1:-1][(np.maximum(self.variance, 0) * self.cost)[1:-1].argmin(axis=0)]
        v, c = np.maximum(between(self.variance, w), 0), between(self.cost, w)
        n = np.sqrt(np.divide(v, c, out=np.zeros_like(v), where=c > 0))
        return w, np.clip(n / max(self.mean(n), 1e-30), 1 / MOST_SAMPLES, MOST_SAMPLES)


def measure_patches(scene: Scene, patch: int, settings: Settings, **options: Any) -> tuple[Array, Array]:
    """Return the cost of a camera sample, and its relative variance over its absolute, ``(G, rows, columns)`` each.

    The cost is that of `dmis.estimator.cost` with the rays of each patch; where nothing can be seen it is 0, because
    nothing is sampled there. Relative variance is that of a pixel over its squared brightness + `EPSILON`. `options`
    are those of `dmis.pipeline.render.render`.
    """
    rule = _PatchMaps(gain=scene.in_float32[1], spp=2 * _SPP, patch=patch, filter="none", combiner=settings.combiner)
    result = render(scene, rule, 2 * _SPP + 1, settings=settings, sampler="independent", **options)
    shape, s = result.image.shape[:2], settings.shading_samples
    covered = np.ones(shape) if scene.covered_pixels is None else scene.covered_pixels.astype(np.float64)
    rays = dict(result.provenance["pilot_rays"])
    for kind in (UNTRACED, *(technique_by_name(name).rays for name in settings.techniques)):  # these differ by patch
        rays.pop(kind, None)
    always = camera_sample_cost(rays, GRID_SHARES, 2 * s, s, settings.techniques)
    # s of the 2 s shading samples of a camera sample are of one technique; at the shares w_k they are w_k s
    of_rays = RAY * np.einsum("kg,kyx->gyx", GRID_SHARES, result.maps["rays"])
    absolute, relative = (np.maximum(result.maps[name], 0) for name in ("absolute", "relative"))
    little = 1e-4 * max(float(absolute[HALF].mean()), 1e-30)  # where there is no variance, all pixels count the same
    factor = (relative + little * result.maps["weight"]) / (absolute + little)
    return patch_mean(covered, patch) * always[:, None, None] + of_rays, factor


@dataclass(frozen=True)
class _PatchMaps(SecondMoment):
    """Rule whose maps are means over patches of what `_PixelSums` gathers, per camera sample; w is 1/2."""

    gain: float = 1.0

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        return partial(_PixelSums, combiner=self.combiner, gain=self.gain)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        """Return equal shares, and the maps."""
        return Fit(0.5, self._pool(pilot[0.5])[0])


class _PixelSums(Curves):
    """Shadow rays of each technique, and variance curves in both measures; radiance times `gain` is the image's."""

    def __init__(self, pixels: int, shading_samples: int, combiner: str, gain: float) -> None:
        super().__init__(pixels, shading_samples, combiner)
        self._rays, self._radiance, self._gain = np.zeros((2, pixels)), np.zeros(pixels), gain

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block of `count` camera samples of every pixel, sample-major."""
        super().add(records, radiance, count)
        pixels = len(self._radiance)
        self._radiance += radiance.mean(axis=0, dtype=np.float64).reshape(count, -1).sum(axis=0) * self._gain
        pixel = np.arange(count * pixels) % pixels
        for record in records:
            # a ray is traced where the surface reflects: there the density of the other technique is not 0
            traced = pixel[slice(None) if record.sample is None else record.sample][record.pdf.min(axis=0) > 0]
            self._rays[record.technique_index] += np.bincount(traced, minlength=pixels)

    def sums(self) -> dict[str, Array]:
        """Return ``rays`` ``(2, P)``, both variances ``(G, P)``, and their ratio ``weight`` ``(P,)``."""
        curves, n = super().sums(), max(self._n, 1)
        # V(w) = curve + Var_y(I);  relMSE: V / (I^2 + epsilon)
        variance, weight = curves["curve"] + curves["position"], 1 / ((self._radiance / n) ** 2 + EPSILON)
        return {"rays": self._rays / n, "absolute": variance, "relative": variance * weight, "weight": weight}
