"""The oracle: variance curves from very many samples, what the best weights would be, and what a rule loses to them.

Curves are those of `dmis.curves`, from a pilot of thousands of samples per pixel and random numbers of its own, kept
on disk like references. With them the error of any weight map is known without rendering it.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from dmis import __version__
from dmis.checks import whole
from dmis.cost import camera_sample
from dmis.curves import GRID, HALF
from dmis.files import replacing
from dmis.learned import Learned
from dmis.passes import Progress
from dmis.pooled import weighed
from dmis.reference import SEED, cache_folder, described
from dmis.render import fingerprint, render
from dmis.scene import Scene
from dmis.settings import Settings
from dmis.variance import patch_mean, patch_sum
from dmis.vec import Array

HARM = 1.02
"""A weight does harm where the variance it gives is more than this times that of w = 1/2."""


@dataclass(frozen=True, eq=False)
class Oracle:
    """True curves of an image, with one combiner.

    Attributes
    ----------
    variance
        Of a camera sample at the weights of `dmis.curves.GRID`, per patch, ``(G, rows, columns)``, as the mean of the
        channels' radiance.
    cost
        Of a camera sample at these weights, ``(G,)``, see `dmis.cost`.
    patch
        Side of a patch in pixels.
    spp
        Samples per pixel that the curves are made of.
    shape
        ``(H, W)`` of the image: patches at its border may be smaller, and count for less; None: all are whole.
    apart
        In path tracing, the same as `variance`, ``(2, G, rows, columns)``, if only the first surface has that weight,
        and if only those behind it have, all others 1/2; None: paths do not go on.
    """

    variance: Array
    cost: Array
    patch: int
    spp: int
    shape: tuple[int, int] | None = None
    apart: Array | None = None

    @cached_property
    def _share(self) -> Array:
        """Of the image's pixels that each patch has, ``(rows, columns)``."""
        rows, columns = self.variance.shape[1:]
        area = patch_sum(np.ones(self.shape or (rows * self.patch, columns * self.patch)), self.patch)
        return area / area.sum()

    def _mean(self, values: Array) -> float:
        """Mean over the image of what patches have."""
        return float((values * self._share).sum())

    def best(self, costly: bool = False) -> Array:
        """The weight of least variance per patch, ``(rows, columns)``; if `costly`, the map of least variance of the
        image times its cost, with the same number of samples in all patches.
        """
        return GRID[self._best(costly)]

    def _best(self, costly: bool) -> np.ndarray:
        best = self.variance.argmin(axis=0)
        for _ in range(10 if costly else 0):  # the price of cost depends on the map: a fixed point
            variance = np.take_along_axis(self.variance, best[None], axis=0)[0]
            price = self._mean(variance) / self._mean(self.cost[best])
            best = weighed(self.variance, self.cost, price).argmin(axis=0)
        return best

    def best_apart(self) -> Array:
        """The weights of least variance of the first and of later surfaces, ``(2, rows, columns)``."""
        return GRID[self._apart.argmin(axis=1)]

    def at(self, weight: Array | float, later: Array | float | None = None) -> Array:
        """Variance of a camera sample per patch at a weight map ``(H, W)``, or at one weight for all; with another
        one for later surfaces.
        """
        if later is None:
            return self._at(self.variance, weight)
        first, behind = self._apart
        return self._at(first, weight) + self._at(behind, later) - self.variance[HALF]

    @property
    def _apart(self) -> Array:
        if self.apart is None:
            raise ValueError("the oracle knows of one weight only; one of path tracing with max_depth > 1 knows of two")
        return self.apart

    def _at(self, curves: Array, weight: Array | float) -> Array:
        rows, columns = curves.shape[1:]
        w = (
            np.full((rows, columns), float(weight))
            if np.ndim(weight) == 0
            else patch_mean(np.asarray(weight), self.patch)
        )
        k = np.clip(np.searchsorted(GRID, w, "right") - 1, 0, len(GRID) - 2)
        t = (w - GRID[k]) / (GRID[k + 1] - GRID[k])
        low, high = (np.take_along_axis(curves, i[None], axis=0)[0] for i in (k, k + 1))
        return low + t * (high - low)

    def saving(self, weight: Array, combined: Oracle | None = None) -> float:
        """Share of the best weights' saving over w = 1/2 that a weight map reaches: 1 is the oracle, 0 is 1/2.

        `combined` is the oracle of the combiner that the weights are used with; None: this one. With another than this
        one's combiner the share may be more than 1. NaN where no weight saves anything.
        """
        half = self._mean(self.variance[HALF])
        most = half - self._mean(self.variance.min(axis=0))
        return (half - self._mean((combined or self).at(weight))) / most if most > 0 else float("nan")

    def limit(self, apart: bool = False, costly: bool = False) -> float:
        """Variance of the image with the best weights over that with w = 1/2, at equal samples; `costly`: in equal
        time by the cost model, without a pilot; `apart`: with weights of their own for later surfaces. 1 where there is
        no variance.
        """
        half = self._mean(self.variance[HALF])
        if not half > 0:
            return 1.0
        if costly:
            best = self._best(costly)
            variance = self._mean(np.take_along_axis(self.variance, best[None], axis=0)[0])
            return float(variance / half * self._mean(self.cost[best]) / self.cost[HALF])
        if apart:
            return (self._mean(self._apart.min(axis=1).sum(axis=0)) - half) / half
        return self._mean(self.variance.min(axis=0)) / half

    def spread_evenly(self) -> float:
        """What is left of the variance with w = 1/2 if the samples of patches are in proportion to its root, at equal
        samples: ``mean(sqrt V)^2 / mean(V)``; 1 where there is no variance.
        """
        half = np.maximum(self.variance[HALF], 0)
        return self._mean(np.sqrt(half)) ** 2 / self._mean(half) if half.any() else 1.0

    def limit_with_counts(self) -> float:
        """Variance of the image times its cost with the best weights and numbers of samples together, over those with
        w = 1/2 and the same number everywhere, without a pilot: ``mean(sqrt(V C))^2 / (mean(V) C)``, see
        `dmis.pooled.weighed`; 1 where there is no variance.
        """
        half = self._mean(self.variance[HALF])
        if not half > 0:
            return 1.0
        least = weighed(np.maximum(self.variance, 0), self.cost, None).min(axis=0)
        return float(self._mean(np.sqrt(least)) ** 2 / (half * self.cost[HALF]))

    def regret(self, weight: Array) -> Array:
        """Variance beyond that of the best weight, over that of w = 1/2, per patch; 0 in black patches."""
        excess = self.at(weight) - self.variance.min(axis=0)
        return np.divide(excess, self.variance[HALF], out=np.zeros_like(excess), where=self.variance[HALF] > 0)

    def harm(self, weight: Array, combined: Oracle | None = None) -> tuple[float, float]:
        """Share of lit patches whose variance is more than `HARM` times that of w = 1/2, and its standard error; 0 if
        none is lit.

        `combined` as in `saving`.
        """
        lit = self.variance[HALF] > 0
        if not lit.any():
            return 0.0, 0.0
        harmed = ((combined or self).at(weight) > HARM * self.variance[HALF])[lit]
        return float(harmed.mean()), float(harmed.std() / np.sqrt(harmed.size))


def make_oracle(
    scene: Scene,
    spp: int = 2048,
    patch: int = 4,
    *,
    combiner: str = "balance",
    settings: Settings | None = None,
    folder: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Oracle:
    """The oracle of `scene`: rendered once, read from disk afterwards.

    Parameters
    ----------
    spp
        Samples per pixel, an even number.
    patch
        Side of a patch in pixels, a multiple of 4.
    combiner
        Heuristic of the curves; the random numbers are the same for all.
    settings, folder, threads, progress
        See `dmis.reference.make_reference`.
    """
    spp, patch = whole("spp", spp, 1), whole("patch", patch, 1)
    path = _path(scene, spp, patch, settings, folder, combiner)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        rule = Learned(patch=patch, spp=spp, filter="none", shrink=False, bounces="separate", combiner=combiner)
        kept = path.with_suffix(".checkpoint")
        result = render(
            scene, rule, spp + 1, seed=SEED + 2, settings=settings,
            threads=threads, progress=progress, checkpoint=kept,
        )  # fmt: skip
        rays = json.dumps(result.provenance["pilot_rays"])
        with replacing(path) as partial, open(partial, "wb") as out:
            np.savez(out, variance=result.maps["variances"].astype(np.float32), rays=np.array(rays))
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as held:
            rays_by_kind: Mapping[str, int] = json.loads(str(held["rays"]))
            variance = held["variance"].astype(np.float64)
    except Exception as error:  # whatever a damaged archive makes the reader say
        raise ValueError(f"oracle {path} cannot be read: {error}; remove it to render it again") from error
    settings = scene.plan.settle(settings or Settings())
    s, shape = settings.shading_samples, scene.camera.resolution[::-1]
    cost = camera_sample(rays_by_kind, GRID, 2 * s, s, settings.techniques)
    if variance.ndim == 3:
        return Oracle(variance, cost, patch, spp, shape)
    return Oracle(variance.sum(axis=0) - variance[0, HALF], cost, patch, spp, shape, variance)


def cached_oracle(
    scene: Scene,
    patch: int = 4,
    *,
    settings: Settings | None = None,
    folder: str | os.PathLike[str] | None = None,
) -> Oracle | None:
    """The oracle of `scene` that is on disk already, that of most samples (a power of two to 16384), or None."""
    for spp in (2**k for k in range(14, 5, -1)):
        if _path(scene, spp, patch, settings, folder).exists():
            return make_oracle(scene, spp, patch, settings=settings, folder=folder)
    return None


def _path(
    scene: Scene,
    spp: int,
    patch: int,
    settings: Settings | None,
    folder: str | os.PathLike[str] | None,
    combiner: str = "balance",
) -> Path:
    width, height = scene.camera.resolution
    other = [] if combiner == "balance" else [combiner]
    key = json.dumps([__version__, fingerprint(scene), spp, patch, *described(settings), *other])
    digest = hashlib.sha256(key.encode()).hexdigest()[:12]
    return cache_folder(folder) / f"{scene.name}-{width}x{height}-oracle-{digest}.npz"
