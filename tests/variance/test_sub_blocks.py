"""Sub-blocks: the variance that they estimate, in any order of blocks and for any numbers of samples."""

import itertools

import numpy as np
import pytest

from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.sobol import Sobol
from dmis.variance.moments import SubBlocks


def of_samples(values: np.ndarray, n: np.ndarray | int, cuts: tuple[int, ...] = ()) -> SubBlocks:
    """Return the sub-blocks of `values` ``(most, P)`` for all channels, added in parts that end at `cuts`."""
    pixels = values.shape[1]
    blocks = SubBlocks(n, pixels)
    numbers = np.broadcast_to(n, pixels)
    edges = [0, *cuts, *sorted(set(numbers.tolist()))]
    edges = sorted({e for e in edges if e <= numbers.max()})
    for begin, end in itertools.pairwise(edges):
        active = np.flatnonzero(numbers >= end)
        blocks.add(np.repeat(values[begin:end, None, active], 3, axis=1), active, begin)
    return blocks


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 22, 64])
def test_variance_of_independent_samples_is_unbiased(n: int) -> None:
    values = np.random.default_rng(n).normal(2, 3, (n, 40_000)).astype(np.float32)
    total = of_samples(values, n).total()
    np.testing.assert_allclose(total.mean[1], values.mean(axis=0), rtol=1e-5, atol=1e-5)
    assert total.n == n
    if n == 1:
        assert not total.m2.any()
    else:
        # the variance of the mean is 9 / n, and its estimate from B blocks has the relative deviation sqrt(2 / (B - 1))
        mean = (total.m2[0] / (n - 1) / n).mean()
        assert mean == pytest.approx(9 / n, rel=5 * np.sqrt(2 / (min(n, 4) - 1) / 40_000) + 0.02 * (n % 4 > 0))


def test_parts_and_different_numbers_change_nothing() -> None:
    values = np.random.default_rng(5).random((16, 7)).astype(np.float32)
    n = np.array([2, 4, 4, 8, 16, 16, 16])
    whole = of_samples(values, n).total()
    parts = of_samples(values, n, (1, 3, 5, 11)).total()
    np.testing.assert_allclose(parts.mean, whole.mean, rtol=1e-12)
    np.testing.assert_allclose(parts.m2, whole.m2, rtol=1e-9)
    for pixel, k in enumerate(n):
        alone = of_samples(values[:k, pixel : pixel + 1], int(k)).total()
        np.testing.assert_allclose(alone.m2[:, 0], whole.m2[:, pixel], rtol=1e-9)


def test_pixels_without_samples_are_zero() -> None:
    total = of_samples(np.ones((4, 2), np.float32), np.array([0, 4])).total()
    np.testing.assert_array_equal(total.mean[0], [0, 1])
    assert not total.m2.any()


@pytest.mark.parametrize("n", [16, 64, 256])
def test_error_of_sobol_points_is_overestimated_by_about_two(n: int) -> None:
    """The mean of a smooth function with an edge over many shifts: estimate of its variance over the true one."""
    pixels = 4000
    sampler = Sobol(PixelBlock(np.random.default_rng(1), 1, np.arange(pixels), [n], 2))
    sampler.start(np.tile(np.arange(pixels), n), np.repeat(np.arange(n), pixels))
    x, y = sampler.draw("camera", None).reshape(2, n, pixels)
    values = np.where(x + 0.5 * y < 0.7, 1 + x, 0.2).astype(np.float32)
    total = of_samples(values, n).total()
    estimated = (total.m2[0] / (n - 1) / n).mean()
    true = total.mean[0].var()
    assert 1 < estimated / true < 5
