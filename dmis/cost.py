"""What a camera sample costs at each weight, from counted rays and stored constants.

An image must not depend on a clock: rules that weigh variance against cost use rays by kind, counted in their pilot,
times the constants below, which were measured once. Only ratios matter.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dmis.vec import Array

CAMERA, SHADING, RAY = 1.0, 0.25, 0.4
"""A camera ray with its surface point; a shading sample before its ray; an occlusion ray. Relative units."""
UNSEEN = "unseen"
"""Beside the kinds of rays: camera samples of pixels that are known to see nothing, for which no ray is traced."""


def surface_points(rays: Mapping[str, int]) -> float:
    """Surface points of a camera sample: where it meets the scene, and where paths that go on do."""
    onward = sum(number for kind, number in rays.items() if kind.startswith(("bounce", "specular")))
    return 1 + onward / max(_camera_samples(rays), 1)


def camera_sample(rays: Mapping[str, int], w: Array, pilot_samples: int = 4, shading_samples: float = 2) -> Array:
    """Cost of a camera sample at the weights `w`, ``(G,)``, from the rays of a pilot at w = 1/2.

    Where paths go on, a camera sample is as many surface points as there are rays that lead to one. Shading samples
    whose direction meets no light, or that the surface does not reflect, trace no ray; how often
    that is for either technique shows in the rays of the pilot. Rays towards lights of a single direction are the same
    at every weight.

    Parameters
    ----------
    pilot_samples, shading_samples
        Shading samples of each camera sample, in the pilot and in what is asked for.
    """
    camera, points = max(_camera_samples(rays), 1), surface_points(rays)
    each = camera * points * pilot_samples / 2  # samples of either technique
    light, brdf = (SHADING + RAY * rays.get(kind, 0) / each for kind in ("shadow", "brdf"))
    always = points * CAMERA + (SHADING + RAY) * rays.get("delta", 0) / camera
    return np.asarray(always + points * shading_samples * (np.asarray(w) * light + (1 - np.asarray(w)) * brdf))


def _camera_samples(rays: Mapping[str, int]) -> int:
    return rays.get("camera", 0) + rays.get(UNSEEN, 0)
