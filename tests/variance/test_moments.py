"""Moments and sub-blocks: closed forms, merging, unbiasedness, in any order and for any numbers of samples."""

import itertools
from dataclasses import replace
from functools import reduce

import numpy as np
import pytest

from dmis.base.vectors import Array
from dmis.estimator.allocation import SampleBlock
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.sobol import Sobol
from dmis.variance.moments import Film, Moments, PixelMoments, SubBlocks, join_films


def samples(n: int, seed: int = 1, dtype: type = np.float64) -> Array:
    return np.random.default_rng(seed).gamma(0.5, size=(n, 4, 5, 3)).astype(dtype)


@pytest.mark.parametrize("n", [1, 2, 7, 100])
def test_moments_agree_with_numpy(n: int) -> None:
    """Mean and unbiased variance agree with NumPy's, to the float32 rounding of 1/n."""
    x = samples(n)
    moments = Moments.of(x)
    np.testing.assert_allclose(moments.mean, x.mean(axis=0), rtol=1e-7)
    if n > 1:
        np.testing.assert_allclose(moments.variance(), x.var(axis=0, ddof=1), rtol=1e-6)
    else:
        with pytest.raises(ValueError, match="at least two samples; got 1"):
            moments.variance()
    assert not PixelMoments(4).total().mean.any()


@pytest.mark.parametrize("cuts", [[1], [99], [50], [1, 2, 3], [10, 11, 60], list(range(1, 100))])
def test_merging_any_split(cuts: list[int]) -> None:
    """The merged moments of any split are those of all samples: to float64, except for 1/n in float32."""
    x = samples(100)
    whole = Moments.of(x)
    merged = reduce(Moments.merge, [Moments.of(part) for part in np.split(x, cuts)])
    assert merged.n == 100
    np.testing.assert_allclose(merged.mean, whole.mean, rtol=1e-7)
    np.testing.assert_allclose(merged.m2, whole.m2, rtol=1e-6)


def test_no_cancellation() -> None:
    """A standard deviation of 1 on a mean of 1000 is exact in float32; a sum of squares would lose it."""
    x = np.random.default_rng(3).normal(size=(4096, 8)).astype(np.float32)
    parts = [Moments.of(part) for part in np.split(x + np.float32(1000), 8)]
    # the input rounds at 6e-5, the float32 mean of 512 numbers near 1000 at a few times that
    np.testing.assert_allclose(reduce(Moments.merge, parts).variance(), x.var(axis=0, ddof=1), rtol=1e-3)
    # pixels without samples are zero
    total = of_samples(np.ones((4, 2), np.float32), np.array([0, 4])).total()
    np.testing.assert_array_equal(total.mean[0], [0, 1])
    assert not total.m2.any()


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2)])
def test_pixels_with_different_numbers_of_samples(order: tuple[int, ...]) -> None:
    """Blocks of all pixels and of some, in any order, give each pixel the moments of its own samples."""
    rng = np.random.default_rng(2)
    blocks = [(np.arange(6), 3), (np.array([1, 2, 5]), 4), (np.array([5]), 1)]
    values = [rng.gamma(0.5, size=(n, 3, len(pixels))) for pixels, n in blocks]
    moments = PixelMoments(6)
    for k in order:
        pixels, n = blocks[k]
        moments.add([SampleBlock(pixels, 0, n, slice(None))], values[k].swapaxes(0, 1).reshape(3, -1))
    total = moments.total()
    np.testing.assert_array_equal(total.n, [[3, 7, 7, 3, 3, 8]])
    for pixel in range(6):
        own = np.concatenate(
            [x[..., pixels == pixel][..., 0] for (pixels, _), x in zip(blocks, values, strict=True) if pixel in pixels]
        )
        np.testing.assert_allclose(total.mean[:, pixel], own.mean(axis=0), rtol=1e-12)
        np.testing.assert_allclose(total.m2[:, pixel], own.var(axis=0) * len(own), rtol=1e-12)


@pytest.mark.parametrize("n_more", [0, 1, 2, 12])
def test_join_has_the_mean_of_all_samples(n_more: int) -> None:
    """Of pixels that go on; of those that begin anew the first samples are left out."""
    rng = np.random.default_rng(n_more)
    first, more = rng.normal(5, 2, (4, 3, 5, 3)), rng.normal(5, 2, (n_more, 3, 5, 3))
    taken = np.full((3, 5, 1), 4)
    if n_more:
        taken[1] = 0
    joined = join_films(replace(film_of(first, 4), n=taken), film_of(more, np.full((3, 5, 1), n_more)))
    expected = np.concatenate([first, more]).mean(axis=0)
    if n_more:
        expected[1] = more.mean(axis=0)[1]
    np.testing.assert_allclose(joined.mean, expected, rtol=1e-5)
    np.testing.assert_array_equal(joined.n, taken + n_more)
    assert np.isfinite(joined.root).all()


def test_variance_of_joined_samples() -> None:
    """That of the mean of independent samples is unbiased, whatever the two numbers."""
    rng = np.random.default_rng(7)
    first, more = rng.normal(5, 2, (4, 60, 60, 3)), rng.normal(5, 2, (12, 60, 60, 3))
    joined = join_films(film_of(first, 4), film_of(more, np.full((60, 60, 1), 12)))
    of_mean = joined.variance() / joined.n
    assert of_mean.mean() == pytest.approx(4 / 16, rel=0.03)
    assert joined.mean.var() == pytest.approx(4 / 16, rel=0.06)
    # `Film` keeps variances that are beyond float32, of samples that are not, with seven digits
    for unit in (1e-30, 1.0, 1e30):
        moments = Moments.of(samples(7) * unit)
        film = Film(7, moments.mean.astype(np.float32), np.sqrt(moments.m2).astype(np.float32))
        np.testing.assert_allclose(film.variance(), moments.variance(), rtol=2e-7)


def film_of(samples: np.ndarray, n: int | np.ndarray) -> Film:
    if not len(samples):
        return Film(n, *np.zeros((2, *samples.shape[1:]), np.float32))
    moments = Moments.of(samples)
    return Film(n, moments.mean.astype(np.float32), np.sqrt(moments.m2).astype(np.float32))


# Sub-blocks ----------------------------------------------------------------------------------------------------------


def of_samples(values: np.ndarray, n: np.ndarray | int, cuts: tuple[int, ...] = ()) -> SubBlocks:
    """Return the sub-blocks of `values` ``(most, P)`` for all channels, added in parts that end at `cuts`."""
    pixels = values.shape[1]
    blocks = SubBlocks(n, pixels)
    numbers = np.broadcast_to(n, pixels)
    edges = [0, *cuts, *sorted(set(numbers.tolist()))]
    edges = sorted({e for e in edges if e <= numbers.max()})
    for begin, end in itertools.pairwise(edges):
        active = np.flatnonzero(numbers >= end)
        block = SampleBlock(active, begin, end - begin, slice(None))
        blocks.add([block], np.tile(values[begin:end, active].reshape(-1), (3, 1)))
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
