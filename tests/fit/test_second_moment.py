"""The second-moment rule: planted curves, the guard, costs; rules of fixed shares."""

from __future__ import annotations

import itertools
import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, images_z_score, lamp_images, z_score
from planted import PLAIN, pilot_of_curves

import dmis
from dmis.fit.fixed import Fixed
from dmis.fit.pooling import PatchCurves, guarded_argmin
from dmis.fit.registry import make_rule
from dmis.fit.second_moment import SecondMoment
from dmis.report.compare import parse_rules
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


# Fixed shares ---------------------------------------------------------------------------------------------------------

MIX = "fixed:light=0.3,brdf=0.45,uniform=0.25"
THREE = ("light", "brdf", "uniform")
WIDTH, HEIGHT = 32, 24


@pytest.mark.parametrize(
    "rule, settings, path",
    [
        (f"{MIX},combiner=power", {"shading_samples": 3}, {}),
        (f"{MIX},combiner=cutoff,sampler=sobol", {"shading_samples": 1}, {}),
        (f"{MIX},sampler=stratified", {}, {}),
        (Fixed((0.2, 0.3, 0.5), techniques=("uniform", "brdf", "light"), allocation="random"), {}, {}),
        (MIX, {}, {"integrator": "path", "max_depth": 3}),
    ],
)
def test_images_of_several_techniques_are_unbiased(rule: Any, settings: dict[str, Any], path: dict[str, Any]) -> None:
    """Against light and BRDF samples with the balance heuristic."""
    assert abs(images_z_score(lamp_images(rule, **settings, **path), lamp_images("balance", 500, **path))) < Z_LIMIT


def test_texts_and_maps(box: dmis.Scene) -> None:
    """Of two techniques the rule is that of one weight; commas between rules, and within one."""
    assert make_rule(f"{MIX},combiner=power") == Fixed((0.3, 0.45, 0.25), "power", THREE)
    assert make_rule("fixed:light=0.25,brdf=0.75") == Fixed(0.25, techniques=("light", "brdf"))
    assert parse_rules(f"balance,{MIX},auto") == ["balance", MIX, "auto"]
    assert dmis.render(box, MIX, 4, seed=3).weight == pytest.approx(0.3)
    # three techniques where two are needed
    with pytest.raises(ValueError, match="combiner optimal needs two techniques; got 3: light, brdf, uniform"):
        dmis.Settings(techniques=THREE, combiner="optimal")
    # what happens to the caller's array does not reach the rule, and the rule's cannot be written to
    weight = np.full((2, 3), 0.5)
    rule = dmis.Given(weight=weight)
    weight[:] = 2
    assert np.max(rule.weight) == 0.5 and not rule.weight.flags.writeable
    assert repr(rule) == "Given(weight=<2 x 3, 0.5 to 0.5>, samples=None)"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fixed", "rule fixed needs the share of light samples, such as fixed:0.5, .*; got none"),
        ("fixed:0.5,light=0.5,brdf=0.5", "rule fixed needs .*; got both"),
        ("fixed:light=0.5", "shares of at least two techniques; got light"),
        ("fixed:light=0.5,brdf=0.3,uniform=0.3", r"add up to 1, .* got 0.5 \+ 0.3 \+ 0.3 = 1.1"),
        ("fixed:light=x,brdf=0.5", "option light of rule fixed must be of type float"),
        ("fixed:dark=0.5", "rule fixed has the options w, .*, weigh, light, brdf, uniform; got 'dark'"),
        ("simplex", "got 'simplex'. It is a plug-in: load it with --plugin simplex, or dmis.load_plugin.'simplex'"),
        ("kl:patch=8", "got 'kl'. It is a plug-in: load it with --plugin objectives, or dmis.load_plugin.'objectives'"),
    ],
)
def test_texts_that_are_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_rule(text)


# Maps ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("w", [0.0, 0.3, 1.0])
def test_constant_map_is_fixed(box: dmis.Scene, w: float) -> None:
    """One number and a constant map give the image of `fixed`, bit by bit, with the caller's settings."""
    fixed = dmis.render(box, f"fixed:{w}", 8, seed=2, combiner="power")
    for weight in (w, np.full((HEIGHT, WIDTH), w), np.full((HEIGHT, WIDTH), w, np.float32)):
        given = dmis.render(box, dmis.Given(weight=weight), 8, seed=2, combiner="power")
        np.testing.assert_array_equal(given.image, fixed.image)
        np.testing.assert_array_equal(given.weight, fixed.weight)
        np.testing.assert_array_equal(given.deviation, fixed.deviation)


def test_uneven_maps_keep_the_mean(box: dmis.Scene) -> None:
    """Weights from 0.1 to 0.9 and samples from 1 to 3 in proportion: the mean is that of the balance heuristic."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    rule = dmis.Given(weight=0.1 + 0.8 * ((x // 4 + y // 4) % 2), samples=1.0 + 2.0 * (x >= WIDTH // 2))
    results = [dmis.render(box, rule, 16, seed=seed) for seed in range(24)]
    balance = [dmis.render(box, "balance", 16, seed=100 + seed).image.mean() for seed in range(24)]
    assert abs(z_score([result.image.mean() for result in results], balance)) < Z_LIMIT
    np.testing.assert_allclose(results[0].weight, rule.weight, rtol=1e-6)
    samples = results[0].samples
    assert samples.mean() == pytest.approx(16, rel=1e-3)
    assert samples[:, WIDTH // 2 :].mean() == pytest.approx(3 * samples[:, : WIDTH // 2].mean(), rel=1e-2)
