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
from pathlib import Path

import numpy as np

from dmis import __version__
from dmis.cost import camera_sample
from dmis.curves import GRID, HALF
from dmis.learned import Learned
from dmis.reference import SEED, cache_folder
from dmis.render import Progress, fingerprint, render
from dmis.scene import Scene
from dmis.variance import patch_mean
from dmis.vec import Array

HARM = 1.02
"""A weight does harm where the variance it gives is more than this times that of w = 1/2."""


@dataclass(frozen=True, eq=False)
class Oracle:
    """True curves of an image.

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
    """

    variance: Array
    cost: Array
    patch: int
    spp: int

    def best(self, costly: bool = False) -> Array:
        """The weight of least variance per patch, ``(rows, columns)``; of least variance times cost if `costly`."""
        curves = self.variance * (self.cost[:, None, None] if costly else 1)
        return GRID[curves.argmin(axis=0)]

    def at(self, weight: Array | float) -> Array:
        """Variance of a camera sample per patch at a weight map ``(H, W)``, or at one weight for all."""
        rows, columns = self.variance.shape[1:]
        w = (
            np.full((rows, columns), float(weight))
            if np.ndim(weight) == 0
            else patch_mean(np.asarray(weight), self.patch)
        )
        k = np.clip(np.searchsorted(GRID, w, "right") - 1, 0, len(GRID) - 2)
        t = (w - GRID[k]) / (GRID[k + 1] - GRID[k])
        low, high = (np.take_along_axis(self.variance, i[None], axis=0)[0] for i in (k, k + 1))
        return low + t * (high - low)

    def saving(self, weight: Array) -> float:
        """Share of the best weights' saving over w = 1/2 that a weight map reaches: 1 is the oracle, 0 is 1/2."""
        half = self.variance[HALF].sum()
        return float((half - self.at(weight).sum()) / (half - self.variance.min(axis=0).sum()))

    def limit(self) -> float:
        """Variance of the image with the best weights over that with w = 1/2, at equal samples."""
        return float(self.variance.min(axis=0).sum() / self.variance[HALF].sum())

    def regret(self, weight: Array) -> Array:
        """Variance beyond that of the best weight, over that of w = 1/2, per patch; 0 in black patches."""
        excess = self.at(weight) - self.variance.min(axis=0)
        return np.divide(excess, self.variance[HALF], out=np.zeros_like(excess), where=self.variance[HALF] > 0)

    def harm(self, weight: Array) -> tuple[float, float]:
        """Share of lit patches whose variance is more than `HARM` times that of w = 1/2, and its standard error."""
        lit = self.variance[HALF] > 0
        harmed = (self.at(weight) > HARM * self.variance[HALF])[lit]
        return float(harmed.mean()), float(harmed.std() / np.sqrt(max(harmed.size, 1)))


def make_oracle(
    scene: Scene,
    spp: int = 2048,
    patch: int = 4,
    *,
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
    folder, threads, progress
        See `dmis.reference.make_reference`.
    """
    path = _path(scene, spp, patch, folder)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        rule = Learned(patch=patch, spp=spp, filter="none", shrink=False)
        kept = path.with_suffix(".checkpoint")
        result = render(scene, rule, spp + 1, seed=SEED + 2, threads=threads, progress=progress, checkpoint=kept)
        rays = json.dumps(result.provenance["pilot_rays"])
        np.savez(path, variance=result.maps["variances"].astype(np.float32), rays=np.array(rays))
    with np.load(path, allow_pickle=False) as file:
        rays_by_kind: Mapping[str, int] = json.loads(str(file["rays"]))
        return Oracle(file["variance"].astype(np.float64), camera_sample(rays_by_kind, GRID), patch, spp)


def cached_oracle(scene: Scene, patch: int = 4, *, folder: str | os.PathLike[str] | None = None) -> Oracle | None:
    """The oracle of `scene` that is on disk already, that of most samples (a power of two to 16384), or None."""
    for spp in (2**k for k in range(14, 5, -1)):
        if _path(scene, spp, patch, folder).exists():
            return make_oracle(scene, spp, patch, folder=folder)
    return None


def _path(scene: Scene, spp: int, patch: int, folder: str | os.PathLike[str] | None) -> Path:
    width, height = scene.camera.resolution
    digest = hashlib.sha256(json.dumps([__version__, fingerprint(scene), spp, patch]).encode()).hexdigest()[:12]
    return cache_folder(folder) / f"{scene.name}-{width}x{height}-oracle-{digest}.npz"
