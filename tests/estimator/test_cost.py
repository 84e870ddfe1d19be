"""The cost model: what a camera sample costs at each weight, from counted rays; numbers by hand."""

import numpy as np
import pytest

from dmis.estimator.cost import camera_sample_cost

RAYS = {"camera": 80, "untraced": 20, "shadow": 300, "brdf": 60, "resampled": 450, "delta": 100, "guide": 7}


@pytest.mark.parametrize(("lights", "expected"), [(1, [10.97, 46.65]), (3, [23.17, 120.25])])
@pytest.mark.parametrize("onward", [{"bounce 1": 70, "bounce 2": 30}, {"specular": 100}])
def test_cost_by_hand(lights: int, expected: list[float], onward: dict[str, int]) -> None:
    """100 camera samples of 2 points each: a point costs 1, and its delta rays .25 + .4 per camera sample, 2.65 in all.

    In the pilot each technique took 100 * 2 * 6 / 3 = 400 samples. Before its ray one costs .25 for each light
    (resampled: 2.3), its ray .4 * 300 / 400 (light), .4 * 60 / 400 (BRDF), .4 * 450 / 400 (resampled): of one light
    .55, .31 and 2.75, of three 1.05, .81 and 7.35. A final camera sample has 4 of all three, or 8 resampled ones, per
    point: 2.65 + 8 (.5 * .55 + .25 * .31 + .25 * 2.75), and 2.65 + 16 * 2.75.
    """
    shares, techniques = np.array([[0.5, 0], [0.25, 0], [0.25, 1]]), ("light", "brdf", "resampled")
    cost = camera_sample_cost(RAYS | onward, shares, 6, np.array([4, 8]), techniques, lights)
    np.testing.assert_allclose(cost, expected)
