"""A look at a scene before it is rendered: how much light its surfaces send each other, and what a sample costs.

A thumbnail is rendered by both integrators. It recommends; what is provably needed or not is known to `dmis.plan`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dmis.cost import camera_sample
from dmis.settings import DEPTH, Settings
from dmis.vec import Array

if TYPE_CHECKING:
    from dmis.scene import Scene

PIXELS, SPP = 768, 8
"""Of the thumbnail."""
MATTERS = 0.1
"""Share of light from other surfaces, as compared with that from the lights, from which on paths are recommended."""


@dataclass(frozen=True)
class Survey:
    """What a thumbnail tells.

    Attributes
    ----------
    indirect
        What path tracing adds to a pixel, as a share of what direct lighting gives it: a typical value, in which all
        pixels count the same.
    rays
        Rays per camera sample, by integrator.
    cost
        Cost of a camera sample at w = 1/2, by integrator, in camera rays; see `dmis.cost`.
    """

    indirect: float
    rays: Mapping[str, float]
    cost: Mapping[str, float]


def survey(scene: Scene) -> Survey:
    """Render `scene` small, by both integrators. The same scene always gives the same survey."""
    from dmis.tile import Tile, render_tile  # which renders scenes, and so comes after them

    width, height = scene.camera.frame or scene.camera.resolution
    shrink = max(1.0, math.sqrt(width * height / PIXELS))
    size = max(1, round(width / shrink)), max(1, round(height / shrink))
    small = scene.seen_by(replace(scene.camera, resolution=size, corner=(0, 0), frame=None))
    images, rays, cost = {}, {}, {}
    for integrator in ("direct", "path"):
        settings = Settings(integrator=integrator, max_depth=DEPTH)
        found = render_tile(small, Tile(0, 0, 0, (0, size[1]), (0, size[0]), SPP, 0.5, settings))
        images[integrator] = found.moments.mean.astype(float).mean(axis=2)
        samples = size[0] * size[1] * SPP
        rays[integrator] = sum(found.rays.values()) / samples
        kinds = found.rays
        alike = {
            "camera": samples,
            "bounce": kinds["bounce"] + kinds["specular"],
            "shadow": kinds["shadow"] + kinds["delta"],
            "brdf": kinds["brdf"],
        }
        cost[integrator] = float(camera_sample(alike, np.array(0.5), settings.shading_samples))
    return Survey(_added(images["direct"], images["path"]), rays, cost)


def _added(direct: Array, path: Array) -> float:
    """The typical share r of what `path` has beyond `direct`: (path - direct) / (path + direct) = r / (2 + r), whose
    mean over the pixels no bright one dominates."""
    total = path + direct
    seen = total > 0
    if not seen.any():
        return 0.0
    mean = float(np.clip(((path - direct)[seen] / total[seen]).mean(), 0, 0.999))
    return 2 * mean / (1 - mean)
