"""Heuristics and the division of samples."""

from pathlib import Path

import numpy as np
import pytest
from helpers import LEVEL, Z_LIMIT, pixel_shares, z_score

import dmis
from dmis.base.vectors import Array
from dmis.estimator.allocation import Counts, allocate, rounding_covariance, shares_of
from dmis.estimator.mis import balance, combiner_by_name, cutoff, maximum, power
from dmis.fit.registry import make_rule
from dmis.testing.statistics import chi2_p

HEURISTICS = [
    "balance",
    "frozen",
    "power",
    "power-1",
    "power-3",
    "power-0.5",
    "maximum",
    "cutoff",
    "cutoff-0.5",
    "cutoff-1",
]
each_heuristic = pytest.mark.parametrize("name", HEURISTICS)


def weights(name: str, a: Array, b: Array) -> tuple[Array, Array]:
    """MIS weights of a sample with densities `a`, `b`, as the first and as the second technique's."""
    heuristic = combiner_by_name(name).heuristic
    return a.astype(float) * heuristic((a, b), 0), b.astype(float) * heuristic((a, b), 1)


@each_heuristic
def test_weights_sum_to_one(name: str) -> None:
    """``W_first + W_second = 1`` on densities over twelve magnitudes, and for equal ones."""
    a, b = 10 ** np.random.default_rng(1).uniform(-6, 6, (2, 1000)).astype(np.float32)
    b[:100] = a[:100]
    first, second = weights(name, a, b)
    np.testing.assert_allclose(first + second, 1, rtol=1e-6)
    assert (first >= 0).all() and (second >= 0).all()


@each_heuristic
@pytest.mark.parametrize(
    "a, b", [(0, 1), (1, 0), (1e-25, 1), (1, 1e20), (1e20, 1), (1e30, 1e30), (1e-20, 1e30), (0, 1e30), (1e30, 1e-30)]
)
def test_weights_of_extreme_densities(name: str, a: float, b: float) -> None:
    """No overflow, no NaN, and a sum of 1, where one density is 0 or enormous.

    A technique of density 0 has weight 0. The power heuristic caps the ratio at 1e18, whose weight no float sees.
    """
    first, second = weights(name, np.float32([a]), np.float32([b]))
    assert np.isfinite(first).all() and np.isfinite(second).all()
    np.testing.assert_allclose(first + second, 1, rtol=1e-6)
    if a == 0:
        assert first == 0
    if b == 0:
        assert second == 0


@each_heuristic
def test_vanishing_densities_are_finite(name: str) -> None:
    """Both 0 or 1e-30 (a float32 underflow away): finite factors."""
    for a, b in ((0, 0), (1e-30, 0), (0, 1e-30), (1e-30, 1e-30), (1e-38, 1e30)):
        for own in (0, 1):
            assert np.isfinite(combiner_by_name(name).heuristic((np.float32([a]), np.float32([b])), own)).all()


@pytest.mark.parametrize("name", [name for name in HEURISTICS if name != "frozen"])
@pytest.mark.parametrize("techniques", [3, 4])
def test_weights_of_several_techniques_sum_to_one(name: str, techniques: int) -> None:
    """A partition of unity over twelve magnitudes, with ties of two and of all, and with densities of 0; and with a
    last density of 0 everywhere, the weights of one technique fewer.
    """
    a = 10 ** np.random.default_rng(1).uniform(-6, 6, (techniques, 1000)).astype(np.float32)
    a[1, :100], a[2:, :50], a[0, 100:200] = a[0, :100], a[0, :50], 0
    heuristic = combiner_by_name(name).heuristic
    found = np.stack([a[k].astype(float) * heuristic(tuple(a), k) for k in range(techniques)])
    np.testing.assert_allclose(found.sum(axis=0), 1, rtol=1e-6)
    assert (found >= 0).all() and not found[0, 100:200].any()
    a[-1] = 0
    fewer = [a[k] * heuristic(tuple(a[:-1]), k) for k in range(techniques - 1)]
    np.testing.assert_allclose([a[k] * heuristic(tuple(a), k) for k in range(techniques - 1)], fewer, rtol=1e-6)


def test_closed_forms() -> None:
    """Densities 3 and 1: 3/4, 9/10, all, and whoever is above the threshold."""
    a, b = np.float32([3]), np.float32([1])
    for name, expected in (("balance", 0.75), ("power", 0.9), ("power-3", 27 / 28), ("maximum", 1), ("cutoff-0.5", 1)):
        first, second = weights(name, a, b)
        np.testing.assert_allclose([first[0], second[0]], [expected, 1 - expected], atol=1e-6)
    np.testing.assert_allclose(weights("cutoff-0.2", a, b)[0], 0.75)


def test_limits() -> None:
    """Power 1 and cutoff 0 are balance; cutoff 1 is maximum but for ties, which it shares; large powers are maximum."""
    a, b = np.random.default_rng(2).random((2, 100), dtype=np.float32)
    np.testing.assert_allclose(power(1)((a, b), 0), balance((a, b), 0), rtol=1e-6)
    np.testing.assert_allclose(cutoff(0)((a, b), 0), balance((a, b), 0), rtol=1e-6)
    np.testing.assert_allclose(cutoff(1)((a, b), 0), maximum((a, b), 0), rtol=1e-6)
    np.testing.assert_allclose(cutoff(1)((a, a), 0) * a, 0.5)
    for beta in (1e8, 1e10, 1e308):
        for k in (0, 1):
            np.testing.assert_allclose(power(beta)((a, b), k), maximum((a, b), k), rtol=1e-6, atol=1e-9)


# Frozen weights -----------------------------------------------------------------------------------------------------


def estimates(combiner: str, w: float, side: int, p_own: Array, p_other: Array) -> Array:
    """The factor of f in the estimate of a sample, as the estimator makes it."""
    pdf = (p_own, p_other) if side == 0 else (p_other, p_own)
    return combiner_by_name(combiner).weight(np.array([[w], [1 - w]]), pdf, side)


@pytest.mark.parametrize("w", [0.05, 0.3, 0.5, 0.95])
def test_frozen_weights_are_those_of_equal_counts(w: float) -> None:
    """``share p_own`` times the factor is ``p_own / (p_own + p_other)`` at every w, and the two weights sum to 1.

    At w = 1/2 that is balance.
    """
    light, brdf = 10 ** np.random.default_rng(1).uniform(-6, 6, (2, 1000))
    first = w * light * estimates("frozen", w, 0, light, brdf)
    second = (1 - w) * brdf * estimates("frozen", w, 1, brdf, light)
    np.testing.assert_allclose(first, light / (light + brdf))
    np.testing.assert_allclose(first + second, 1)
    if w == 0.5:
        np.testing.assert_allclose(first, w * light * estimates("balance", w, 0, light, brdf))


def planted(combiner: str, w: float, pixels: int, n: int, seed: int) -> Array:
    """Estimates of the integral of x^4 over [0, 1], which is 1/5, from w n samples of 2 x, the others of 2 (1 - x)."""
    rng, total = np.random.default_rng(seed), np.zeros(pixels)
    for side, count in enumerate((round(w * n), n - round(w * n))):
        x = np.sqrt(rng.random((count, pixels)))
        x = x if side == 0 else 1 - x
        pdf = np.stack([2 * x, 2 * (1 - x)])
        total += (x**4 * estimates(combiner, w, side, pdf[side], pdf[1 - side])).sum(axis=0) / n
    return total


def test_neyman_with_frozen_weights() -> None:
    """The variance at ``w = s_l / (s_l + s_b)`` is ``(s_l + s_b)^2 / n``; no other w has less, and equal counts more.

    By hand: ``W f / p = f / (p_l + p_b) = x^4 / 2``, whose variances are ``E[x^8] / 4 - E[x^4]^2 / 4``, with
    ``E[x^k]`` = 2 / (k + 2) under 2 x and 2 / ((k + 1) (k + 2)) under 2 (1 - x).
    """
    s_l, s_b = (np.sqrt((a - b * b) / 4) for a, b in ((1 / 5, 1 / 3), (1 / 45, 1 / 15)))
    assert s_l != pytest.approx(s_b)
    n, best = 100, s_l / (s_l + s_b)
    spread = {w: planted("frozen", w, 40_000, n, 2).var() * n for w in (0.25, 0.5, 0.9, best)}
    for w, found in spread.items():
        w = round(w * n) / n
        assert found == pytest.approx(s_l**2 / w + s_b**2 / (1 - w), rel=0.03)
    assert spread[best] == pytest.approx((s_l + s_b) ** 2, rel=0.03)
    assert spread[best] < 0.9 * spread[0.5]


# Veach's bound ------------------------------------------------------------------------------------------------------

TWO, F = np.array([[0.5, 0.5], [0.9, 0.1]]), np.array([0.1, 0.9])
"""Densities of two techniques, and an integrand whose integral is 1, at two points."""


def variance_of(weights_of: Array) -> Array:
    """Variance of one sample of each technique, whose weights are ``(..., 2, 2)``: techniques, points."""
    values = weights_of * F / TWO
    mean = (values * TWO).sum(axis=-1)
    np.testing.assert_allclose(mean.sum(axis=-1), 1)
    return ((values - mean[..., None]) ** 2 * TWO).sum(axis=(-1, -2))


def test_the_bound_of_balance_is_one_of_non_negative_weights() -> None:
    """Veach: ``V(balance) - V(W) <= (1 / min n_i - 1 / N) I^2``, here 1/2, for weights W that are not negative.

    By hand: the balance heuristic makes f / (p_1 + p_2) = (1/14, 3/2) of a sample of either technique, variances
    (10/7)^2 / 4 and (10/7)^2 * 0.09, together 0.694. W_1 = (10, 10/9) makes 2 of each sample of p_1, W_2 = (-9, -1/9)
    makes -1 of each of p_2: variance 0.
    """
    first, second = (w * TWO[k] * estimates("balance", w, k, *TWO[[k, 1 - k]]) for k, w in enumerate((0.5, 0.5)))
    balanced = variance_of(np.stack([first, second]))
    assert balanced == pytest.approx((10 / 7) ** 2 * 0.34) and round(float(balanced), 3) == 0.694
    w = np.array([10, 10 / 9])
    np.testing.assert_allclose(np.stack([w, 1 - w]) * F / TWO, [[2, 2], [-1, -1]])
    assert variance_of(np.stack([w, 1 - w])) == pytest.approx(0, abs=1e-12)
    assert balanced - 0 > 0.5
    line = np.linspace(0, 1, 401)
    w = np.stack(np.meshgrid(line, line), axis=-1)
    assert balanced - variance_of(np.stack([w, 1 - w], axis=-2)).min() <= 0.5


def test_the_pages_state_the_bound_with_its_condition() -> None:
    """Theory and tutorial: the theorem's condition stands beside it, with the numbers of the test above."""
    docs = Path(__file__).parents[2] / "docs"
    theory, tutorial = (
        " ".join((docs / name).read_text("utf-8").split()) for name in ("theory.md", "tutorials/3_mis.py")
    )
    assert "other *non-negative* weights for the same samples" in theory and "$0.694\\, I^2$" in theory
    assert "Weights below 0 may gain more" in tutorial.replace("# ", "")


@pytest.mark.parametrize("combiner", ["balance", "frozen"])
@pytest.mark.parametrize("w", [0.05, 0.25, 0.7, 0.95])
def test_planted_mean(combiner: str, w: float) -> None:
    """A z-test of 40000 pixels against 1/5."""
    assert abs(z_score(planted(combiner, w, 40_000, 20, 3), 0.2)) < Z_LIMIT


@pytest.mark.parametrize("rule", ["fixed:w=0,combiner=frozen", "fixed:w=1,combiner=frozen", "uniform:combiner=frozen"])
def test_frozen_needs_both_techniques(rule: str) -> None:
    """One technique alone would miss the other's part of f."""
    with pytest.raises(ValueError, match=r"w must be from 0\.05 to 0\.95 with combiner frozen"):
        make_rule(rule)


def test_frozen_renders(box: dmis.Scene) -> None:
    """Learned weights are clipped, and the mean of the image is that of balance, by a z-test over seeds."""
    rule = "second-moment:cost=no,combiner=frozen"
    results = [dmis.render(box, rule, 24, seed=s, parallel=1) for s in range(24)]
    assert max(r.maps["patch"].max() for r in results) == 1
    assert max(r.weight.max() for r in results) == np.float32(0.95)
    balanced = [dmis.render(box, "balance", 96, seed=s, parallel=1).image.mean() for s in range(100, 124)]
    assert abs(z_score([r.image.mean() for r in results], balanced)) < Z_LIMIT


@pytest.mark.parametrize(
    "name, message",
    [
        ("", "combiner must be"),
        ("balanced", "combiner must be"),
        ("balance-2", "combiner must be"),
        ("maximum-1", "combiner must be"),
        ("power-x", "combiner must be"),
        ("power-", "combiner must be"),
        ("power-nan", "combiner must be"),
        ("power-0", "exponent of the power heuristic must be positive"),
        ("power-inf", "exponent of the power heuristic must be positive and finite"),
        ("power--1", "exponent of the power heuristic must be positive"),
        ("cutoff-2", "threshold of the cutoff heuristic must be in"),
    ],
)
def test_unknown_heuristics(name: str, message: str) -> None:
    """Names that are not quite right, and numbers out of range, are errors."""
    with pytest.raises(ValueError, match=message):
        combiner_by_name(name)


def divide(w, shading_samples: int, start: int, count: int, offset: Array, rng=None) -> Counts:
    """Samples `start` to ``start + count`` of all pixels, sample-major; `w` is all shares, or the first of two."""
    pixels = offset.shape[-1]
    pixel, number = np.tile(np.arange(pixels), count), np.repeat(np.arange(start, start + count), pixels)
    shares = w if np.ndim(w) == 2 else pixel_shares(w)
    return allocate(shares, shading_samples, pixel, number, np.atleast_2d(offset), rng)


# Allocation ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("w", [0.0, 0.1, 0.25, 1 / 3, 0.5, 0.77, 1.0])
@pytest.mark.parametrize("shading_samples", [1, 2, 3])
def test_systematic_totals(w: float, shading_samples: int) -> None:
    """Each camera sample gives 0 to S samples to the first technique; a pixel's total is ``n w`` within 1."""
    pixels, spp = 500, 37
    offset = np.random.default_rng(3).random(pixels)
    first = divide(np.full(pixels, w), shading_samples, 0, spp, offset).first.reshape(spp, pixels)
    assert first.min() >= 0 and first.max() <= shading_samples
    n = spp * shading_samples
    assert (np.abs(first.sum(axis=0) - n * w) < 1).all()


def test_half_is_one_each() -> None:
    """At w = 1/2 and S = 2 every camera sample has exactly one sample of each technique."""
    offset = np.random.default_rng(4).random(1000)
    assert divide(0.5, 2, 0, 8, offset).first == 1
    assert (divide(np.full(1000, 0.5), 2, 0, 8, offset).first == 1).all()


@pytest.mark.parametrize("w", [0.1, 0.25, 0.5, 0.9])
def test_slots_have_probability_w(w: float) -> None:
    """Over the offset, every slot goes to the first technique with probability w: what unbiasedness rests on.

    With S = 1 a camera sample is a slot. A binomial count of 20000 against w, for each of 12 slots.
    """
    count = 20000
    offset = np.random.default_rng(5).random(count)
    first = divide(np.full(count, w), 1, 0, 12, offset).first.reshape(12, count)
    z = (first.sum(axis=1) - count * w) / np.sqrt(count * w * (1 - w))
    assert np.abs(z).max() < Z_LIMIT


@pytest.mark.parametrize("w", [0.0, 0.25, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("shading_samples", [1, 2, 4])
def test_a_number_is_the_same_as_a_map(w: float, shading_samples: int) -> None:
    """One share for all pixels gives what a constant map of it gives."""
    offset = np.random.default_rng(6).random(50)
    one = divide(w, shading_samples, 3, 6, offset)
    many = divide(np.full(50, w), shading_samples, 3, 6, offset)
    np.testing.assert_array_equal(np.broadcast_to(one.first, 300), many.first)


def test_blocks_continue() -> None:
    """Samples 0 to 9 in one block, or in blocks of 4 and 6, are divided alike."""
    offset, w = np.random.default_rng(7).random(20), np.random.default_rng(8).random(20)
    whole = divide(w, 2, 0, 10, offset)
    parts = [divide(w, 2, 0, 4, offset), divide(w, 2, 4, 6, offset)]
    np.testing.assert_array_equal(np.concatenate([p.first for p in parts]), whole.first)
    np.testing.assert_array_equal(np.concatenate([p.samples_before for p in parts], axis=1), whole.samples_before)


def test_counts_do_not_depend_on_track_sequence() -> None:
    """Counts are the same whether or not the samples before are counted, too."""
    offset, w = np.random.default_rng(7).random(20), np.random.default_rng(8).random(20)
    pixel, number = np.tile(np.arange(20), 5), np.repeat(np.arange(5), 20)
    shares = pixel_shares(w)
    tracked, plain = (allocate(shares, 3, pixel, number, offset[None], None, track) for track in (True, False))
    assert tracked.samples_before is not None and plain.samples_before is None
    np.testing.assert_array_equal(tracked.first, plain.first)


def test_samples_before_is_a_running_total() -> None:
    """`samples_before` is the running total of each technique, from 0, so that each takes its own sequence in order."""
    offset, w = np.random.default_rng(9).random(20), np.random.default_rng(10).random(20)
    counts = divide(w, 2, 0, 10, offset)
    first = counts.first.reshape(10, 20).astype(int)
    before = np.vstack([np.zeros((1, 20), int), np.cumsum(first, axis=0)[:-1]])
    samples_before = counts.samples_before.reshape(2, 10, 20)
    np.testing.assert_array_equal(samples_before[0], before)
    np.testing.assert_array_equal(samples_before[1], 2 * np.arange(10)[:, None] - before)


@pytest.mark.parametrize("w", [0.0, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("shading_samples", [1, 3])
def test_random_allocation_is_binomial(w: float, shading_samples: int) -> None:
    """The one-sample model: counts are binomial, whatever the neighbours have."""
    from scipy.stats import binom

    rng, count = np.random.default_rng(11), 40000
    first = divide(w, shading_samples, 0, 4, np.zeros(count // 4), rng).first
    if w in (0, 1):
        assert (np.asarray(first) == w * shading_samples).all()
        return
    observed = np.bincount(first, minlength=shading_samples + 1)
    expected = binom.pmf(np.arange(shading_samples + 1), shading_samples, w) * count
    assert chi2_p(observed, expected) > LEVEL


# More than two techniques -------------------------------------------------------------------------------------------

SHARES = [
    (0.5, 0.3, 0.2),
    (1 / 3, 1 / 3, 1 / 3),
    (0.94, 0.03, 0.03),
    (0.0, 0.6, 0.4),
    (0.5, 0.5, 0.0),
    (0.1, 0.2, 0.3, 0.4),
]
each_shares = pytest.mark.parametrize("w", SHARES)


@pytest.mark.parametrize("weight", [0.0, 0.3, 1.0, np.linspace(0, 1, 6).reshape(2, 3)])
def test_shares_of_the_first_of_two(weight: float | Array) -> None:
    """A number or a map w becomes ``(w, 1 - w)``, of sum 1 in float32, too."""
    shares = shares_of(weight)
    assert shares.dtype == np.float32 and shares.shape == (2, *np.shape(weight))
    np.testing.assert_array_equal(shares[0], np.float32(weight))
    np.testing.assert_allclose(shares[1], 1 - np.asarray(weight), atol=1e-7)
    np.testing.assert_array_equal(shares.sum(axis=0), np.ones(np.shape(weight)))


@pytest.mark.parametrize("weight", [(0.3, 0.7), (0.2, 0.3, 0.5), np.full((3, 2, 4), 1 / 3)])
def test_shares_of_all_techniques(weight: tuple[float, ...] | Array) -> None:
    """Shares of all techniques stay what they are, for the image and for each pixel."""
    np.testing.assert_array_equal(shares_of(weight), np.float32(weight))


@each_shares
@pytest.mark.parametrize("shading_samples", [1, 2, 6])
def test_totals_of_several_techniques(w: tuple[float, ...], shading_samples: int) -> None:
    """All samples are divided, none to a share of 0, and a pixel's totals are ``n w_k``, within 1 for the first, and
    within as many as there are roundings for the others; `samples_before` is the running total.
    """
    pixels, spp = 300, 37
    offset = np.random.default_rng(14).random((len(w) - 1, pixels))
    counts = divide(np.repeat(np.array(w)[:, None], pixels, axis=1), shading_samples, 0, spp, offset)
    each = np.array([n.reshape(spp, pixels) for n in counts.per_technique], int)
    each = np.concatenate([each, shading_samples - each.sum(axis=0, keepdims=True)])
    assert each.min() >= 0
    off = np.abs(each.sum(axis=1) - spp * shading_samples * np.array(w)[:, None])
    assert (off[0] < 1).all() and (off < len(w) - 1 + 1e-6).all() and not each[np.array(w) == 0].any()
    before = np.concatenate([np.zeros((len(w), 1, pixels), int), np.cumsum(each, axis=1)[:, :-1]], axis=1)
    np.testing.assert_array_equal(counts.samples_before.reshape(before.shape), before)


@each_shares
@pytest.mark.parametrize("random", [False, True])
def test_slots_have_the_shares_as_probabilities(w: tuple[float, ...], random: bool) -> None:
    """Every slot of 12 goes to technique k with probability w_k."""
    count = 20_000
    rng = np.random.default_rng(15)
    offset = rng.random((len(w) - 1, count))
    counts = divide(np.repeat(np.array(w)[:, None], count, axis=1), 1, 0, 12, offset, rng if random else None)
    for share, each in zip(w, counts.per_technique, strict=False):
        off = each.reshape(12, count).sum(axis=1) - count * share
        assert (np.abs(off) <= Z_LIMIT * np.sqrt(count * share * (1 - share))).all()


def test_whole_shares_are_numbers() -> None:
    """Where all counts are whole, they are the same for all camera samples; in float32, too."""
    thirds = np.full((3, 1), np.float32(1 / 3))
    for n in (3, 6):
        assert divide(thirds, n, 0, 4, np.zeros((2, 5))).per_technique == (n // 3,) * 2
    assert divide(np.array([[0.5], [0.25], [0.25]]), 4, 0, 4, np.zeros((2, 5))).per_technique == (2, 1)
    only_first = np.array([[1.0], [0.0], [0.0]])
    assert divide(only_first, 2, 0, 4, np.zeros((2, 5)), np.random.default_rng(1)).per_technique == (2, 0)


@each_shares
@pytest.mark.parametrize("shading_samples", [2, 3])
def test_covariance_of_rounding(w: tuple[float, ...], shading_samples: int) -> None:
    """`rounding_covariance` is the covariance of the counts of a camera sample, in the middle of its pixel."""
    offset = np.random.default_rng(16).random((len(w) - 1, 100_000))
    counts = divide(np.repeat(np.array(w)[:, None], 100_000, axis=1), shading_samples, 5, 1, offset)
    each = np.array([*counts.per_technique, shading_samples - sum(counts.per_technique)])
    np.testing.assert_allclose(np.cov(each) / shading_samples**2, rounding_covariance(w, shading_samples), atol=2e-3)


def test_rounding_of_two() -> None:
    """With the fractional part p of ``w S``: p (1 - p) / S^2."""
    np.testing.assert_allclose(
        rounding_covariance((0.4, 0.6), 2), 0.8 * 0.2 / 4 * np.array([[1, -1], [-1, 1]]), atol=1e-12
    )
    np.testing.assert_allclose(rounding_covariance((0.5, 0.5), 2), 0, atol=1e-12)


@pytest.mark.parametrize(
    "name, exponent",
    [
        ("balance", 1),
        ("frozen", 1),
        ("power", 2),
        ("power-3", 3),
        ("power-0.5", 0.5),
        ("maximum", None),
        ("cutoff", None),
    ],
)
def test_exponent(name: str, exponent: float | None) -> None:
    """The heuristic with that exponent is the one of that name."""
    assert combiner_by_name(name).exponent == exponent
    if exponent is not None:
        a = [np.array([1.0, 0.2, 5.0]), np.array([1.0, 3.0, 0.5])]
        weight = a[0] * combiner_by_name(name).heuristic(a, 0)
        np.testing.assert_allclose(weight, a[0] ** exponent / (a[0] ** exponent + a[1] ** exponent), rtol=1e-6)


# Combiners ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*HEURISTICS, "optimal"])
@pytest.mark.parametrize("w", [0.05, 0.3, 0.5])
def test_every_combiner_weighs_all_of_f(name: str, w: float) -> None:
    """``sum_k w_k p_k weight_k = 1`` in every direction, so that the estimate is unbiased before any correction."""
    pdf = 10 ** np.random.default_rng(4).uniform(-3, 3, (2, 1000))
    combiner = combiner_by_name(name)
    assert combiner.name == name and combiner is combiner_by_name(name)
    total = sum(
        share * pdf[k] * combiner.weight(np.array([[w], [1 - w]]), pdf, k) for k, share in enumerate((w, 1 - w))
    )
    np.testing.assert_allclose(total, 1, rtol=1e-6)


@pytest.mark.parametrize("name, corrects", [("balance", False), ("frozen", False), ("optimal", True)])
def test_combiners_that_correct_pixels(name: str, corrects: bool) -> None:
    """Only combiners that fit pixels collect records; what they add to pixels without samples is 0."""
    combiner = combiner_by_name(name)
    collector = combiner.collector(pixel_shares(0.5), np.full(4, 2))
    assert (collector is not None) == corrects == combiner.fits_pixels
    if collector is not None:
        np.testing.assert_array_equal(collector.correction(), np.zeros((3, 4)))
