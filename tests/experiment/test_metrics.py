"""Error measures: closed forms, and references of two halves, whose noise cancels."""

import numpy as np
import pytest
import scipy.stats
from agreement import block_error

from dmis.experiment.metrics import (
    holm_levels,
    log_ratio,
    mean_and_error,
    mean_over_blocks,
    mse,
    ratio,
    ratio_over_blocks,
    relmse,
    share_of_few,
    squared_error,
)


def test_closed_forms():
    """All measures have their closed forms for an offset of 0.1 from a constant reference of 0.5."""
    image, reference = np.full((4, 4, 3), 0.6), np.full((4, 4, 3), 0.5)
    assert mse(image, reference) == pytest.approx(0.01) and squared_error(image, reference).shape == (4, 4)
    assert relmse(image, reference) == pytest.approx(0.01 / 0.26)
    assert block_error(image, reference, 2) == pytest.approx(0.2)
    # halves of .3 and .7: (.6 - .3) (.6 - .7) / (.5^2 + .01)
    halves = reference - 0.2, reference + 0.2
    assert (mse(image, *halves), relmse(image, *halves)) == pytest.approx((-0.03, -0.03 / 0.26))
    assert mean_and_error([1, 2, 6]) == pytest.approx((3, np.sqrt(7 / 3)))
    # a reference of another size is refused, not broadcast
    with pytest.raises(ValueError, match="same shape"):
        mse(np.zeros((4, 4, 3)), np.zeros((4, 3)))
    # of 9x9 pixels one block of 8x8 counts; the last row and column do not
    image, reference = np.ones((9, 9, 3)), np.ones((9, 9, 3))
    image[8], image[:, 8] = 5, 5
    assert block_error(image, reference) == 0


def test_share_of_the_sum_in_few_pixels():
    """Planted: one pixel of 100 has 60 of 159, two of 150 the two largest; of normal errors the worst 1 % have 8 %."""
    errors = np.ones((10, 10))
    errors[3, 4] = 60
    assert share_of_few(errors) == pytest.approx(60 / 159)
    assert share_of_few(np.arange(1, 151).reshape(10, 15)) == pytest.approx(299 / 11325)
    normal = np.random.default_rng(1).standard_normal((400, 400)) ** 2
    assert share_of_few(normal) == pytest.approx(0.0845, abs=0.003)
    assert np.isnan(share_of_few(np.zeros((3, 3))))


def test_two_halves_are_free_of_the_references_noise():
    """With two noisy halves the estimate is unbiased; with their mean alone it is too large."""
    rng = np.random.default_rng(5)
    shape = (200, 200, 3)
    image, first, second = (1 + s * rng.standard_normal(shape) for s in (0.1, 0.2, 0.2))
    error = (image - first) * (image - second)
    assert abs(error.mean() - 0.01) < 4 * error.std() / np.sqrt(error.size)
    assert mse(image, first, second) == pytest.approx(error.mean())
    assert mse(image, (first + second) / 2) > 0.02


def test_ratio_of_equal_and_proportional_values():
    """The error of proportional values is 0; that of a single seed is NaN."""
    baseline = np.array([1.0, 2.0, 4.0])
    assert ratio(0.5 * baseline, baseline) == pytest.approx((0.5, 0), abs=1e-12)
    error = log_ratio(baseline, baseline[::-1])[1]
    assert ratio(baseline, baseline[::-1])[1] == pytest.approx(4.30265 * error)  # of Student's t with two degrees
    assert ratio(baseline[:1], baseline[:1])[0] == 1 and np.isnan(ratio(baseline[:1], baseline[:1])[1])
    # two pairs: leaving out one leaves ln(1/4) or ln(3/2), so the jackknife's error is half of their difference.
    # ln(mean(1, 3) / mean(4, 2)) = ln(2/3); thetas are ln(3/2) and ln(1/4), (K - 1) var = (ln 6 / 2)^2 for K = 2
    value, error = log_ratio(np.array([1.0, 3.0]), np.array([4.0, 2.0]))
    assert (value, error) == pytest.approx((np.log(2 / 3), np.log(6) / 2))
    turned = log_ratio(np.array([4.0, 2.0]), np.array([1.0, 3.0]))
    assert turned == pytest.approx((-value, error))
    assert np.isnan(log_ratio(np.array([1.0]), np.array([2.0]))[1])
    assert np.isnan(log_ratio(np.array([3.0, -1.0]), np.array([1.0, 1.0]))).all()  # the mean without the first is -1


@pytest.mark.parametrize("together, shape", [(1, (160, 160)), (4, (171, 228)), (8, (104, 103))])
def test_error_of_pixels_that_go_together(shape, together):
    """The standard error of the mean is right for errors that patches share, and 0 for a constant."""
    rng = np.random.default_rng(3)
    found, ratios = [], []
    for _ in range(150):
        values = rng.exponential(size=(2, 240 // together, 240 // together))
        one, two = np.kron(values, np.ones((1, together, together)))[:, : shape[0], : shape[1]]
        found.append(mean_over_blocks(one))
        ratios.append(ratio_over_blocks(one + two, 2 * two))
    for (means, errors), factor in ((np.array(found).T, 1), (np.array(ratios).T, 1.96)):
        assert factor * means.std() / errors.mean() == pytest.approx(1, abs=0.2)
    assert mean_over_blocks(np.full(shape, 3.0)) == (3, 0)
    assert ratio_over_blocks(2 * one, one) == pytest.approx((2, 0))
    assert mean_over_blocks(np.arange(6.0).reshape(2, 3))[0] == 2.5


@pytest.mark.parametrize("sigma, seeds", [(0.1, 3), (1.0, 5)])
def test_log_ratio_of_equal_rules(sigma, seeds):
    """Of 4000 experiments with two equal rules at most 5 % of intervals lie below 0, half of that for light tails.

    Student's two-sided 95 % interval lies below 0 in 2.5 % if the logarithm of the ratio of means is normal, with a
    standard error over 4000 experiments of 0.25 %; `log_ratio` says up to 4 % for heavy tails.
    """
    rng = np.random.default_rng(7)
    pairs = np.exp(sigma * rng.standard_normal((4000, 2, seeds)))
    logs = np.array([log_ratio(*pair) for pair in pairs])
    below = (logs @ [1, scipy.stats.t.ppf(0.975, seeds - 1)] < 0).mean()
    assert below < (0.035 if sigma < 0.2 else 0.05)


def test_holm_levels_by_hand():
    """Sorted, three p are compared with 0.05 / 3, 0.05 / 2, 0.05, up to the first that is larger."""
    # 0.01 <= 0.0167 is rejected, 0.03 > 0.025 is not, and so 0.04 is not, though it is below 0.05
    np.testing.assert_allclose(holm_levels(np.array([0.04, 0.01, 0.03])), [0.025, 0.05 / 3, 0.025])
    np.testing.assert_allclose(holm_levels(np.array([0.04, 0.01, 0.02])), [0.05, 0.05 / 3, 0.025])  # all are
    np.testing.assert_allclose(holm_levels(np.array([0.3, 0.2])), [0.025, 0.025])  # none is
    assert holm_levels(np.array([])).shape == (0,)
