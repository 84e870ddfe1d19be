"""What a camera sample costs at each weight, from counted rays and stored constants.

An image must not depend on a clock: rules that weigh variance against cost use rays by kind, counted in their pilot,
times the constants below, which were measured once. Only ratios matter.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dmis.vec import Array

CAMERA, RAY = 1.6, 0.5
"""A camera ray, its surface point and its shading samples before their rays; an occlusion ray. Relative units."""


def camera_sample(rays: Mapping[str, int], w: Array) -> Array:
    """Cost of a camera sample at the weights `w`, ``(G,)``, from the rays of a pilot.

    A pilot has w = 1/2 and twice the shading samples, so it has as many of either technique as a final camera sample
    has of the one that it uses alone. Shading samples whose direction meets no light, or that the surface does not
    reflect, trace no ray; how often that is for either technique shows in the rays.
    """
    light, brdf = (rays.get(kind, 0) / max(rays.get("camera", 0), 1) for kind in ("shadow", "brdf"))
    return np.asarray(CAMERA + RAY * (np.asarray(w) * light + (1 - np.asarray(w)) * brdf))
