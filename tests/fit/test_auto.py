"""A pilot and two rounds: planted best patterns, numbers from the neighbours alone, and no bias on spikes."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers import shared_scene

import dmis
from dmis.base.patches import COLOURS, PATCH, by_colour, patch_spread, patch_sum
from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.cost import pattern_costs
from dmis.estimator.patterns import EQUAL, PATTERNS, SAMPLES_OF, SHARE_OF, SHARES
from dmis.estimator.records import PIXEL_SUMS
from dmis.fit import auto, best_pattern, sample_density
from dmis.fit.auto import Auto
from dmis.fit.best_pattern import (
    HALF,
    LOOKS,
    PatternChoice,
    best_of_few,
    decide_one_pattern,
    decide_patterns,
    error_of_numbers,
    looks_at,
    pattern_errors,
    predicted_error,
)
from dmis.fit.pooling import PatchCurves
from dmis.fit.registry import make_rule
from dmis.fit.round import Budget, Round
from dmis.fit.sample_density import powers_of_two
from dmis.variance.curves import with_gain_square
from dmis.variance.moments import Film

PLAIN = Auto(spp=8, exponent=1.4, guard=0.0)
"""A rule that believes planted curves."""
RAYS = {"camera": 1000, "shadow": 1900, "brdf": 1300}
EVEN = np.ones((16, 16, 3))
FLAT = np.ones(len(SHARES))
N = 8
"""Camera samples of a first round."""
Z_LIMIT = 4.5


def pilot(curve: Array, position: Array | float = 0.0, shape: tuple[int, int] = (16, 16)) -> Film:
    """Return a pilot of pixels of radiance 1 with the curves ``(G,)`` or ``(..., G, rows, columns)``."""
    patches = tuple(-(-n // PATCH) for n in shape)
    curve = np.broadcast_to(curve[:, None, None] if curve.ndim == 1 else curve, (4, len(SHARES), *patches))
    sums = {"curve": curve, "gain_square": np.stack([with_gain_square(c, c, HALF)["gain_square"] for c in curve])}
    sums["position"] = np.broadcast_to(position, (4, *patches))
    looked_at = looks_at(shape)[..., None]
    film = Film(2 * looked_at, np.repeat(looked_at, 3, axis=2).astype(np.float32), np.zeros((*shape, 3), np.float32))
    return replace(film, rays=RAYS, sums=sums, budget=64)


def first_film(root: Array, mean: Array | float = 1.0, budget: int = 10**6) -> Film:
    """Return a first round of pixels with a `root` of m2 between sub-blocks, whose samples differ no more."""
    mean = np.broadcast_to(np.float32(mean), root.shape).copy()
    ones, square = np.ones(root.shape[:2]), N * np.square(mean).mean(axis=2)
    sums = zip(PIXEL_SUMS, (N * ones, N * ones, square), strict=True)
    of_patches = {name: patch_sum(by_colour(a), PATCH) for name, a in sums}
    return Film(N, mean, root.astype(np.float32), RAYS, of_patches, budget=budget)


def random_film(shape: tuple[int, int]) -> Film:
    """Return a first round with random means, variances and rays of each pixel."""
    rng = np.random.default_rng(1)
    first = first_film(rng.lognormal(0, 2, (*shape, 3)), rng.lognormal(0, 1, (*shape, 1)), budget=64)
    return replace(first, sums={name: a * rng.lognormal(0, 0.5, a.shape) for name, a in first.sums.items()})


def choice_of(shape: tuple[int, int], cost: Array | float = 1.0) -> PatternChoice:
    """Return a choice of the pattern 1:1 in all patches, whose samples have a `cost`."""
    patches = tuple(-(-n // PATCH) for n in shape)
    none = np.empty((0, *patches), np.uint8)
    return PatternChoice(
        np.full(patches, EQUAL, np.uint8), np.broadcast_to(float(cost), patches), none, np.ones(patches)
    )


def second_round(first: Film, rule: Auto = PLAIN, choice: PatternChoice | None = None) -> Round:
    shape = first.mean.shape[:2]
    budget = Budget(first.budget, shape, dmis.Settings(sampler="sobol", integrator="direct", max_depth=5), seed=3)
    return rule.second_round(Round(N, shares_of(0.5), budget.settings), first, budget, choice, {})


def decided(first: Film, rule: Auto = PLAIN) -> Array:
    """Return the density of the camera samples and the cost of one at each pixel, ``(2, H, W)``."""
    maps = np.empty((2, *first.mean.shape[:2]))
    colours = (at for at in COLOURS if maps[0][at].size)

    def keep(density: Array, cost: Array, *others: Any) -> Array:
        maps[:, *next(colours)] = density, cost
        return powers_of_two(density, cost, *others)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(auto, "powers_of_two", keep)
        # patterns that cost more: numbers are divided even where variance is luck
        second_round(first, rule, choice_of(maps.shape[1:], 1.01))
    return maps


def decided_patterns(looked: Film, guard: float = 0.0) -> tuple[PatternChoice | None, float]:
    return decide_patterns(looked, "relative", guard, 1.4)


# --- patterns


def test_best_pattern_by_the_formula() -> None:
    """The least V C^a, for random curves; other shares than a half only where the curve is below."""
    rng, a = np.random.default_rng(5), 1.4
    curve, place = rng.lognormal(0, 1, (len(SHARES), 1, 200)), rng.lognormal(-1, 1, (1, 200))
    cost = np.array([1 + 0.63 * n_l + 0.51 * n_b for n_l, n_b in PATTERNS])
    curves = PatchCurves(curve, (curve - curve[HALF]) ** 2, place, np.full((1, 200), 12.0), HALF)
    patterns = pattern_errors(curves, cost, np.ones(len(SHARES), bool), 0.0, a).argmin(axis=0)
    v = np.array([place + 2 * curve[g] / s for g, s in zip(SHARE_OF, SAMPLES_OF)])
    possible = (curve < curve[HALF])[SHARE_OF] | (SHARE_OF == HALF)[:, None, None]
    best = np.where(possible, v * cost[:, None, None] ** a, np.inf).argmin(axis=0)
    np.testing.assert_array_equal(patterns, best)
    assert len(np.unique(best)) > 5


def test_few_patterns_are_the_best_few() -> None:
    """Of random errors the pair with 1:1 that has the least error of the image; none for a gain of next to nothing."""
    rng, a = np.random.default_rng(3), 1.4
    errors, weight = rng.lognormal(0, 1, (len(PATTERNS), 6, 7)), rng.lognormal(0, 1, (6, 7))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(best_pattern, "MOST_PATTERNS", 2)
        pattern = best_of_few(errors, weight, a)
    of_pairs = {
        k: ((np.minimum(errors[EQUAL], errors[k]) * weight) ** (1 / (1 + a))).sum() for k in range(len(PATTERNS))
    }
    best = min(of_pairs, key=of_pairs.__getitem__)
    np.testing.assert_array_equal(pattern, np.where(errors[best] < errors[EQUAL], best, EQUAL))
    assert 2 < len(np.unique(best_of_few(errors, weight, a))) <= best_pattern.MOST_PATTERNS
    assert (
        best_of_few(np.where(np.arange(15)[:, None, None] == EQUAL, 1, 0.999 + 0 * errors), weight, a) == EQUAL
    ).all()


def test_error_that_is_predicted_is_that_of_the_best_numbers() -> None:
    """Of two patches with other V, C and q: the least sum of V q n^-a over n at a cost of 2, by search."""
    a, cost, weight = 1.4, np.array([[1.5, 0.5]]), np.array([[1.0, 3.0]])
    curve = np.ones((len(SHARES), 1, 2)) * [[0.5, 0.1]]
    curves = PatchCurves(curve, 0 * curve, np.array([[1.0, 2.0]]), np.ones((1, 2)), HALF)
    choice = PatternChoice(np.array([[11, 0]]), cost, np.empty((0, 1, 2), np.uint8), np.ones((1, 2)))
    assert PATTERNS[11] == (2, 2) and PATTERNS[0] == (1, 0)
    n_0 = np.linspace(1e-3, 1.999, 10**5)

    def least(variance: Array, cost: Array) -> float:
        v, c = (variance * weight)[0], cost[0]
        return float((v[0] * (n_0 / c[0]) ** -a + v[1] * ((2 - n_0) / c[1]) ** -a).min())

    expected = least(np.array([[1.25, 2.2]]), cost) / least(np.array([[1.5, 2.1]]), np.ones((1, 2)))
    assert predicted_error(choice, curves, weight, a) == pytest.approx(expected, rel=1e-6)


def test_ends_need_to_be_good_for_the_image() -> None:
    """In a patch where light samples alone are best; not where the whole image is far worse with them."""
    curve = np.ones((len(SHARES), 4, 4))
    curve[-1, 0, 0] = 1e-3
    choice, _ = decided_patterns(pilot(curve))
    assert choice is not None and choice.pattern[0, 0] < 3
    curve[-1, 3, 3] = 50
    choice, _ = decided_patterns(pilot(curve))
    assert choice is None or all(min(PATTERNS[k]) > 0 for k in np.unique(choice.pattern))
    # Pixels that differ: a gain within some standard errors of its mean is none
    curve = FLAT.copy()
    curve[-2] = 0.1
    first = pilot(curve)
    noisy = {**first.sums, "gain_square": first.sums["gain_square"] + 100.0}
    for sums, share in ((first.sums, SHARES[-2]), (noisy, 0.5)):
        choice, _ = decided_patterns(replace(first, sums=sums), guard=1.5)
        patterns = EQUAL if choice is None else choice.pattern
        np.testing.assert_allclose(SHARES[SHARE_OF[patterns]], share)
    # Flat curves have nothing to gain; what half of the pixels of paths gains by luck, the other half refuses
    curve = np.ones((4, len(SHARES), 4, 4))
    curve[[0, 3], -1], curve[[1, 2], -1] = 0.01, 1.5
    for choice, error in (decided_patterns(pilot(FLAT, 3.0)), decide_one_pattern(pilot(curve), "relative")):
        assert choice is None and error >= 0.95


def test_paths_have_one_pattern_of_two_samples_at_most() -> None:
    """Light samples alone are best in one half, and worse in the other: the least V C for both together."""
    curve = np.ones((len(SHARES), 4, 4))
    curve[-1, :, :2], curve[-1, :, 2:] = 0.1, 0.9
    choice, error = decide_one_pattern(pilot(curve), "relative")
    assert choice is not None and (choice.pattern == choice.pattern[0, 0]).all()
    cost = pattern_costs(RAYS, 4, ("light", "brdf"))[0]
    # V = A(w) / S, the curve being A / 2: of light samples alone 2 * .5 / S, of the pattern 1:1 2 * 1 / 2
    expected = {(1, 0): cost[PATTERNS.index((1, 0))], (2, 0): 0.5 * cost[PATTERNS.index((2, 0))]}
    assert PATTERNS[choice.pattern[0, 0]] == min(expected, key=expected.__getitem__)
    assert error == pytest.approx(min(expected.values()))
    np.testing.assert_allclose(choice.cost, cost[choice.pattern[0, 0]])


def test_pilots_of_paths_tell_whether_numbers_may_pay() -> None:
    """A quarter of the patches with 32 times the variance; and a variance that only half of the pixels see."""
    position = np.ones((4, 16, 16))
    position[:, :8, :8] = 32
    film = pilot(FLAT, position, (64, 64))
    promised = error_of_numbers(film, "relative", 1.2, 8)
    # n ~ V^(t / 2.2) with t = 3/4 where 8 of 16 columns and rows have more, away from the filtered edge
    n = np.array([1.0, 32.0]) + 1  # P and A / 2 of a curve of 1
    number = n ** (0.75 / 2.2) / (np.array([0.75, 0.25]) @ n ** (0.75 / 2.2))
    expected = np.array([0.75, 0.25]) @ (n * number**-1.2) / (np.array([0.75, 0.25]) @ n)
    assert promised == pytest.approx(expected, rel=0.1) and promised < 0.7
    assert error_of_numbers(pilot(FLAT, 1.0, (64, 64)), "relative", 1.2, 8) == pytest.approx(1)
    bright = np.where(np.kron(position[0] > 1, np.ones((PATCH, PATCH), bool)), np.sqrt(32), 1)
    # deviations in proportion to the radiance
    film = replace(film, mean=film.mean * bright[..., None].astype(np.float32))
    assert error_of_numbers(film, "absolute", 1.2, 8) < 0.7 and error_of_numbers(film, "relative", 1.2, 8) > 0.9
    luck = np.random.default_rng(1).lognormal(0, 2, (2, 16, 16))[[0, 1, 1, 0]]
    assert error_of_numbers(pilot(FLAT, luck, (64, 64)), "relative", 1.2, 8) > 0.95


def test_pilots_of_some_patches_judge_alike() -> None:
    """What the pilot has not seen counts nowhere: neither as dark pixels, nor as zeros among neighbours."""
    curve, position = FLAT * 0.5, np.ones((4, 16, 16))
    curve[0] = 0.01
    position[:, :8] = 32
    brightness = np.kron(np.repeat([1.0, 6.0], 8), np.ones(PATCH))[:, None, None].astype(np.float32)
    whole = pilot(curve, position, (64, 64))
    whole = replace(whole, mean=whole.mean * brightness)
    orders = np.random.default_rng(4).random((8, 8, 4)).argsort(axis=2)  # one of 2x2 patches, in all parts alike
    seen = (orders == 0).reshape(8, 8, 2, 2).swapaxes(1, 2).reshape(16, 16)
    mask = patch_spread(seen, PATCH, (64, 64))[..., None]
    sums = {name: a * seen for name, a in whole.sums.items()}
    some = replace(whole, n=whole.n * mask, mean=whole.mean * mask, sums=sums)
    for error in ("relative", "absolute"):
        one, other = (error_of_numbers(of, error, 1.2, 8) for of in (whole, some))
        assert other == pytest.approx(one, rel=0.02)
        one, other = (decide_one_pattern(of, error)[1] for of in (whole, some))
        assert other == pytest.approx(one, rel=0.02)
    even = replace(some, sums={**some.sums, "position": seen * np.ones((4, 16, 16)), "curve": 0 * some.sums["curve"]})
    assert error_of_numbers(even, "absolute", 1.2, 8) == pytest.approx(1, abs=1e-9)


def test_lights_that_few_samples_see() -> None:
    """Weak and smooth lights are halved; the pilot tells the variance of each."""
    lights = np.array([[1, 0.002, 0.002], [1, 1, 0.3]]).repeat(2, axis=0).T[:, None] * np.ones((4, 1, 4, 1))
    curve = FLAT.copy()
    curve[-1] = 1e-3
    looked = pilot(curve)
    choice, _ = decided_patterns(replace(looked, sums={**looked.sums, "lights": lights}))
    assert choice is not None and (choice.halvings[1, :, 0] > choice.halvings[1, :, 3]).all()
    of_pattern, of_lights = pattern_costs(RAYS, 4, ("light", "brdf"), 2)
    k = choice.pattern[0, 0]
    part = 2.0 ** -choice.halvings[:, 0, 0].astype(float)
    assert choice.cost[0, 0] == pytest.approx(of_pattern[k] - (of_lights[:, k] * (1 - part)).sum())


def test_the_pilot_looks_at_one_pixel_of_each_colour_in_a_patch() -> None:
    mask = by_colour(looks_at((8, 12)))
    np.testing.assert_array_equal(patch_sum(mask, PATCH), np.ones((4, 2, 3)))
    assert len(LOOKS) == 4 and patch_sum(looks_at((5, 9)), PATCH).min() == 1
    every_second = np.indices((16, 16)).sum(axis=0) % 2 == 0
    np.testing.assert_array_equal(patch_sum(looks_at((64, 64), 2), PATCH) > 0, every_second)


# --- numbers of samples


def test_spikes_not_seen_yet_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of V / (n - 1) of samples, over I^2 + .1 I^2 for relative errors; and V of 8 samples in sub-blocks."""
    spikes = []
    monkeypatch.setattr(sample_density, "neighbour_variance", lambda v, s, *_: spikes.append(s) or np.ones(v.shape))
    first = first_film(EVEN)
    first = replace(first, sums={**first.sums, "squares": first.sums["squares"] * 3})  # mean 1, mean square 3
    for error, weight in (("absolute", 1), ("relative", 1 / 1.1)):
        second = second_round(first, replace(PLAIN, error=error))
        np.testing.assert_allclose(spikes.pop(), 0.1 * (3 - 1) / (N - 1) * weight, rtol=1e-5)
        np.testing.assert_allclose(second.maps["variance"], 1 / (8 * 7))


@pytest.mark.parametrize("error", ["absolute", "relative"])
@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (17, 30)])
def test_decisions_of_a_colour_come_from_the_others(shape: tuple[int, int], error: str) -> None:
    """Samples of one colour's pixels change: their numbers do not, those of others do."""
    first, rule = random_film(shape), replace(PLAIN, error=error)

    def maps(first: Film) -> Array:
        second = second_round(first, rule, choice_of(shape, 1.01))
        return np.array([*decided(first, rule), np.broadcast_to(second.spp, shape)])

    expected = maps(first)
    assert np.isfinite(expected).all() and (expected >= 0).all()
    for colour, at in enumerate(COLOURS):
        sums = {name: a.copy() for name, a in first.sums.items()}
        for a in sums.values():
            a[colour] *= np.random.default_rng(2).lognormal(0, 2, a[colour].shape)
        root, mean = first.root.copy(), first.mean.copy()
        root[at] *= 100
        mean[at] *= 10
        changed = maps(replace(first, sums=sums, mean=mean, root=root))
        np.testing.assert_allclose(changed[:, *at] / np.maximum(expected[:, *at], 1e-9), 1, rtol=1e-12)
        if expected[0].size > 100:
            assert (changed != expected).any(axis=(1, 2)).all()


def test_relative_errors_spend_more_on_dark_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the image is ten times brighter, with ten times the deviation: its relative error is the same."""
    monkeypatch.setattr(sample_density, "PRICE", 1.0)  # however little it gains
    bright = np.where(np.arange(32) < 16, 10.0, 1.0)[:, None, None] * np.ones((32, 32, 3))
    density = {
        error: decided(first_film(bright, bright), replace(PLAIN, error=error))[0] for error in ("absolute", "relative")
    }
    ratio = {error: of_pixels[:8].mean() / of_pixels[24:].mean() for error, of_pixels in density.items()}
    assert ratio["absolute"] == pytest.approx(100 ** (1 / 2.4), rel=1e-3)
    # (I^2 / (I^2 + e))^(t / 2.4) of both halves,  e = .1 * 5.5^2,  t = .75
    assert ratio["relative"] == pytest.approx((100 / 103.025 * 4.025) ** (0.75 / 2.4), rel=1e-2)
    scaled, _ = decided(first_film(10 * bright, 10 * bright), replace(PLAIN, error="relative"))
    np.testing.assert_allclose(scaled, density["relative"], rtol=1e-3)
    # n ~ C^(-1 / (1 + a)) where V is the same, C being by the rays: 1 + 2 / 4 and .4 for each kind
    first = first_film(EVEN)
    sums = {name: a.copy() for name, a in first.sums.items()}
    for name in ("closest hits", "occlusion rays"):
        sums[name][..., 2:] *= 3  # columns of patches
    density, cost = decided(replace(first, sums=sums))
    ratio = (3 + 0.02 * 2) / (1 + 0.02 * 2)  # and .02 of the mean, (1 + 3) / 2
    np.testing.assert_allclose(cost[0, -1] / cost[0, 0], ratio)
    np.testing.assert_allclose(density[0, 0] / density[0, -1], ratio ** (1 / 2.4))


@pytest.mark.parametrize("cost", [1.01, 1.6])
def test_budget_counts_what_patterns_cost(cost: float) -> None:
    """Each colour's part is used to 2 %: camera samples of the pattern 1:1 and as costly as the pixel's other ones."""
    first = random_film((64, 64))
    second = second_round(first, choice=choice_of((64, 64), cost))
    total = second.spp + second.begin
    assert (total >= N).all() and (np.bitwise_count(total) == 1).all()
    of_pixels = decided(first)[1]
    for at in COLOURS:
        spent = (total * of_pixels)[at].sum() / of_pixels[at].sum() * cost
        assert 0.98 * first.budget < spent <= first.budget * (1 + 1e-9)


@pytest.mark.parametrize(("error", "t"), [("absolute", 1.0), ("relative", 0.75)])
def test_numbers_follow_the_variance(error: str, t: float) -> None:
    """n ~ V^(t / (1 + a)) at equal costs, far from the edge of a half image with 32 times the V of the neighbours."""
    root = np.ones((32, 32, 3))
    root[:, 16:] *= np.sqrt(32)
    first, rule = first_film(root), replace(PLAIN, error=error)
    second = second_round(first, rule)
    np.testing.assert_array_equal(second.maps["confidence"], [t] * 4)
    assert (second.maps["number_error"] < 0.85).all()
    density, _ = decided(first, rule)
    np.testing.assert_allclose(density[:, 24:].mean() / density[:, :8].mean(), 32 ** (t / 2.4), rtol=1e-3)


def test_numbers_are_equal_where_variance_is_luck() -> None:
    """Spikes that the neighbours do not have: no pixel gets more samples for them, and all end with the budget."""
    spikes = np.random.default_rng(1).lognormal(0, 2, (64, 64, 1)) * np.ones(3)
    second = second_round(first_film(spikes, budget=100))
    assert (second.spp, second.begin) == (100 - N, N)
    assert (second.maps["number_error"] > 0.85).all()
    # a bright noisy column beside a dark even one: its variance counts with its own 1 / I^2, not its neighbour's
    mean = np.where(np.arange(64) % 8 < 4, 10.0, 0.1)[None, :, None] * np.ones((64, 64, 3))
    second = second_round(first_film(mean, mean), replace(PLAIN, error="relative"))
    # V q is 1 / (1 + e / I^2) in bright pixels and next to nothing in dark ones: half of the pixels have all error
    errors = second.maps["number_error"]
    assert ((errors > 2.0**-1.4 - 0.05) & (errors < 0.85)).all()


# --- rounds


@pytest.mark.parametrize(("sampler", "exponent"), [("sobol", 1.4), ("independent", 1.0)])
def test_rounds_of_a_budget(sampler: str, exponent: float) -> None:
    """A pilot that is not in the image, then rounds that go on from each other with the sampler of the settings."""
    settings = dmis.Settings(sampler=sampler, reuse_pilot=False, integrator="direct", max_depth=5)
    budget = Budget(64, (12, 12), settings, seed=3)
    generator = replace(PLAIN, exponent=0.0).rounds(budget)
    looked = next(generator)
    assert (looked.image_weight, looked.settings.sampler, looked.settings.shading_samples) == (0, "independent", 4)
    np.testing.assert_array_equal(looked.spp, 4 * looks_at((12, 12)))
    first = generator.send(pilot(FLAT, 3.0, (12, 12)))
    assert (first.spp, first.image_weight, first.settings, first.patterns) == (N, N, settings, None)
    root = np.where(np.arange(12) < 6, 1.0, 8.0)[:, None] * np.ones((12, 12, 3))
    film = first_film(root, budget=64)
    second = generator.send(film)
    assert (second.image_weight, second.settings, second.begin) == (64, settings, N)
    assert second.before is not None and second.before.mean is film.mean
    same, other = (
        replace(PLAIN, exponent=a).second_round(first, film, budget, None, {}) for a in (exponent, 2.4 - exponent)
    )
    np.testing.assert_array_equal(second.spp, same.spp)
    assert np.any(second.spp != other.spp)


@pytest.mark.parametrize(("position", "stage"), [(1.0, "final"), (np.repeat([100.0, 1.0], 8), "first")])
def test_paths_have_a_first_round_only_if_numbers_may_pay(position: Array | float, stage: str) -> None:
    """Otherwise the pilot is followed by one round with all samples of the budget."""
    budget = Budget(64, (64, 64), dmis.Settings(sampler="sobol", integrator="path", max_depth=5))
    rounds = Auto().rounds(budget)
    assert next(rounds).stage == "pilot"
    round_ = rounds.send(pilot(FLAT, position, (64, 64)))
    spp = 64 if stage == "final" else 16
    assert (round_.stage, round_.spp, round_.begin, round_.image_weight) == (stage, spp, 0, spp)


def test_rounds_without_shares_to_choose() -> None:
    """`counts`, and a budget or a scene for which no pattern can pay, have no pilot."""
    direct, path = (dmis.Settings(sampler="sobol", integrator=name, max_depth=5) for name in ("direct", "path"))
    cases = (
        (Auto(weights=False), 64, path, "first"),
        (Auto(weights=False), 16, path, "first"),
        (Auto(spp=4), 16, path, "first"),
        (Auto(), 31, path, "final"),
        (Auto(), 31, direct, "pilot"),
    )
    for rule, budget, settings, stage in cases:
        first = next(rule.rounds(Budget(budget, (4, 4), settings)))
        assert first.stage == stage
        assert first.image_weight == (0 if stage == "pilot" else first.spp)
    assert isinstance(make_rule("counts"), Auto) and not make_rule("counts").weights
    # first round grows with the budget
    sizes = {16: 4, 31: 4, 32: 8, 63: 8, 64: 16, 256: 32, 1024: 64, 4096: 64}
    assert {spp: make_rule("auto").pilot_samples(spp) for spp in sizes} == sizes


@pytest.mark.parametrize(
    ("rule", "least", "others"), [("auto", 16, (1, 15)), ("auto:spp=16", 32, (31,)), ("balance", 0, ())]
)
def test_small_budgets_have_equal_numbers(box: dmis.Scene, rule: str, least: int, others: tuple[int, ...]) -> None:
    """Below twice the first round there is none, and the provenance has the reason."""
    assert not make_rule(rule).fallback(max(least, 1))
    for spp in others:
        reason = f"fewer than {least} samples per pixel, rendered with w = 1/2"
        assert (make_rule(rule).fallback(spp), make_rule(rule).pilot_samples(spp)) == (reason, 0)
        result = dmis.render(box, rule, spp, sampler="sobol", compensation=0.0)
        assert (result.samples == spp).all() and (result.weight == 0.5).all()
        assert result.provenance["fallback"] == reason
        np.testing.assert_array_equal(result.image, dmis.render(box, "balance", spp, sampler="sobol").image)


# --- bias: images of few samples, whose mean is the converged image


@cache
def spiky(side: int) -> dmis.Scene:
    """Return a scene with spikes: a glossy body that few samples find a bright lamp on; 12 blocks of side x side."""
    return shared_scene("killeroo-gold", (4 * side, 3 * side))


def blocks(rule: str, spp: int, seeds: range, side: int) -> Array:
    """Return the means of many renders over blocks of pixels, and over the image, ``(N, 12 + 1)``."""
    renders = (dmis.render(spiky(side), rule, spp, seed=seed, sampler="sobol", parallel=1) for seed in seeds)
    of_blocks = [patch_sum(render.image.mean(axis=2, dtype=float), side).ravel() / side**2 for render in renders]
    return np.array([[*means, np.mean(means)] for means in of_blocks])


@cache
def converged(side: int) -> Array:
    """Return blocks of a few images of many samples, whose error is below 1 / N."""
    return blocks("balance", 2**14 // side**2, range(10**6, 10**6 + 8), side)


def z_of(rule: str, spp: int, seeds: int) -> Array:
    """Return z of 12 blocks and of the image, over many renders, against the converged images.

    Few renders have four times the pixels each, because a render has a fixed cost.
    """
    side = 8 if seeds < 100 else 4
    images, expected = blocks(rule, spp, range(seeds), side), converged(side)
    variance = sum(a.var(axis=0, ddof=1) / len(a) for a in (images, expected))
    return np.asarray((images.mean(axis=0) - expected.mean(axis=0)) / np.sqrt(variance))


@pytest.fixture
def leak(monkeypatch: pytest.MonkeyPatch) -> None:
    """Decide numbers from the variance of each pixel's own samples, with full confidence."""

    def own(variance: Array, spikes: Array, *colours: object) -> Array:
        return variance + 1e-3 * variance.mean()

    monkeypatch.setattr(sample_density, "neighbour_variance", own)
    monkeypatch.setattr(sample_density, "CONFIDENCES", {"relative": (1.0,)})
    monkeypatch.setattr(sample_density, "PRICE", 10.0)


@pytest.mark.parametrize(
    ("spp", "seeds"), [(16, 40), *(pytest.param(spp, 1000, marks=pytest.mark.slow) for spp in (16, 32))]
)
def test_bias_of_own_samples_is_seen(leak: None, spp: int, seeds: int) -> None:
    """Positive control: pixels that look even get no more samples, and stay too dark."""
    rule, z_limit = ("auto", 2 * Z_LIMIT) if seeds < 1000 else ("counts", 3 * Z_LIMIT)
    assert z_of(rule, spp, seeds)[-1] < -z_limit


LONG = [(rule, spp, 1000) for rule in ("auto", "counts", "auto:guard=0") for spp in (16, 32)]


@pytest.mark.parametrize(
    ("rule", "spp", "seeds"), [("auto", 16, 40), *(pytest.param(*case, marks=pytest.mark.slow) for case in LONG)]
)
def test_images_of_few_samples_are_unbiased(rule: str, spp: int, seeds: int) -> None:
    assert np.abs(z_of(rule, spp, seeds)).max() < Z_LIMIT
