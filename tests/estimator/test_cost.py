"""The cost model: what a camera sample costs at each weight, from counted rays."""

import numpy as np

from dmis.estimator.cost import CAMERA, RAY, SHADING, camera_sample_cost

W = np.array([0, 0.3, 1])
SHARES = np.stack([W, 1 - W])


def test_only_rays_of_techniques_depend_on_the_weight() -> None:
    """100 camera samples with two shading samples of each technique: 150 of 200 light samples trace a ray, 20 of 200
    BRDF samples; one ray each to a light of a single direction, at every weight.
    """
    rays = {"camera": 100, "shadow": 150, "brdf": 20, "delta": 100}
    light, brdf = SHADING + 0.75 * RAY, SHADING + 0.1 * RAY
    expected = CAMERA + SHADING + RAY + 2 * (W * light + (1 - W) * brdf)
    np.testing.assert_allclose(camera_sample_cost(rays, SHARES), expected)


def test_points_cost() -> None:
    """With as many rays to further surfaces as camera rays, a camera sample costs twice as much."""
    rays = {"camera": 100, "shadow": 150, "brdf": 20}
    for further in ({"bounce 1": 70, "bounce 2": 30}, {"specular": 100}):
        more = {"camera": 100, "shadow": 300, "brdf": 40, **further}
        np.testing.assert_allclose(camera_sample_cost(more, SHARES), 2 * camera_sample_cost(rays, SHARES))
