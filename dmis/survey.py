"""A look at a scene before it is rendered: how much light its surfaces send each other, and what a sample costs.

A thumbnail is rendered by both integrators. It recommends; what is provably needed or not is known to `dmis.plan`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dmis.cost import UNSEEN, camera_sample
from dmis.settings import DEPTH, Settings
from dmis.vec import Array

if TYPE_CHECKING:
    from dmis.scene import Scene

PIXELS, BLOCK, SPP = 768, 8, 4
"""Of the thumbnail: its size, about, the side of the blocks in which it is compared, its samples."""
MATTERS = 0.1
"""Share of indirect light from which on paths are recommended."""


@dataclass(frozen=True)
class Survey:
    """What a thumbnail tells.

    Attributes
    ----------
    indirect
        Share of the light that direct lighting misses, the mean over all blocks of pixels that see something.
    rays
        Rays per camera sample, by integrator.
    cost
        Cost of a camera sample at w = 1/2, by integrator, in camera rays; see `dmis.cost`.
    """

    indirect: float
    rays: Mapping[str, float]
    cost: Mapping[str, float]


def survey(scene: Scene) -> Survey:
    """Render `scene` small, by both integrators. The same scene always gives the same survey.

    Raises
    ------
    ValueError
        If a pixel of the thumbnail is not finite.
    """
    from dmis.tile import Tile, render_tile  # which renders scenes, and so comes after them

    width, height = scene.camera.frame or scene.camera.resolution
    shrink = math.sqrt(width * height / PIXELS)
    size = max(1, round(width / shrink)), max(1, round(height / shrink))
    small = scene.seen_by(replace(scene.camera, resolution=size, corner=(0, 0), frame=None))
    images, rays, cost = {}, {}, {}
    for integrator in ("direct", "path"):
        settings = Settings(integrator=integrator, max_depth=DEPTH)
        try:
            found = render_tile(small, Tile(0, 0, 0, (0, size[1]), (0, size[0]), SPP, 0.5, settings))
        except ValueError as error:
            raise ValueError(
                f"in the thumbnail of {size[0]}x{size[1]} pixels by which the integrator is chosen: {error}"
            ) from error
        images[integrator] = found.moments.mean.astype(float).mean(axis=2)
        samples = size[0] * size[1] * SPP
        rays[integrator] = (sum(found.rays.values()) - found.rays[UNSEEN]) / samples
        cost[integrator] = float(camera_sample(found.rays, np.array(0.5), settings.shading_samples))
    return Survey(_share(images["direct"], images["path"]), rays, cost)


def _share(direct: Array, path: Array) -> float:
    """The mean over blocks of (path - direct) / path, where noise may make either the larger."""
    direct, path = (_blocks(image) for image in (direct, path))
    most = np.maximum(direct, path)
    seen = most > 0
    return float(np.clip(((path - direct)[seen] / most[seen]).mean(), 0, 1)) if seen.any() else 0.0


def _blocks(image: Array) -> Array:
    """Sums over blocks, which have less noise than pixels, and do not let a lamp outshine the rest."""
    for axis in (0, 1):
        image = np.add.reduceat(image, np.arange(0, image.shape[axis], BLOCK), axis=axis)
    return image
