"""Oracle: closed forms on planted curves, agreement with renders, and its cache."""

import numpy as np
import pytest

import dmis
from dmis.base.patches import patch_spread
from dmis.base.vectors import Array
from dmis.estimator.settings import DEFAULTS
from dmis.experiment.metrics import ratio
from dmis.experiment.oracle import Oracle
from dmis.experiment.oracle_renders import curve_settings, make_oracle
from dmis.testing.scenes import box_scene
from dmis.variance.curves import GRID, HALF

BEST = GRID[[0, 3, 6, 9, 12, 4]].reshape(2, 3)


@pytest.fixture
def oracle() -> Oracle:
    """Patches of 4 pixels with parabolas about `BEST`, and a black one in place of the last."""
    variance = (GRID[:, None, None] - BEST).astype(float) ** 2 + 0.1
    variance[:, 1, 2] = 0
    return Oracle(variance, np.linspace(1, 2, len(GRID)), 4, 100)


def pixels(weight: Array, shape: tuple[int, int] = (8, 12)) -> Array:
    return patch_spread(weight, 4, shape)


def test_best_weights_and_harm(oracle: Oracle) -> None:
    """The best weight is the minimum of each patch, and a cheaper one if cost counts."""
    best = oracle.best()
    np.testing.assert_array_equal(best.ravel()[:5], BEST.ravel()[:5])
    cheap = GRID[oracle.best_index(costly=True)]
    assert (cheap <= best).all() and (cheap < best).any()
    # the variance of a map is exact on the grid and linear between; one number is a constant map
    np.testing.assert_allclose(oracle.at(pixels(BEST)).ravel()[:5], 0.1)
    np.testing.assert_allclose(oracle.at(0.5), oracle.variance[HALF])
    low, high = GRID[HALF], GRID[HALF + 1]
    expected = 0.75 * oracle.variance[HALF] + 0.25 * oracle.variance[HALF + 1]
    np.testing.assert_allclose(oracle.at(float(low + 0.25 * (high - low))), expected, rtol=1e-6)
    # the best weights harm nowhere, nor does 1/2; the wrong end harms
    best, half, wrong = pixels(oracle.best()), np.full((8, 12), 0.5), pixels(np.where(oracle.best() < 0.5, 1.0, 0.0))
    assert oracle.harm(best) == (0, 0) and oracle.harm(half) == (0, 0) and oracle.harm(wrong)[0] == 1
    one = np.where(np.arange(96).reshape(8, 12) < 48, np.where(np.arange(12) < 4, wrong, best), best)
    assert oracle.harm(one) == pytest.approx((0.2, np.sqrt(0.2 * 0.8 / 5)))  # one of five


def test_rendered_once(box: dmis.Scene, tmp_path, monkeypatch) -> None:
    """The second call reads the oracle from disk; its best weights have the least variance."""
    first = make_oracle(box, 64, folder=tmp_path)
    monkeypatch.setattr("dmis.experiment.oracle_renders.render_halves", None)
    again = make_oracle(box, 64, folder=tmp_path)
    np.testing.assert_allclose(first.variance, again.variance, rtol=1e-6)
    assert first.variance.shape == (len(GRID), 6, 8) and (np.diff(first.cost) > 0).all()
    least = first.at(pixels(first.best(), (24, 32)))
    assert first.mean(least) / first.mean(first.at(0.5)) == pytest.approx(first.limit())


def test_oracle_agrees_with_renders(box: dmis.Scene, tmp_path) -> None:
    """The saving of the best weights in rendered images, over 64 seeds, agrees with the oracle."""
    oracle = make_oracle(box, 512, folder=tmp_path)

    def measured(rule: dmis.Rule | str) -> Array:
        """Variance of a pixel, from 16 seeds each."""
        results = [dmis.render(box, rule, 32, seed=s, sampler="independent") for s in range(64)]
        images = np.reshape([result.image.mean(axis=2) for result in results], (4, 16, 24, 32))
        return images.var(axis=1, ddof=1).mean(axis=(1, 2))

    expected = oracle.variance.min(axis=0).sum() / oracle.variance[HALF].sum()
    value, _ = ratio(measured(dmis.Given(pixels(oracle.best(), (24, 32)))), measured("balance"))
    assert value == pytest.approx(expected, rel=0.05)


def test_oracle_of_another_combiner(box: dmis.Scene, tmp_path) -> None:
    """Heuristics agree where one technique is alone, and have curves of their own."""
    balance, power = (make_oracle(box, 64, combiner=name, folder=tmp_path) for name in ("balance", "power"))
    np.testing.assert_allclose(power.variance[[0, -1]], balance.variance[[0, -1]], rtol=1e-4, atol=1e-9)
    assert not np.allclose(power.variance[HALF], balance.variance[HALF], rtol=0.01)
    # under a sky the default, unless one is given, and be it 0
    sky = box_scene(lights=(dmis.EnvironmentLight(np.ones((1, 1, 3))),))
    settings = [curve_settings(sky, dmis.Settings(compensation=given)) for given in (None, 0.0, 0.5)]
    assert [found.compensation for found in settings] == [DEFAULTS["compensation"], 0.0, 0.5]


def test_patches_at_the_border_count_by_their_pixels() -> None:
    """An image of 4 by 5 pixels, one patch of 16 and one of 4, of which one gains by the best weight."""
    for patch, truth in ((0, (16 * 0.2 + 4) / 20), (1, (16 + 4 * 0.2) / 20)):
        variance = np.ones((len(GRID), 1, 2))
        variance[0, 0, patch] = 0.2
        oracle = Oracle(variance, np.ones(len(GRID)), 4, 64, (4, 5))
        assert oracle.limit() == pytest.approx(truth) and oracle.limit(costly=True) == pytest.approx(truth)
        assert oracle.limit_with_counts() == pytest.approx((((16, 4)[patch] * 0.2**0.5 + (4, 16)[patch]) / 20) ** 2)
    # no variance at all, or the same at every weight: no saving to speak of, nothing left over, no division by 0
    for value in (0.0, 2.0):
        oracle = Oracle(np.full((len(GRID), 2, 3), value), np.ones(len(GRID)), 4, 100)
        limits = oracle.limit(), oracle.limit(costly=True), oracle.limit_with_counts()
        assert limits == pytest.approx((1, 1, 1))
        assert oracle.harm(np.full((8, 12), 0.3)) == (0, 0)


def test_numbers_of_samples() -> None:
    """Half of the patches dark: all samples in the other half give half of the variance; evenly lit, nothing. A weight
    that has a quarter of the variance and costs twice as much leaves half of that.
    """
    variance, cost = np.ones((len(GRID), 2, 2)), np.ones(len(GRID))
    oracle = Oracle(variance, cost, 4, 1)
    assert oracle.limit_with_counts() == pytest.approx(1)
    variance[:, 0] = 0
    assert Oracle(variance, cost, 4, 1).limit_with_counts() == pytest.approx(0.5)
    variance[2], cost[2] = variance[2] / 4, 2
    oracle = Oracle(variance, cost, 4, 1)
    assert oracle.limit_with_counts() == pytest.approx(0.25)
