"""Counts of a continuation: powers of two that cost the budget or a little less, in proportion to the density."""

import numpy as np
import pytest

from dmis.base.patches import COLOURS
from dmis.estimator.patterns import PatternMap
from dmis.fit.continuation import Continuation
from dmis.pipeline.budget import LEVELS, MOST_ADAPTIVE, fill_budget, whole_samples

FIRST = 8
COST = np.array([3.0, 1.5])
"""Cost of a camera sample with the first round's pattern, and with another one."""


def plan(density: np.ndarray, spp: float, pattern: np.ndarray | None = None) -> Continuation:
    """Return a plan of `spp` samples of cost 2, whose pixels of pattern 1 begin their sequences anew."""
    pattern = np.zeros(density.shape, np.uint8) if pattern is None else pattern
    begin = np.where(pattern == 0, FIRST, 0).astype(np.int32)
    patterns = PatternMap(((2, 2), (1, 1)), pattern, begin, (2, 2))
    return Continuation(patterns, density, COST[pattern], np.full(pattern.shape, COST[0] * FIRST), 2.0 * spp)


def spent(plan: Continuation, samples: np.ndarray) -> np.ndarray:
    """Return the cost of each pixel, a first round that is not in the image included."""
    return samples * plan.cost + plan.spent * (plan.patterns.begin == 0)


def densities(shape: tuple[int, int]) -> dict[str, np.ndarray]:
    """Return planted densities of an image by name."""
    rng = np.random.default_rng(1)
    one, black = np.zeros(shape), np.zeros(shape)
    one[shape[0] // 2, shape[1] // 2] = 1e30
    half = np.ones(shape)
    half[: shape[0] // 2] = 0
    return {
        "constant": np.full(shape, 1e-20),
        "one pixel": one,
        "black": black,
        "half": half,
        "lognormal": np.exp(rng.normal(0, 1.5, shape)),
        "wide": np.exp(rng.normal(0, 4, shape)),
    }


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2, 3), (3, 2), (32, 32), (40, 50)])
@pytest.mark.parametrize("spp", [32, 128, 4096, 10**9])
@pytest.mark.parametrize("name", densities((2, 2)))
@pytest.mark.parametrize("anew", [0, 0.4, 1])
def test_counts_are_powers_of_two_within_the_budget_of_each_colour(shape, spp, name, anew):
    """With pixels that go on, pixels that begin anew, and both."""
    rng = np.random.default_rng(2)
    p = plan(densities(shape)[name], spp, (rng.random(shape) < anew).astype(np.uint8))
    samples = fill_budget(p, FIRST, rng)
    assert samples.dtype == np.int32 and samples.shape == shape
    assert (samples & (samples - 1) == 0).all() and (samples <= MOST_ADAPTIVE).all()
    assert (samples >= np.where(p.patterns.begin > 0, FIRST, 1)).all()
    for colour in COLOURS:
        assert spent(p, samples)[colour].sum() <= p.budget * samples[colour].size


@pytest.mark.parametrize("shape", [(32, 32), (80, 64)])
@pytest.mark.parametrize("spp", [32, 128, 4096])
@pytest.mark.parametrize("name", ["constant", "half", "lognormal", "wide"])
@pytest.mark.parametrize("anew", [0, 0.4, 1])
def test_budget_is_used_to_two_percent_from_a_thousand_pixels_on(shape, spp, name, anew):
    """All pixels together; where one pixel has nearly all the power, its count decides how much is left over."""
    rng = np.random.default_rng(3)
    p = plan(densities(shape)[name], spp, (rng.random(shape) < anew).astype(np.uint8))
    samples = fill_budget(p, FIRST, rng)
    assert spent(p, samples).sum() / (p.budget * samples.size) > 0.98


def test_counts_are_in_proportion_to_the_density_on_average():
    """Random rounding between powers of two, of pixels far from the least count."""
    density = np.tile(np.geomspace(64, 300, 40), (40, 1))
    p = plan(density, 400)
    rng = np.random.default_rng(4)
    mean = np.mean([fill_budget(p, FIRST, rng) for _ in range(100)], axis=0).mean(axis=0)
    for columns in (slice(0, None, 2), slice(1, None, 2)):  # each colour has its part of the budget
        ratio = (mean / density[0])[columns]
        np.testing.assert_allclose(ratio / ratio.mean(), 1, atol=0.03)


def test_counts_of_a_colour_depend_on_its_own_densities_alone():
    """A pixel's samples are in the densities of the other colours."""
    density = densities((32, 32))["lognormal"]
    for colour in COLOURS:
        other = density * 100
        other[colour] = density[colour]
        a, b = (fill_budget(plan(d, 128), FIRST, np.random.default_rng(5)) for d in (density, other))
        np.testing.assert_array_equal(a[colour], b[colour])


@pytest.mark.parametrize("spp", [2, 7, 122, 1000])
@pytest.mark.parametrize("spread", [0.0, 1.0, 3.0])
def test_whole_samples_keep_the_budget(spp: int, spread: float) -> None:
    """Levels only, at least two, and their mean is the budget."""
    share = np.exp(np.random.default_rng(1).normal(0, spread, (60, 80)))
    n = whole_samples(share, spp, np.random.default_rng(2))
    assert np.isin(n, LEVELS).all() and n.min() >= 2
    assert n.mean() == pytest.approx(spp, rel=0.01)


def test_whole_samples_keep_the_expectation() -> None:
    """Over many offsets each pixel has what it should have on average."""
    share = np.array([[1.0, 2.0, 3.0, 5.5, 0.2]])
    mean = np.mean([whole_samples(share, 50, np.random.default_rng(s)) for s in range(1000)], axis=0)
    np.testing.assert_allclose(mean, share * (50 / share.mean()), rtol=0.02)


def test_more_samples_than_levels() -> None:
    """In place of fewer than were asked for."""
    with pytest.raises(ValueError, match="camera samples must be at most 65536 per pixel"):
        whole_samples(np.ones((2, 2)), 70_000, np.random.default_rng(2))


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_bad_shares(bad: float) -> None:
    """Every pixel needs samples."""
    share = np.ones((4, 4))
    share[1, 1] = bad
    with pytest.raises(ValueError, match="samples of a fit must be positive and finite"):
        whole_samples(share, 8, np.random.default_rng(1))
