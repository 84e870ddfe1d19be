"""The second-moment rule: planted curves, the guard, costs."""

import itertools
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from planted import PLAIN, pilot_of_curves

from dmis.fit.pooling import PatchCurves, guarded_argmin
from dmis.fit.registry import make_rule
from dmis.fit.second_moment import SecondMoment
from dmis.variance.curves import GRID


def test_memory_of_a_fit() -> None:
    """Means of the size of the sums, a few maps, and some rows of what is worked out on the way."""
    found = pilot_of_curves(np.random.default_rng(1).random((len(GRID), 96, 96)) + 1, shape=(384, 384))
    guide = {"normal": np.zeros((3, 96, 96), np.float32), "material": np.ones((1, 96, 96), np.float32)}
    size = sum(a.nbytes for a in found[0.5].sums.values())
    found = {0.5: replace(found[0.5], features=guide)}
    rule = make_rule("second-moment")
    rule.fit(found)
    tracemalloc.start()
    rule.fit(found)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2.5 * size


@pytest.mark.parametrize("g", range(len(GRID)))
def test_planted_minimum(g: int) -> None:
    """Every weight of the grid is found where the curve has its minimum there."""
    curve = ((GRID - GRID[g]) ** 2 + 0.1)[:, None, None]
    fit = SecondMoment(**PLAIN).fit(pilot_of_curves(curve))
    np.testing.assert_array_equal(fit.weight, GRID[g])


@pytest.mark.parametrize("patch", [4, 8, 16, 64])
def test_patches_take_the_minimum_of_their_mean(patch: int) -> None:
    """Curves are averaged, not weights."""
    rng = np.random.default_rng(1)
    curve = rng.random((len(GRID), 8, 8)) + 1
    curve[[1, -2]] += 1  # so that the ends are good for the image
    fit = SecondMoment(patch=patch, **PLAIN).fit(pilot_of_curves(curve))
    k = min(patch // 4, 8)
    mean = curve.reshape(len(GRID), 8 // k, k, 8 // k, k).mean(axis=(2, 4))
    np.testing.assert_array_equal(fit.maps["patch"], GRID[mean.argmin(axis=0)])
    np.testing.assert_allclose(fit.maps["variance"], mean.min(axis=0))


def test_filtering_makes_surer() -> None:
    """The same gain in all of a 5x5 neighbourhood passes where that of one patch does not; in a corner, where most of
    the filter's weight is on one patch, it is worth three, and does not either.
    """
    curve = np.where(GRID == 1, 0.9, 1.0)[:, None, None]
    noise = 0.1 * np.sqrt(15)  # one standard error in one patch
    alone, shared = (
        SecondMoment(filter=f, cost=False, guard=2.0).fit(pilot_of_curves(curve, noise)) for f in ("none", "gaussian")
    )
    assert np.all(alone.weight == 0.5)
    assert np.all(shared.weight[8:-8, 8:-8] == 1) and shared.weight[0, 0] == shared.weight[-1, 0] == 0.5


def test_weight_of_least_variance_and_cost_by_hand() -> None:
    """The pilot's light samples, 4 of 8, trace rays. With S = 4 at last C(w) = 1 + 4 (.25 + .4 w), and C(1/2) = 2.8.

    The mean of V(1/2) is .8 * 3.75 + .2 * 0 over 16 and 4 pixels. So V = 3 (w - m)^2 + v of the first is least, beside
    3 C / 2.8, at w = m - 1.6 / 2.8 / 2.
    """
    w = GRID.astype(float)[:, None]
    m = w[9] + 0.8 / 2.8
    curve = 3 * np.stack([(w - m) ** 2 + 1.25 - (0.5 - m) ** 2, 0 * w], axis=2)
    first = replace(pilot_of_curves(curve, shape=(4, 5))[0.5], rays={"camera": 100, "shadow": 400}, shading_samples=8)
    fit = SecondMoment(filter="none", guard=0.0).fit({0.5: first})
    np.testing.assert_array_equal(fit.maps["patch"], [[GRID[9], 0.5]])


def test_no_reason_to_leave_one_half() -> None:
    """Where the pilot sees no gain in variance, a sure gain in cost changes nothing: it may have seen too little."""
    found = pilot_of_curves(np.ones((len(GRID), 1, 1)))
    found[0.5] = replace(found[0.5], rays={"camera": 100, "shadow": 100, "brdf": 0})
    assert np.all(SecondMoment(guard=0.0).fit(found).weight == 0.5)
    # where nothing was seen there is no reason to leave
    fit = SecondMoment().fit(pilot_of_curves(np.zeros((len(GRID), 1, 1))))
    np.testing.assert_array_equal(fit.weight, 0.5)


def test_gain_is_significant_with_its_cost() -> None:
    """A gain of three standard errors in variance, of which the cost takes two; no variance is subtracted."""
    curve = np.array([1.0, 0.7])[:, None, None]
    gain_square = (curve - 1) ** 2 + 16 * 0.1**2
    curves = PatchCurves(curve, gain_square, np.full((1, 1), -0.1), np.full((1, 1), 17.0), 0)
    np.testing.assert_array_equal(curves.variance, curve)
    for guard, best in ((0.9, 1), (1.1, 0)):
        assert guarded_argmin(curves, np.array([0.0, 0.2]), guard, np.ones(2, bool), 1.0) == best


@pytest.mark.parametrize("unit", [1.0, 1e6])
def test_rounding_is_no_gain(unit: float) -> None:
    """Curves that differ by 1e-7 stay at 1/2; those that differ by 1e-3 do not."""
    for gain, weight in ((1e-7, 0.5), (1e-3, GRID[-2])):
        curve = unit * np.where(GRID == GRID[-2], 1 - gain, 1)[:, None, None]
        fit = SecondMoment(filter="none", cost=False).fit(pilot_of_curves(curve))
        np.testing.assert_array_equal(fit.weight, weight)


def test_size_and_sigma_of_the_filter() -> None:
    curve = np.zeros((len(GRID), 8, 8))
    curve[:, 3, 4] = 1
    variance = SecondMoment(filter="gaussian", size=3, sigma=0.5).fit(pilot_of_curves(curve)).maps["variances"][0]
    assert np.count_nonzero(variance) == 9 and variance[3, 5] / variance[3, 4] == pytest.approx(np.exp(-2))


def test_objective_is_least_for_the_image() -> None:
    """Each patch for itself finds the weights for which the image's error times its time, sum(V) sum(C), is least."""
    rng = np.random.default_rng(3)
    variance = rng.random((3, 4)) ** 4 + 0.01
    cost = np.array([0.8, 1.0, 1.3])
    every = np.array(list(itertools.product(range(3), repeat=4)))
    v, c = variance[every, np.arange(4)], cost[every]
    total = v.sum(axis=1) * c.sum(axis=1)
    best = every[total.argmin()]
    price = v[total.argmin()].sum() / c[total.argmin()].sum()
    curves = PatchCurves(variance[:, None], np.full((3, 1, 4), 1e6), np.zeros((1, 4)), np.full((1, 4), 2.0), 0)
    np.testing.assert_array_equal(guarded_argmin(curves, cost, -1.0, np.ones(3, bool), price)[0], best)


def test_ends_are_for_images_that_like_them() -> None:
    """A patch that would leave a technique out stops short of it where the image as a whole fares badly there."""
    inner, outer = (np.abs(GRID - g) + 0.1 for g in (0.5, 1.0))
    curve = np.where(np.arange(8) < 2, outer[:, None, None], inner[:, None, None])
    weight = np.broadcast_to(SecondMoment(**PLAIN).fit(pilot_of_curves(curve)).weight, (32, 32))
    assert (weight[:, :8] == GRID[-2]).all() and (weight[:, 8:] == 0.5).all()
    # two patches of 16 and 4 pixels: 16 * .5 + 4 * 1.25 < 16 * .6 + 4
    curve = np.ones((len(GRID), 1, 2))
    curve[-2:] = [[[0.6, 1.0]], [[0.5, 1.25]]]
    fit = SecondMoment(**PLAIN).fit(pilot_of_curves(curve, shape=(4, 5)))
    np.testing.assert_array_equal(fit.maps["patch"], [[1, 0.5]])
