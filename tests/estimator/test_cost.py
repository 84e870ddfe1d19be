"""The cost model: what a camera sample costs at each weight, from counted rays; numbers by hand."""

from dataclasses import replace

import numpy as np
import pytest

from dmis.estimator.cost import camera_sample_cost, pattern_costs, relative_costs
from dmis.estimator.mis import BRDF
from dmis.estimator.patterns import PATTERNS

RAYS = {"camera": 80, "untraced": 20, "shadow": 300, "brdf": 60, "costly": 450, "delta": 100, "guide": 7}
COSTLY = replace(BRDF, name="costly", rays="costly", cost=2.3)


@pytest.mark.parametrize(("lights", "expected"), [(1, [10.97, 46.65]), (3, [23.17, 120.25])])
@pytest.mark.parametrize("onward", [{"bounce 1": 70, "bounce 2": 30}, {"specular": 100}])
def test_cost_by_hand(lights: int, expected: list[float], onward: dict[str, int]) -> None:
    """100 camera samples of 2 points each: a point costs 1, and its delta rays .25 + .4 per camera sample, 2.65 in all.

    In the pilot each technique took 100 * 2 * 6 / 3 = 400 samples. Before its ray one costs .25 for each light (the
    costly one 2.3), its ray .4 * 300 / 400 (light), .4 * 60 / 400 (BRDF), .4 * 450 / 400 (costly): of one light .55,
    .31 and 2.75, of three 1.05, .81 and 7.35. A final camera sample has 4 of all three, or 8 costly ones, per point:
    2.65 + 8 (.5 * .55 + .25 * .31 + .25 * 2.75), and 2.65 + 16 * 2.75.
    """
    shares, techniques = np.array([[0.5, 0], [0.25, 0], [0.25, 1]]), ("light", "brdf", COSTLY)
    cost = camera_sample_cost(RAYS | onward, shares, 6, np.array([4, 8]), techniques, lights)
    np.testing.assert_allclose(cost, expected)


def test_costs_of_lights_by_hand() -> None:
    """In the other colours 300 camera samples of 8 shading samples of two lights, and 120 rays to delta lights.

    The pattern n_l : n_b is of 2 n_l and 2 n_b samples, which cost .5 + .4 * 900 / 1200 and .5 + .4 * 180 / 1200.
    """
    rays = {"camera": 100, "shadow": 300, "brdf": 60, "delta": 40}
    cost, of_lights = pattern_costs({kind: 3 * n for kind, n in rays.items()}, 8, ("light", "brdf"), 2)
    n_l, n_b = np.transpose(PATTERNS)
    samples, deltas = 2 * n_l * 0.8 + 2 * n_b * 0.56, 0.65 * 120 / 300
    np.testing.assert_allclose(cost, (1 + deltas + samples) / (1 + deltas + 2.72))
    expected = np.array([samples / 2, samples / 2, deltas + 0 * samples]) / (1 + deltas + 2.72)
    np.testing.assert_allclose(of_lights, expected)


def test_costs_of_pixels_by_hand() -> None:
    """A surface costs 1, and .25 for each of 4 samples of 3 lights; an occlusion ray .4."""
    np.testing.assert_allclose(relative_costs(np.array([1.0, 2]), np.array([5.0, 0]), 4, 3), [1 + 3 + 2, 8])
