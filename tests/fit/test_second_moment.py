"""The second-moment rule: planted curves, the guard, costs."""

import itertools
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from planted import PLAIN, pilot_of_curves

from dmis.estimator.cost import camera_sample_cost
from dmis.fit.curve_minimum import cost_weighted
from dmis.fit.registry import make_rule
from dmis.fit.round import Pilot
from dmis.fit.second_moment import SecondMoment
from dmis.variance.curves import GRID, GRID_SHARES


def test_memory_of_a_fit() -> None:
    """Means of the size of the sums, a few maps, and some rows of what is worked out on the way."""
    found = pilot_of_curves(np.random.default_rng(1).random((len(GRID), 96, 96)) + 1, size=384)
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


def test_guard() -> None:
    """A gain of 3 standard errors passes a guard of 2, not one of 4."""
    gain = 0.1
    curve = np.where(GRID == 1, 1 - gain, 1.0)[:, None, None]
    noise = gain / 3 * np.sqrt(15)  # 16 pixels; the standard error divides by 15
    for guard, weight in ((2.0, 1.0), (4.0, 0.5)):
        fit = SecondMoment(**{**PLAIN, "guard": guard}).fit(pilot_of_curves(curve, noise))
        np.testing.assert_array_equal(fit.weight, weight)


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


def test_cost_moves_the_minimum() -> None:
    """Light samples trace a ray, BRDF samples none: the minimum moves to where those are fewer, in dark patches more
    than in bright ones, because the image has one number of samples everywhere.
    """
    rays = {"camera": 100, "shadow": 100, "brdf": 0}
    assert (np.diff(camera_sample_cost(rays, GRID_SHARES)) > 0).all()
    bowl = ((GRID - GRID[9]) ** 2 + 0.2)[:, None, None]
    curve = bowl * np.where(np.arange(8) < 2, 1.0, 1e-2)  # columns of patches; too few are bright to be filtered away
    found = pilot_of_curves(curve)
    found[0.5] = Pilot(found[0.5].moments, rays, found[0.5].sums)
    plain, costly = (SecondMoment(**{**PLAIN, "cost": cost}).fit(found).maps["patch"] for cost in (False, True))
    np.testing.assert_array_equal(plain, GRID[9])
    assert np.all(costly[:, :2] <= plain[:, :2]) and np.all(costly[:, 2:] < costly[:, :1])


def test_cheap_is_not_sure() -> None:
    """Where the pilot sees no gain in variance, a sure gain in cost changes nothing: it may have seen too little."""
    found = pilot_of_curves(np.ones((len(GRID), 1, 1)))
    found[0.5] = Pilot(found[0.5].moments, {"camera": 100, "shadow": 100, "brdf": 0}, found[0.5].sums)
    assert np.all(SecondMoment(guard=0.0).fit(found).weight == 0.5)


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
    np.testing.assert_array_equal(cost_weighted(variance, cost, price).argmin(axis=0), best)


def test_ends_are_for_images_that_like_them() -> None:
    """A patch that would leave a technique out stops short of it where the image as a whole fares badly there."""
    inner, outer = (np.abs(GRID - g) + 0.1 for g in (0.5, 1.0))
    curve = np.where(np.arange(8) < 2, outer[:, None, None], inner[:, None, None])
    weight = np.broadcast_to(SecondMoment(**PLAIN).fit(pilot_of_curves(curve)).weight, (32, 32))
    assert (weight[:, :8] == GRID[-2]).all() and (weight[:, 8:] == 0.5).all()


def test_black_patches_stay_at_one_half() -> None:
    """Where nothing was seen there is no reason to leave."""
    fit = SecondMoment().fit(pilot_of_curves(np.zeros((len(GRID), 1, 1))))
    np.testing.assert_array_equal(fit.weight, 0.5)


@pytest.mark.parametrize(
    "options", ["patch=6", "patch=2", "spp=2", "spp=7", "guard=-1", "size=4", "sigma=0", "filter=box"]
)
def test_bad_options(options: str) -> None:
    """Errors name the option; `simplex` has the same."""
    with pytest.raises(ValueError, match=options.split("=")[0]):
        make_rule(f"second-moment:{options}")
