"""Numbers of camera samples: powers of two that cost the budget or a little less, in proportion to the density."""

from itertools import product

import numpy as np
import pytest

from dmis.base.vectors import Array
from dmis.fit.best_pattern import light_halvings
from dmis.fit.round import LEVELS, whole_samples
from dmis.fit.sample_density import MOST_ADAPTIVE, powers_of_two

FIRST = 8
"""Least number of pixels that do not begin anew; those that do have cost 1.5 in place of 3."""


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


@pytest.mark.parametrize("name", densities((2, 2)))
def test_numbers_are_powers_of_two_that_use_the_budget(name: str) -> None:
    """To 2 % from some hundred pixels on, unless one pixel has nearly all the power: its number decides what is left.

    With pixels that go on, pixels that begin anew, and both.
    """
    shapes, budgets = ((1, 1), (1, 7), (2, 3), (3, 2), (16, 16), (40, 50)), (32, 128, 4096, 10**9)
    for shape, spp, anew in product(shapes, budgets, (0, 0.4, 1)):
        rng = np.random.default_rng(2)
        begins = rng.random(shape) < anew
        cost, least = np.where(begins, 1.5, 3.0), np.where(begins, 2, FIRST)
        budget = 2.0 * spp * cost.size
        samples = powers_of_two(densities(shape)[name], cost, least, budget, rng.random(shape))
        assert samples.dtype == np.int32 and samples.shape == shape
        assert (samples & (samples - 1) == 0).all() and (samples <= MOST_ADAPTIVE).all()
        assert (samples >= least).all()
        used = (samples * cost).sum() / budget
        assert used <= 1
        if samples.size > 200 and spp < 10**9 and name not in ("one pixel", "black"):
            assert used > 0.98, (shape, spp, anew)


def test_numbers_are_in_proportion_to_the_density_on_average() -> None:
    """Random rounding between powers of two, of pixels far from the least number."""
    density = np.tile(np.geomspace(64, 300, 40), (40, 1))
    rng, ones = np.random.default_rng(4), np.ones((40, 40))
    numbers = [powers_of_two(density, 3 * ones, FIRST * ones, 800 * 1600, rng.random((40, 40))) for _ in range(100)]
    ratio = np.mean(numbers, axis=(0, 1)) / density[0]
    np.testing.assert_allclose(ratio / ratio.mean(), 1, atol=0.03)
    # Over many offsets each pixel has what it should have on average
    share = np.array([[1.0, 2.0, 3.0, 5.5, 0.2]])
    mean = np.mean([whole_samples(share, 50, np.random.default_rng(s)) for s in range(1000)], axis=0)
    np.testing.assert_allclose(mean, share * (50 / share.mean()), rtol=0.02)
    with pytest.raises(ValueError, match="camera samples must be at most 65536 per pixel"):
        whole_samples(np.ones((2, 2)), 70_000, np.random.default_rng(1))
    # lights without variance or cost
    zero = np.zeros((3, 2))
    halvings, of_variance, of_cost = light_halvings(zero, np.ones((3, 2)), np.ones(2), 1.4)
    assert (halvings == 3).all() and np.isfinite(of_variance).all() and (of_cost == (1 + 3 / 8) / 4).all()
    assert light_halvings(zero[1:], np.ones((2, 2)), np.ones(2), 1.4)[0].tolist() == [[0, 0], [3, 3]]  # the only lamp
    halvings, of_variance, of_cost = light_halvings(np.ones((3, 2)), zero, np.ones(2), 1.4)
    assert not halvings.any() and (of_variance == 1).all() and (of_cost == 1).all()


@pytest.mark.parametrize("spp", [2, 7, 122, 1000])
def test_whole_samples_keep_the_budget(spp: int) -> None:
    """Levels only, at least two, and their mean is the budget."""
    for spread in (0.0, 1.0, 3.0):
        share = np.exp(np.random.default_rng(1).normal(0, spread, (60, 80)))
        n = whole_samples(share, spp, np.random.default_rng(2))
        assert np.isin(n, LEVELS).all() and n.min() >= 2
        assert n.mean() == pytest.approx(spp, rel=0.01)


@pytest.mark.parametrize("exponent", [1.0, 1.4])
def test_light_halvings_are_near_the_best(exponent: float) -> None:
    """Against all combinations of three lights' parts, for random variances and costs."""
    rng = np.random.default_rng(0)
    variance, cost, camera = rng.lognormal(0, 3, (3, 200)), rng.lognormal(0, 0.5, (3, 200)), rng.lognormal(0, 0.5, 200)
    halvings, of_variance, of_cost = light_halvings(variance, cost, camera, exponent)

    def error(part: Array) -> Array:
        parts = part.reshape(3, -1)
        return (variance * parts**-exponent).sum(axis=0) * (camera + (cost * parts).sum(axis=0)) ** exponent

    best = np.min([error(2.0 ** -np.array(parts)) for parts in product(range(4), repeat=3)], axis=0)
    found, without = error(2.0 ** -halvings.astype(float)), error(np.ones(3))
    np.testing.assert_allclose(of_variance * of_cost**exponent, found / without)
    assert (found / best).max() < 1.25 and np.median(found / best) < 1.03 and (found / without).max() < 1.1
