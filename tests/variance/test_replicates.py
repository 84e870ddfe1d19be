"""Mean of replicates, its estimated variance, and the seeds of their random numbers."""

import numpy as np
import pytest

from dmis.base.vectors import Array
from dmis.variance.moments import Film
from dmis.variance.replicates import mean_of_replicates, replicate_seed


def films(number: int, n: int | Array, rng: np.random.Generator, shape: tuple[int, int] = (5, 4)) -> list[Film]:
    """Return films of `number` replicates with random means and roots."""
    return [Film(n, *rng.random((2, *shape, 3)).astype(np.float32)) for _ in range(number)]


def variance_of_mean(film: Film) -> Array:
    """Return the estimated variance of the means of a film."""
    return np.asarray(film.m2 / ((film.n - 1) * film.n))


def test_one_film_stays() -> None:
    film = films(1, 8, np.random.default_rng(1))[0]
    assert mean_of_replicates([film], exact=True) is film


@pytest.mark.parametrize("number", [2, 4])
@pytest.mark.parametrize("uneven", [False, True])
def test_planted_films(number: int, uneven: bool) -> None:
    """The mean, all samples, and the variance from the spread or from the films."""
    rng = np.random.default_rng(2)
    n = rng.integers(2, 9, (5, 4, 1)) if uneven else 8
    parts = films(number, n, rng)
    means = np.array([film.mean for film in parts], np.float64)
    exact, pooled = (mean_of_replicates(parts, exact) for exact in (True, False))
    for film in (exact, pooled):
        np.testing.assert_array_equal(film.n, number * np.asarray(n))
        np.testing.assert_allclose(film.mean, means.mean(axis=0), rtol=1e-6)
    spread = ((means - means.mean(axis=0)) ** 2).sum(axis=0) / (number * (number - 1))
    np.testing.assert_allclose(variance_of_mean(exact), spread, rtol=1e-5)
    expected = sum(variance_of_mean(film) for film in parts) / number**2
    np.testing.assert_allclose(variance_of_mean(pooled), expected, rtol=1e-5)


def test_unbiased() -> None:
    """Over many pixels, of normal means of variance 1, the estimated variance of their mean is 1 / R."""
    rng = np.random.default_rng(3)
    for number in (2, 4):
        normal = [Film(8, rng.normal(size=(200, 100, 3)).astype(np.float32), np.ones(1)) for _ in range(number)]
        estimated = variance_of_mean(mean_of_replicates(normal, exact=True)).mean()
        assert estimated == pytest.approx(1 / number, rel=5 * np.sqrt(2 / (number - 1) / 60_000))


def test_seeds() -> None:
    """The first is that of the image; all others differ, between images too."""
    seeds = [0, 1, 2, 2**32, 2**70]
    assert [replicate_seed(seed, 0) for seed in seeds] == seeds
    assert len({replicate_seed(seed, r) for seed in seeds for r in range(4)}) == 4 * len(seeds)
