"""Two rounds: planted best patterns, numbers from the neighbours alone, and no bias on spikes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import dmis
from dmis.base.patches import COLOURS, PATCH, by_colour, patch_sum
from dmis.base.vectors import Array
from dmis.estimator.cost import camera_sample_cost, ray_kind_of_colour
from dmis.estimator.patterns import FIRST, PATTERNS, SAMPLES_OF, SHARE_OF, SHARES
from dmis.fit import rounds
from dmis.fit.registry import make_rule
from dmis.fit.rounds import HALF, LONGEST, Rounds
from dmis.fit.round import Pilot
from dmis.variance.moments import Film

PLAIN = Rounds(spp=16, exponent=1.4, filter="none", guard=0.0)
"""A rule that believes planted curves."""
RAYS = {"camera": 1000, "shadow": 1900, "brdf": 1300}
RAYS_BY_COLOUR = {ray_kind_of_colour(kind, k): n // 4 for kind, n in RAYS.items() for k in range(4)}
Z_LIMIT = 4.5


def pilot(curve: Array, position: Array | float = 0.0, size: int = 16, budget: int = 10**6) -> Pilot:
    """Return a first round of 8 camera samples whose pixels have the curves ``(G,)`` or ``(G, rows, columns)``."""
    rows = size // 4
    curve = np.broadcast_to(curve if np.ndim(curve) == 3 else curve[:, None, None], (len(SHARES), rows, rows))
    cross = curve * curve[HALF]
    sums = {"curve": curve, "square": curve**2, "cross": cross}
    sums["position"] = np.broadcast_to(position, (rows, rows))
    # a quarter of the 16 pixels of a patch has each colour
    of_colour = {name: np.repeat(4 * a[None].astype(float), 4, axis=0) for name, a in sums.items()}
    ones = np.ones((size, size, 3), np.float32)
    return with_roots(Pilot(Film(8, ones, ones), RAYS | RAYS_BY_COLOUR, of_colour, budget=budget), ones)


def with_roots(first: Pilot, root: Array) -> Pilot:
    """Return a first round whose pixels have these roots of m2, and halves that differ accordingly."""
    halves = patch_sum(by_colour((root**2).mean(axis=2)), PATCH)
    return replace(first, moments=Film(8, first.moments.mean, root), sums={**first.sums, "halves": halves})


def costs() -> Array:
    """Return the cost of a camera sample with each pattern."""
    w = SHARES[SHARE_OF]
    pairs = zip(w, SAMPLES_OF, strict=True)
    return np.concatenate([camera_sample_cost(RAYS, np.array([[x], [1 - x]]), 4, s) for x, s in pairs])


@pytest.mark.parametrize("position", [0.0, 0.3, 100.0])
@pytest.mark.parametrize("g", range(len(SHARES)))
def test_best_pattern_of_planted_curves(g: int, position: float) -> None:
    """V C^a is least, by a loop over all patterns whose share has less variance than 1/2, and over 1/2."""
    curve = 1 + np.abs(SHARES - SHARES[g])
    curve[g] = 0.05
    fit = PLAIN.fit({0.5: pilot(curve, position)})
    better = curve < curve[HALF]
    better[HALF] = True
    better[[0, -1]] &= [curve[0] <= curve[1], curve[-1] <= curve[-2]]
    objective = {
        k: (position + 2 * curve[SHARE_OF[k]] / SAMPLES_OF[k]) * c**1.4
        for k, c in enumerate(costs())
        if better[SHARE_OF[k]]
    }
    best = min(objective, key=objective.__getitem__)
    assert fit.continuation is not None
    assert (fit.continuation.patterns.pattern == best).all()
    np.testing.assert_allclose(fit.shares[0], SHARES[SHARE_OF[best]])
    # where places in the pixel are most of the error, the first round need not be lost
    goes_on = best == FIRST or position == 100
    np.testing.assert_array_equal(fit.continuation.patterns.begin, 8 if goes_on else 0)


def test_ends_need_to_be_good_for_the_image() -> None:
    """In a patch where light samples alone are best; not where the whole image is far worse with them."""
    curve = np.full((len(SHARES), 4, 4), 1.0)
    curve[-1, 0, 0] = 0.01
    assert (PLAIN.fit({0.5: pilot(curve)}).maps["pattern"][:, 0, 0] < 3).all()
    curve[-1, 3, 3] = 50
    chosen = PLAIN.fit({0.5: pilot(curve)}).maps["pattern"]
    assert all(min(PATTERNS[k]) > 0 for k in np.unique(chosen))


@pytest.mark.parametrize(("gain", "stays"), [(0.2, True), (0.9, False)])
def test_beginning_anew_must_make_up_for_the_first_round(gain: float, stays: bool) -> None:
    """Which is a third of the samples here: (1 - 1 / 3)^-1.4 = 1.76."""
    curve = np.full(len(SHARES), 1.0)
    other = PATTERNS.index((4, 2))
    curve[SHARE_OF[other]] = 1 - gain
    rich, poor = (PLAIN.fit({0.5: pilot(curve, budget=spp)}).maps["pattern"] for spp in (10**6, 32))
    assert (poor == (FIRST if stays else other)).all()
    assert (rich == other).all()


def test_shares_of_counts_are_a_half() -> None:
    """However good others are."""
    curve = np.full(len(SHARES), 1.0)
    curve[[0, -2, -1]] = 1e-3
    fit = replace(PLAIN, weights=False).fit({0.5: pilot(curve)})
    np.testing.assert_array_equal(fit.shares[0], 0.5)
    assert isinstance(make_rule("counts"), Rounds) and not make_rule("counts").weights


def test_guard_holds_uncertain_gains() -> None:
    """Pixels that differ: a gain within some standard errors of its mean is none."""
    curve = np.full(len(SHARES), 1.0)
    curve[-2] = 0.5
    first = pilot(curve)
    noisy = {**first.sums, "square": first.sums["square"] + 4 * 100.0}
    noisy["square"][:, HALF] = first.sums["square"][:, HALF]
    for sums, share in ((first.sums, SHARES[-2]), (noisy, 0.5)):
        fit = replace(PLAIN, guard=1.5).fit({0.5: replace(first, sums=sums)})
        np.testing.assert_allclose(fit.shares[0], share)


def random_pilot(shape: tuple[int, int], seed: int = 1) -> Pilot:
    """Return a first round with random variances and curves of each colour."""
    rng = np.random.default_rng(seed)
    rows, columns = (-(-n // 4) for n in shape)
    sums = {"curve": rng.lognormal(0, 1, (4, len(SHARES), rows, columns))}
    sums |= {"square": sums["curve"] ** 2, "cross": sums["curve"] * sums["curve"][:, HALF : HALF + 1]}
    sums |= {"position": rng.lognormal(0, 1, (4, rows, columns))}
    root = rng.lognormal(0, 2, (*shape, 3)).astype(np.float32)
    film = Film(8, np.ones((*shape, 3), np.float32), root)
    return with_roots(Pilot(film, RAYS | RAYS_BY_COLOUR, sums, budget=64), root)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (2, 3), (3, 2), (17, 30)])
def test_decisions_of_a_colour_come_from_the_others(shape: tuple[int, int]) -> None:
    """Samples of one colour's pixels change: their patterns and numbers do not, those of others do."""
    first = random_pilot(shape)
    rule = replace(PLAIN, filter="gaussian")
    plan = rule.fit({0.5: first}).continuation
    assert plan is not None and np.isfinite(plan.density).all() and (plan.density >= 0).all()
    for colour, at in enumerate(COLOURS):
        sums = {name: a.copy() for name, a in first.sums.items()}
        for a in sums.values():
            a[colour] *= np.random.default_rng(2).lognormal(0, 2, a[colour].shape)
        root = first.moments.root.copy()
        root[at] *= 100
        rays = {**first.rays, ray_kind_of_colour("brdf", colour): 10**5}
        film = Film(8, first.moments.mean, root)
        changed = rule.fit({0.5: replace(first, sums=sums, moments=film, rays=rays)}).continuation
        assert changed is not None
        np.testing.assert_array_equal(changed.patterns.pattern[at], plan.patterns.pattern[at])
        np.testing.assert_array_equal(changed.density[at], plan.density[at])
        np.testing.assert_array_equal(changed.cost[at], plan.cost[at])
        if plan.density.size > 100:
            assert (changed.density != plan.density).any()


def test_numbers_follow_the_variance_of_the_neighbours() -> None:
    """n ~ V^(1 / (1 + a)) at equal costs: half an image with 32 times the variance, far from the edge."""
    first = pilot(np.zeros(len(SHARES)), size=32)
    root = first.moments.root.copy()
    root[:, 16:] *= np.sqrt(32)
    plan = PLAIN.fit({0.5: with_roots(first, root)}).continuation
    assert plan is not None
    np.testing.assert_allclose(plan.density[:, 24:].mean() / plan.density[:, :8].mean(), 32 ** (1 / 2.4), rtol=1e-3)


@pytest.mark.parametrize(("power", "trust"), [(1.0, 1.0), (0.5, 0.5), (0.0, 0.0)])
def test_numbers_follow_the_variance_as_far_as_it_predicts(power: float, trust: float) -> None:
    """V is 32 times as large in one half of the image, and the squared differences of halves 32^power times."""
    first = pilot(np.zeros(len(SHARES)), size=32)
    root = first.moments.root.copy()
    root[:, 16:] *= np.sqrt(32)
    halves = with_roots(first, root**power).sums["halves"]
    planted = with_roots(first, root)
    fit = PLAIN.fit({0.5: replace(planted, sums={**planted.sums, "halves": halves})})
    np.testing.assert_array_equal(fit.maps["trust"], [trust] * 4)
    plan = fit.continuation
    assert plan is not None
    ratio = plan.density[:, 24:].mean() / plan.density[:, :8].mean()
    np.testing.assert_allclose(ratio, 32 ** (trust / 2.4), rtol=1e-3)


def test_numbers_are_equal_where_variance_is_luck() -> None:
    """Spikes of the first round that its halves do not have: no pixel gets more samples for them."""
    first = pilot(np.zeros(len(SHARES)), size=64)
    root = np.random.default_rng(1).lognormal(0, 2, (64, 64, 1)).astype(np.float32) * np.ones(3, np.float32)
    plan = PLAIN.fit({0.5: replace(with_roots(first, root), sums=first.sums)}).continuation
    assert plan is not None
    np.testing.assert_array_equal(plan.density, plan.density[0, 0])


@pytest.mark.parametrize(
    ("spp", "first"), [(16, 4), (31, 4), (32, 8), (63, 8), (64, 16), (256, 32), (1024, LONGEST), (4096, LONGEST)]
)
def test_first_round_grows_with_the_budget(spp: int, first: int) -> None:
    rule = make_rule("auto").adapted(spp, "sobol")
    assert rule.pilot == {0.5: first}
    assert rule.exponent == 1.4 and make_rule("auto").adapted(spp, "independent").exponent == 1


@pytest.mark.parametrize(
    ("rule", "spp", "replicates", "least"),
    [
        ("auto", 15, 1, 16), ("auto", 16, 1, 0), ("counts", 7, 1, 16), ("auto:spp=16", 31, 1, 32), ("auto", 31, 4, 32),
        ("balance", 1, 1, 0), ("thesis", 4, 1, 0),
    ],
)  # fmt: skip
def test_a_fallback_is_named(rule: str, spp: int, replicates: int, least: int) -> None:
    """The reason is there exactly where the rule of the budget is another one."""
    given = make_rule(rule)
    reason = f"fewer than {least} samples per pixel, rendered as balance" if least else ""
    assert given.fallback(spp, replicates) == reason
    assert (given.adapted(spp, "sobol", replicates).continues != given.continues) == bool(reason)


@pytest.mark.parametrize(("rule", "spp"), [("auto", 15), ("auto", 1), ("counts", 7), ("auto:spp=16", 31)])
def test_small_budgets_have_equal_numbers(box: dmis.Scene, rule: str, spp: int) -> None:
    """Below twice the first round there is none."""
    result = dmis.render(box, rule, spp, sampler="sobol", compensation=0.0)
    assert (result.samples == spp).all() and (result.weight == 0.5).all()
    np.testing.assert_array_equal(result.image, dmis.render(box, "balance", spp, sampler="sobol").image)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spp": 6}, "multiple of 4, or 0 to choose it; got 6"),
        ({"exponent": 0.5}, r"exponent must be in \[1, 3\]"),
        ({"guard": -1.0}, "guard must not be negative"),
        ({"filter": "box"}, "filter must be gaussian, none or joint; got 'box'"),
    ],
)
def test_errors(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Rounds(**options)


def test_counts_has_no_option_for_weights() -> None:
    """Which would make it another rule."""
    with pytest.raises(ValueError, match=r"rule counts has the options spp, .*; got 'weights'"):
        make_rule("counts:weights=yes")


# --- bias: images of few samples, whose mean is the converged image


@cache
def spiky() -> dmis.Scene:
    """Return a scene with spikes: a glossy body that few samples find a bright lamp on."""
    return dmis.load_scene("killeroo-gold", resolution=(16, 12))


@cache
def truth() -> tuple[Array, Array]:
    """Return the converged image, and its variance."""
    images = np.array([render("balance", 4096, 10**6 + seed) for seed in range(8)])
    return images.mean(axis=0), images.var(axis=0, ddof=1) / len(images)


def render(rule: str, spp: int, seed: int) -> Array:
    """Return an image of the scene, mean of the channels."""
    return dmis.render(spiky(), rule, spp, seed=seed, sampler="sobol", parallel=1).image.mean(axis=2, dtype=float)


def blocks(images: Array) -> Array:
    """Return the means over blocks of 4x4 pixels, and over the image, ``(N, blocks + 1)``."""
    of_blocks = images.reshape(-1, 3, 4, 4, 4).mean(axis=(2, 4)).reshape(-1, 12)
    return np.concatenate([of_blocks, of_blocks.mean(axis=1, keepdims=True)], axis=1)


def z_of(rule: str, spp: int, seeds: int) -> Array:
    """Return z of 12 blocks and of the image, over many renders, against the converged image."""
    expected, variance = truth()
    images = blocks(np.array([render(rule, spp, seed) for seed in range(seeds)]))
    noise = blocks(variance[None])[0] / np.array([16] * 12 + [192])
    return (images.mean(axis=0) - blocks(expected[None])[0]) / np.sqrt(images.var(axis=0, ddof=1) / seeds + noise)


@pytest.fixture
def leak(monkeypatch: pytest.MonkeyPatch) -> None:
    """Decide numbers from the variance of each pixel's own samples, and trust it."""

    def own(rule: Rounds, variance: Array, curves: object, n: int, *colours: object) -> Array:
        return variance + 1e-3 * variance.mean()

    monkeypatch.setattr(Rounds, "_variance", own)
    monkeypatch.setattr(rounds, "TRUSTS", (1.0,))


def test_images_of_few_samples_are_unbiased() -> None:
    assert np.abs(z_of("auto", 16, 150)).max() < Z_LIMIT


def test_bias_of_own_samples_is_seen(leak: None) -> None:
    """Positive control: pixels that look even get no more samples, and stay too dark."""
    assert z_of("auto", 16, 150)[-1] < -2 * Z_LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("spp", [16, 32])
@pytest.mark.parametrize("rule", ["auto", "counts", "auto:filter=gaussian,guard=0"])
def test_many_images_of_few_samples_are_unbiased(rule: str, spp: int) -> None:
    assert np.abs(z_of(rule, spp, 1000)).max() < Z_LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("spp", [16, 32])
def test_bias_of_own_samples_is_seen_in_many_images(leak: None, spp: int) -> None:
    assert z_of("counts", spp, 1000)[-1] < -3 * Z_LIMIT
