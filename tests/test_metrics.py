"""Error measures: closed forms, and that two reference halves cancel the reference's noise."""

import numpy as np
import pytest

from dmis.metrics import block_error, mean_and_error, mean_over_blocks, mse, ratio, ratio_over_blocks, relmse


def test_closed_forms():
    """A constant offset of 0.1 from a constant reference of 0.5."""
    image, reference = np.full((4, 4, 3), 0.6), np.full((4, 4, 3), 0.5)
    assert mse(image, reference) == pytest.approx(0.01)
    assert relmse(image, reference) == pytest.approx(0.01 / 0.26)
    assert block_error(image, reference, 2) == pytest.approx(0.2)


def test_two_halves_are_free_of_the_references_noise():
    """With noisy halves the estimate is the image's own error; with their mean alone it is too large."""
    rng = np.random.default_rng(5)
    shape = (200, 200, 3)
    image, first, second = (1 + s * rng.standard_normal(shape) for s in (0.1, 0.2, 0.2))
    error = (image - first) * (image - second)
    assert abs(error.mean() - 0.01) < 4 * error.std() / np.sqrt(error.size)
    assert mse(image, first, second) == pytest.approx(error.mean())
    assert mse(image, (first + second) / 2) > 0.02


def test_shapes_must_agree():
    """A reference of another size is told, not broadcast."""
    with pytest.raises(ValueError, match="same shape"):
        mse(np.zeros((4, 4, 3)), np.zeros((4, 3)))


def test_ragged_borders_are_left_out_of_blocks():
    """9x9 pixels hold one block of 8: the last row and column do not count."""
    image, reference = np.ones((9, 9, 3)), np.ones((9, 9, 3))
    image[8], image[:, 8] = 5, 5
    assert block_error(image, reference) == 0


def test_mean_and_error():
    """By hand, and one value has no error."""
    assert mean_and_error(np.array([1.0, 2.0, 3.0])) == pytest.approx((2, 1 / np.sqrt(3)))
    mean, error = mean_and_error(np.array([4.0]))
    assert mean == 4 and np.isnan(error)


def test_ratio_of_equal_and_proportional_values():
    """What is proportional seed by seed has no error; a single seed has none that is known."""
    baseline = np.array([1.0, 2.0, 4.0])
    assert ratio(0.5 * baseline, baseline) == pytest.approx((0.5, 0), abs=1e-12)
    assert ratio(baseline[:1], baseline[:1])[0] == 1 and np.isnan(ratio(baseline[:1], baseline[:1])[1])
    with pytest.raises(ValueError, match="one number for each seed"):
        ratio(baseline, baseline[:2])


@pytest.mark.parametrize("seeds", [3, 5, 20])
def test_ratio_interval_covers(seeds):
    """The 95 % interval holds the true ratio in 95 % of 4,000 experiments, correlated or not (3 sigma: 1 %)."""
    rng = np.random.default_rng(seeds)
    common = rng.normal(0, 0.02, (4000, seeds))
    baseline = 1 + common + rng.normal(0, 0.03, common.shape)
    values = 0.8 + common + rng.normal(0, 0.03, common.shape)
    covered = [abs(r - 0.8) < half for r, half in map(ratio, values, baseline)]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.011)


@pytest.mark.parametrize("together", [1, 4, 8])
@pytest.mark.parametrize("shape", [(160, 160), (171, 228), (104, 103)])
def test_error_of_pixels_that_go_together(shape, together):
    """Where patches share their error, the mean over pixels is as unsure as it is over images; a constant is sure."""
    rng = np.random.default_rng(3)
    found, ratios = [], []
    for _ in range(150):
        one, two = (
            np.kron(rng.exponential(size=(30 * 8 // together,) * 2), np.ones((together,) * 2)) for _ in range(2)
        )
        one, two = (v[: shape[0], : shape[1]] for v in (one, two))
        found.append(mean_over_blocks(one))
        ratios.append(ratio_over_blocks(one + two, 2 * two))
    for (means, errors), factor in ((np.array(found).T, 1), (np.array(ratios).T, 1.96)):
        assert factor * means.std() / errors.mean() == pytest.approx(1, abs=0.2)
    assert mean_over_blocks(np.full(shape, 3.0)) == (3, 0)
    assert ratio_over_blocks(2 * one, one) == pytest.approx((2, 0))
    assert mean_over_blocks(np.arange(6.0).reshape(2, 3))[0] == 2.5
