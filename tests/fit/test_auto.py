"""Two rounds: planted best patterns, numbers from the neighbours alone, and no bias on spikes."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import dmis
from dmis.base.patches import COLOURS, PATCH, by_colour, other_colours, patch_sum
from dmis.base.vectors import Array
from dmis.estimator.cost import pattern_costs, rays_of_colours
from dmis.estimator.patterns import EQUAL, FIRST, PATTERNS, SAMPLES_OF, SHARE_OF, SHARES
from dmis.fit import auto, sample_density
from dmis.fit.auto import Auto
from dmis.fit.best_pattern import HALF, best_patterns
from dmis.fit.curve_minimum import PatchCurves
from dmis.fit.registry import make_rule
from dmis.fit.round import Budget, Pilot, Round
from dmis.fit.sample_numbers import powers_of_two
from dmis.intersect import ray_kind_of_colour
from dmis.variance.curves import with_gain_square
from dmis.variance.moments import Film

PLAIN = Auto(spp=16, exponent=1.4, filter="none", guard=0.0)
"""A rule that believes planted curves."""
RAYS = {"camera": 1000, "shadow": 1900, "brdf": 1300}
RAYS |= {ray_kind_of_colour(kind, k): n // 4 for kind, n in RAYS.items() for k in range(4)}
EVEN = np.ones((16, 16, 3))
FLAT = np.ones(len(SHARES))
N = 8
"""Camera samples of a first round."""
LIGHTS = 2
"""Lights of a random first round."""
Z_LIMIT = 4.5


def pilot(
    curve: Array, position: Array | float = 0.0, root: Array = EVEN, own: Array | None = None, budget: int = 10**6
) -> Pilot:
    """Return a first round of pixels with the curves ``(G,)`` or ``(..., G, rows, columns)`` and with a `root` of m2.

    The halves of its samples differ as if the root were `own`; None: `root`.
    """
    own = root if own is None else own
    patches = tuple(-(-n // PATCH) for n in root.shape[:2])
    curve = np.broadcast_to(curve[:, None, None] if curve.ndim == 1 else curve, (4, len(SHARES), *patches))
    sums = {"curve": curve, "gain_square": np.stack([with_gain_square(c, c, HALF)["gain_square"] for c in curve])}
    sums["position"] = np.broadcast_to(position, (4, *patches))
    sums = {name: 4.0 * a for name, a in sums.items()}  # a quarter of the 16 pixels of a patch has each colour
    sums["halves"] = patch_sum(by_colour((own**2).mean(axis=2)), PATCH)
    film = Film(N, np.ones(root.shape, np.float32), root.astype(np.float32))
    return Pilot(film, RAYS, sums, budget=budget)


def random_pilot(shape: tuple[int, int]) -> Pilot:
    """Return a first round with random variances and curves of each colour."""
    rng = np.random.default_rng(1)
    patches = tuple(-(-n // PATCH) for n in shape)
    curve, position = rng.lognormal(0, 1, (4, len(SHARES), *patches)), rng.lognormal(0, 1, (4, *patches))
    first = pilot(curve, position, rng.lognormal(0, 2, (*shape, 3)), budget=64)
    return replace(first, sums={**first.sums, "lights": rng.lognormal(0, 2, (4, LIGHTS + 1, *patches))})


def second_round(first: Pilot, rule: Auto = PLAIN) -> Round:
    """Return the second round that a rule decides from the first one."""
    return rule.second_round(first, Budget(first.budget, first.moments.mean.shape[:2], dmis.Settings(), seed=3))


def decided(first: Pilot, rule: Auto = PLAIN) -> Array:
    """Return the density of the camera samples and the cost of one at each pixel, ``(2, H, W)``."""
    maps = np.empty((2, *first.moments.mean.shape[:2]))
    colours = (at for at in COLOURS if maps[0][at].size)

    def keep(density: Array, cost: Array, *others: Any) -> Array:
        maps[:, *next(colours)] = density, cost
        return powers_of_two(density, cost, *others)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(auto, "powers_of_two", keep)
        second_round(first, rule)
    return maps


def costs(lights: int = 1) -> Array:
    """Return the cost of a camera sample with each pattern, over that of the pattern 1:1.

    Of 2000 light and 2000 BRDF samples 1900 and 1300 trace a ray, which costs .4, after .25 for each light.
    """
    n_l, n_b = np.transpose(PATTERNS)
    cost = 1 + n_l * (0.25 * lights + 0.4 * 0.95) + n_b * (0.25 * lights + 0.4 * 0.65)
    return cost / cost[EQUAL]


def test_best_pattern_by_the_formula() -> None:
    """The error of going on and of restarting, at equal cost, for random curves and parts of the first round."""
    rng, a = np.random.default_rng(5), 1.4
    curve, place, cost = rng.lognormal(0, 1, (len(SHARES), 1, 200)), rng.lognormal(-1, 1, (1, 200)), costs()
    curves = PatchCurves(curve, (curve - curve[HALF]) ** 2, place, np.full((1, 200), 12.0), HALF)
    spent = rng.uniform(0.02, 0.6, (1, 200))
    patterns, restarts, ratio = best_patterns(curves, cost, spent, np.ones(len(SHARES), bool), 0.0, a)
    n_1, m = spent / cost[FIRST], (1 - spent) / cost[:, None, None]
    n, v = n_1 + m, np.array([place + 2 * curve[g] / s for g, s in zip(SHARE_OF, SAMPLES_OF)])
    of_lobes = (m / n) ** 2 * (v - place) * m**-a + (n_1 / n) ** 2 * curve[HALF] / 2 * n_1**-a
    on, anew = place * n**-a + of_lobes, v * m**-a
    on[FIRST] = v[FIRST] * cost[FIRST] ** a
    error = np.where((curve < curve[HALF])[SHARE_OF] | (SHARE_OF == HALF)[:, None, None], np.minimum(on, anew), np.inf)
    best = error.argmin(axis=0)[None]
    np.testing.assert_array_equal(patterns, best[0])
    assert 0.1 < restarts.mean() < 0.9 and len(np.unique(best)) > 5
    on, anew, n, m, error = (np.take_along_axis(x, best, axis=0)[0] for x in (on, anew, n, m, error))
    np.testing.assert_array_equal(restarts, anew < on)
    np.testing.assert_allclose(ratio, error * np.where(restarts, m, n) ** a / v[FIRST])


def test_spikes_not_seen_yet_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of (A / 4 + P) / n of independent points, over I^2 + .1 I^2 for relative errors; and V of 8 samples."""
    spikes = []
    monkeypatch.setattr(sample_density, "neighbour_variance", lambda v, s, *_: spikes.append(s) or np.ones(v.shape))
    for error, weight in (("absolute", 1), ("relative", 1 / 1.1)):
        second = second_round(pilot(3 * FLAT, 2.0), replace(PLAIN, error=error))
        np.testing.assert_allclose(spikes.pop(), 0.1 * (3 / 2 + 2) / N * weight, rtol=1e-6)
        np.testing.assert_allclose(second.maps["variance"], 1 / (8 * 7))


def test_numbers_where_few_samples_see_a_light() -> None:
    """n ~ (V / C)^(1 / (1 + a)) with the V and C that are left; half of the image has other variances of lights."""
    lights = np.array([[1, 0.02, 0.02], [1, 1, 0.3]]).repeat(2, axis=0).T[:, None] * np.ones((4, 1, 4, 1))
    first = pilot(0 * FLAT)
    first = replace(first, sums={**first.sums, "lights": lights})
    patterns, (density, cost) = second_round(first).patterns, decided(first)
    assert patterns is not None and patterns.halvings is not None and (patterns.pattern == FIRST).all()
    left = patterns.halvings[:, 0, [0, -2]].astype(float)
    v = lights[0, :, 0, [0, -1]].T
    rays = rays_of_colours(RAYS, other_colours(0))
    all_costs, of_lights = pattern_costs(rays, first.shading_samples, first.techniques, LIGHTS)
    ratio = (v * 2.0 ** (1.4 * left)).sum(axis=0) / v.sum(axis=0)
    c = all_costs[FIRST] - (of_lights[:, FIRST, None] * (1 - 2.0**-left)).sum(axis=0)
    assert (left[:, 0] != left[:, 1]).any()
    np.testing.assert_allclose(cost[0, [0, -2]], c)
    of_halves = density[0, [0, -2]]
    assert of_halves[0] / of_halves[1] == pytest.approx(((ratio / c)[0] / (ratio / c)[1]) ** (1 / 2.4))


def test_ends_need_to_be_good_for_the_image() -> None:
    """In a patch where light samples alone are best; not where the whole image is far worse with them."""
    curve = np.ones((len(SHARES), 4, 4))
    curve[-1, 0, 0] = 0.01
    assert (second_round(pilot(curve)).maps["pattern"][:, 0, 0] < 3).all()
    curve[-1, 3, 3] = 50
    chosen = second_round(pilot(curve)).maps["pattern"]
    assert all(min(PATTERNS[k]) > 0 for k in np.unique(chosen))


def test_shares_of_counts_are_a_half() -> None:
    """However good others are."""
    curve = FLAT.copy()
    curve[[0, -2, -1]] = 1e-3
    patterns = second_round(pilot(curve), replace(PLAIN, weights=False)).patterns
    np.testing.assert_array_equal(SHARES[SHARE_OF[patterns.pattern]], 0.5)
    assert isinstance(make_rule("counts"), Auto) and not make_rule("counts").weights
    with pytest.raises(ValueError, match=r"rule counts has the options spp, .*; got 'weights'"):
        make_rule("counts:weights=yes")


def test_guard_holds_uncertain_gains() -> None:
    """Pixels that differ: a gain within some standard errors of its mean is none."""
    curve = FLAT.copy()
    curve[-2] = 0.5
    first = pilot(curve)
    noisy = {**first.sums, "gain_square": first.sums["gain_square"] + 4 * 100.0}
    for sums, share in ((first.sums, SHARES[-2]), (noisy, 0.5)):
        second = second_round(replace(first, sums=sums), replace(PLAIN, guard=1.5))
        np.testing.assert_allclose(SHARES[SHARE_OF[second.patterns.pattern]], share)


@pytest.mark.parametrize("error", ["absolute", "relative"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (2, 3), (3, 2), (17, 30)])
def test_decisions_of_a_colour_come_from_the_others(shape: tuple[int, int], error: str) -> None:
    """Samples of one colour's pixels change: their patterns and numbers do not, those of others do."""
    first, rule = random_pilot(shape), replace(PLAIN, filter="gaussian", error=error)

    def maps(first: Pilot) -> Array:
        second = second_round(first, rule)
        assert second.patterns is not None and second.patterns.halvings is not None
        halvings = second.patterns.halvings.sum(axis=0)
        return np.array([*decided(first, rule), second.patterns.pattern, halvings, second.begin, second.spp])

    expected = maps(first)
    assert np.isfinite(expected).all() and (expected >= 0).all()
    for colour, at in enumerate(COLOURS):
        sums = {name: a.copy() for name, a in first.sums.items()}
        for a in sums.values():
            a[colour] *= np.random.default_rng(2).lognormal(0, 2, a[colour].shape)
        root = first.moments.root.copy()
        root[at] *= 100
        mean = first.moments.mean.copy()
        mean[at] *= 10
        rays = {**first.rays, ray_kind_of_colour("brdf", colour): 10**5}
        changed = maps(replace(first, sums=sums, moments=replace(first.moments, mean=mean, root=root), rays=rays))
        np.testing.assert_array_equal(changed[:, *at], expected[:, *at])
        if expected[0].size > 100:
            assert (changed != expected).any(axis=(1, 2)).all()


def test_relative_errors_spend_more_on_dark_pixels() -> None:
    """Half of the image is ten times brighter, with ten times the deviation: its relative error is the same."""
    bright = np.where(np.arange(32) < 16, 10.0, 1.0)[:, None, None] * np.ones((32, 32, 3))
    first = pilot(0 * FLAT, root=bright)
    first = replace(first, moments=replace(first.moments, mean=bright.astype(np.float32)))
    density = {error: decided(first, replace(PLAIN, error=error))[0] for error in ("absolute", "relative")}
    ratio = {error: of_pixels[:8].mean() / of_pixels[24:].mean() for error, of_pixels in density.items()}
    assert ratio["absolute"] == pytest.approx(100 ** (1 / 2.4), rel=1e-3)
    # (I^2 / (I^2 + e))^(t / 2.4) of both halves,  e = .1 * 5.5^2,  t = .75
    assert ratio["relative"] == pytest.approx((100 / 103.025 * 4.025) ** (0.75 / 2.4), rel=1e-2)
    brighter = replace(first.moments, mean=10 * first.moments.mean, root=10 * first.moments.root)
    scaled, _ = decided(replace(first, moments=brighter), replace(PLAIN, error="relative"))
    np.testing.assert_allclose(scaled, density["relative"], rtol=1e-3)


def test_budget_has_the_first_round_too() -> None:
    """Each colour's part is used to 2 %, with a first round that is not in the image; no pixel has fewer than two."""
    first = random_pilot((64, 64))
    root = np.ones((64, 64, 3))
    root[:, 3::8] = 1e5  # patches restart because of these pixels, and their other ones need next to nothing
    lights = first.sums["lights"]
    first = pilot(first.sums["curve"] / 4, first.sums["position"] / 4, root, budget=64)
    for case, of_first in ((first, costs()), (replace(first, sums={**first.sums, "lights": lights}), costs(LIGHTS))):
        second, cost = second_round(case), decided(case)[1]
        assert second.patterns is not None and {*np.unique(second.begin)} == {0, N}
        total = second.spp + second.begin
        assert (total >= np.where(second.begin, N, 2)).all()
        assert (np.bitwise_count(total) == 1).all()
        for at in COLOURS:
            spent = N * of_first[FIRST] + (second.spp * cost)[at].mean()
            assert 0.98 * first.budget < spent <= first.budget


@pytest.mark.parametrize(
    ("error", "confidence"), [("absolute", 1.0), ("relative", 0.75), ("relative", 0.5), ("relative", 0.0)]
)
def test_numbers_follow_the_variance_as_far_as_it_predicts(error: str, confidence: float) -> None:
    """n ~ V^(t / (1 + a)) at equal costs, far from the edge of a half image with 32 times the V of the neighbours.

    The squared differences of halves are 32^t times as large there.
    """
    root = np.ones((32, 32, 3))
    root[:, 16:] *= np.sqrt(32)
    first, rule = pilot(0 * FLAT, 0.0, root, root**confidence), replace(PLAIN, error=error)
    np.testing.assert_array_equal(second_round(first, rule).maps["confidence"], [confidence] * 4)
    density, _ = decided(first, rule)
    np.testing.assert_allclose(density[:, 24:].mean() / density[:, :8].mean(), 32 ** (confidence / 2.4), rtol=1e-3)


def test_numbers_are_equal_where_variance_is_luck() -> None:
    """Spikes that the neighbours do not have, in the halves or not: no pixel gets more samples for them."""
    spikes = np.random.default_rng(1).lognormal(0, 2, (64, 64, 1)) * np.ones(3)
    for own in (np.ones((64, 64, 3)), spikes):
        density, _ = decided(pilot(0 * FLAT, 0.0, spikes, own))
        np.testing.assert_array_equal(density, density[0, 0])


@pytest.mark.parametrize(("sampler", "exponent"), [("sobol", 1.4), ("independent", 1.0)])
def test_rounds_of_a_budget(sampler: str, exponent: float) -> None:
    """The first has half its number of camera samples, with the sampler of the second, which follows from it."""
    rule = replace(PLAIN, exponent=0.0)
    budget = Budget(64, (12, 12), dmis.Settings(sampler=sampler, reuse_pilot=False), seed=3)
    generator = rule.rounds(budget)
    first = next(generator)
    assert (first.spp, first.image_weight, first.settings.sampler) == (8, 0, sampler)
    film = random_pilot((12, 12))
    second = generator.send(film)
    assert (second.image_weight, second.before, second.settings) == (64, film.moments, budget.settings)
    same, other = (replace(rule, exponent=a).second_round(film, budget) for a in (exponent, 2.4 - exponent))
    np.testing.assert_array_equal(second.spp, same.spp)
    assert (second.spp != other.spp).any()


def test_first_round_grows_with_the_budget() -> None:
    sizes = {16: 4, 31: 4, 32: 8, 63: 8, 64: 16, 256: 32, 1024: 64, 4096: 64}
    assert {spp: make_rule("auto").pilot_samples(spp) for spp in sizes} == sizes


@pytest.mark.parametrize(
    ("rule", "least", "others"),
    [("auto", 16, (1, 15)), ("counts", 16, (7,)), ("auto:spp=16", 32, (31,)), ("balance", 0, ()), ("thesis", 0, ())],
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


def test_errors() -> None:
    for options, message in (
        ({"spp": 6}, "multiple of 4, or 0 to choose it; got 6"),
        ({"exponent": 0.5}, "exponent must be a number from 1 to 3"),
        ({"guard": -1.0}, "guard must be a number of at least 0"),
        ({"error": "mse"}, "error must be absolute or relative; got 'mse'"),
        ({"filter": "box"}, "filter must be gaussian or none or joint; got 'box'"),
    ):
        with pytest.raises(ValueError, match=message):
            Auto(**options)


# --- bias: images of few samples, whose mean is the converged image


@cache
def spiky(side: int) -> dmis.Scene:
    """Return a scene with spikes: a glossy body that few samples find a bright lamp on; 12 blocks of side x side."""
    return dmis.load_scene("killeroo-gold", resolution=(4 * side, 3 * side))


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


def test_images_of_few_samples_are_unbiased() -> None:
    assert np.abs(z_of("auto", 16, 40)).max() < Z_LIMIT


@pytest.mark.parametrize(
    ("spp", "seeds"), [(16, 40), *(pytest.param(spp, 1000, marks=pytest.mark.slow) for spp in (16, 32))]
)
def test_bias_of_own_samples_is_seen(leak: None, spp: int, seeds: int) -> None:
    """Positive control: pixels that look even get no more samples, and stay too dark."""
    rule, z_limit = ("auto", 2 * Z_LIMIT) if seeds < 1000 else ("counts", 3 * Z_LIMIT)
    assert z_of(rule, spp, seeds)[-1] < -z_limit


@pytest.mark.slow
@pytest.mark.parametrize("spp", [16, 32])
@pytest.mark.parametrize("rule", ["auto", "counts", "auto:filter=gaussian,guard=0"])
def test_many_images_of_few_samples_are_unbiased(rule: str, spp: int) -> None:
    assert np.abs(z_of(rule, spp, 1000)).max() < Z_LIMIT
