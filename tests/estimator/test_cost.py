"""The cost model: what a camera sample costs at each weight, from counted rays."""

import numpy as np

from dmis.estimator.cost import camera_sample_cost

W = np.array([0, 0.3, 1])
SHARES = np.stack([W, 1 - W])


def test_points_cost() -> None:
    """With as many rays to further surfaces as camera rays, a camera sample costs twice as much."""
    rays = {"camera": 100, "shadow": 150, "brdf": 20}
    for further in ({"bounce 1": 70, "bounce 2": 30}, {"specular": 100}):
        more = {"camera": 100, "shadow": 300, "brdf": 40, **further}
        np.testing.assert_allclose(camera_sample_cost(more, SHARES), 2 * camera_sample_cost(rays, SHARES))
