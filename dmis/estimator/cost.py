"""Cost of a camera sample at each share, from counted rays and stored constants.

An image must not depend on a clock: rules that weigh variance against cost use rays by kind, counted in their pilot,
times the constants below, which were measured once (benchmarks/costs.py of 9db2350c). Only ratios matter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.mis import SHADING, Technique, technique_by_name
from dmis.estimator.patterns import EQUAL, FIRST, SAMPLES_OF, SHARE_OF, SHARES
from dmis.intersect import UNTRACED

CAMERA, RAY = 1.0, 0.4
"""A camera ray with its surface point; an occlusion ray. A shading sample before its ray is `SHADING`, or the
`dmis.estimator.mis.Technique.cost` of another technique. Relative units.
"""


def count_camera_samples(rays: Mapping[str, int]) -> int:
    """Return the number of camera samples of a pass, at least 1."""
    return max(rays.get("camera", 0) + rays.get(UNTRACED, 0), 1)


def surface_points(rays: Mapping[str, int]) -> float:
    """Return the surface points per camera sample: its first hit, and those of rays that go on."""
    onward = sum(number for kind, number in rays.items() if kind.startswith(("bounce", "specular")))
    return 1 + onward / count_camera_samples(rays)


def camera_sample_cost(
    rays: Mapping[str, int],
    shares: Array,
    pilot_samples: int = 4,
    shading_samples: Array | float = 2,
    techniques: Sequence[Technique | str] = ("light", "brdf"),
    lights: int = 1,
) -> Array:
    """Return the cost of a camera sample at `shares` of K techniques, ``(G,)``, from the rays of a pilot at equal ones.

    Where paths go on, a camera sample is as many surface points as there are rays that lead to one. Shading samples
    whose direction meets no light, or that the surface does not reflect, trace no ray; how often
    that is for each technique shows in the rays of the pilot. Rays towards lights of a single direction are the same
    at every weight.

    Parameters
    ----------
    shares
        ``(K, G)``, at G points.
    pilot_samples, shading_samples
        Shading samples of each camera sample, in the pilot and in the final pass; the latter one number or ``(G,)``.
    lights
        Number of lights, each with that many shading samples.
    """
    camera, points = count_camera_samples(rays), surface_points(rays)
    per_technique = camera * points * pilot_samples / len(techniques)  # samples of each technique
    mixed: Array | float = 0
    for share, technique in zip(shares, map(technique_by_name, techniques), strict=True):
        mixed = mixed + share * (technique.cost * lights + RAY * rays.get(technique.rays, 0) / per_technique)
    always = points * CAMERA + (SHADING + RAY) * rays.get("delta", 0) / camera
    return np.asarray(always + points * shading_samples * mixed)


def pattern_costs(
    rays: Mapping[str, int], pilot_samples: int, techniques: Sequence[Technique | str], lights: int = 1
) -> tuple[Array, Array]:
    """Return the cost of a camera sample with each pattern over the cost with 1:1, and the part of each light in it.

    From the `rays` of a pilot of the pattern `FIRST`; the other parameters are those of `camera_sample_cost`. Delta
    lights are together in the last place of the parts, ``(L + 1, patterns)``.
    """
    shares = np.array([SHARES[SHARE_OF], 1 - SHARES[SHARE_OF]])
    shading_samples = SAMPLES_OF * (pilot_samples // int(SAMPLES_OF[FIRST]))
    total = camera_sample_cost(rays, shares, pilot_samples, shading_samples, techniques, lights)
    unlit = camera_sample_cost(rays, shares, pilot_samples, 0, techniques, lights)
    without_deltas = camera_sample_cost({**rays, "delta": 0}, shares, pilot_samples, 0, techniques, lights)
    of_lights = np.stack([*[(total - unlit) / lights] * lights, unlit - without_deltas])
    return total / total[EQUAL], of_lights / total[EQUAL]


def relative_costs(closest: Array, occlusion: Array, shading_samples: Array | float, lights: int) -> Array:
    """Return the cost of pixels in proportion, from their closest hits, of camera rays as well, and occlusion rays.

    At each surface all of `lights` have so many `shading_samples`.
    """
    return closest * (CAMERA + SHADING * shading_samples * lights) + occlusion * RAY
