"""Moments that merge, and patches."""

from functools import reduce

import numpy as np
import pytest
from helpers import Z_LIMIT

from dmis.variance import Film, Moments, luminance, patch_mean, patch_spread
from dmis.vec import Array


def samples(n: int, seed: int = 1, dtype: type = np.float64) -> Array:
    return np.random.default_rng(seed).gamma(0.5, size=(n, 4, 5, 3)).astype(dtype)


@pytest.mark.parametrize("n", [1, 2, 7, 100])
def test_moments_agree_with_numpy(n: int) -> None:
    """Mean and unbiased variance are NumPy's, to the float32 rounding of 1/n."""
    x = samples(n)
    moments = Moments.of(x)
    np.testing.assert_allclose(moments.mean, x.mean(axis=0), rtol=1e-7)
    if n > 1:
        np.testing.assert_allclose(moments.variance(), x.var(axis=0, ddof=1), rtol=1e-6)


def test_closed_form() -> None:
    """0, 1, 2, 3: mean 3/2, squared deviations 5, variance 5/3; a constant has none (1/n is float32)."""
    moments = Moments.of(np.arange(4.0)[:, None])
    assert (moments.n, moments.mean[0], moments.m2[0]) == (4, 1.5, 5.0)
    assert moments.variance()[0] == pytest.approx(5 / 3)
    assert Moments.of(np.full((5, 1), 0.25)).variance()[0] < 1e-16


@pytest.mark.parametrize("cuts", [[1], [99], [50], [1, 2, 3], [10, 11, 60], list(range(1, 100))])
def test_merging_any_split(cuts: list[int]) -> None:
    """However the samples are split, the merged moments are those of all: to float64 but for float32's 1/n."""
    x = samples(100)
    whole = Moments.of(x)
    merged = reduce(Moments.merge, [Moments.of(part) for part in np.split(x, cuts)])
    assert merged.n == 100
    np.testing.assert_allclose(merged.mean, whole.mean, rtol=1e-7)
    np.testing.assert_allclose(merged.m2, whole.m2, rtol=1e-6)


def test_merging_is_symmetric_and_associative() -> None:
    """Order and grouping do not matter, up to float64 rounding."""
    a, b, c = (Moments.of(samples(n, n)) for n in (3, 20, 7))
    for other in (b.merge(a).merge(c), a.merge(b.merge(c)), c.merge(a).merge(b)):
        np.testing.assert_allclose(other.mean, a.merge(b).merge(c).mean, rtol=1e-12)
        np.testing.assert_allclose(other.m2, a.merge(b).merge(c).m2, rtol=1e-12)


def test_no_cancellation() -> None:
    """A spread of 1 on a mean of 1000 in float32 is kept: a sum of squares would lose it (1e6 against eps 6e-8)."""
    x = np.random.default_rng(3).normal(size=(4096, 8)).astype(np.float32)
    parts = [Moments.of(part) for part in np.split(x + np.float32(1000), 8)]
    # the input rounds at 6e-5, the float32 mean of 512 numbers near 1000 at a few times that
    np.testing.assert_allclose(reduce(Moments.merge, parts).variance(), x.var(axis=0, ddof=1), rtol=1e-3)


def test_variance_is_unbiased() -> None:
    """Over many sets of two normal samples the mean variance is the true one, 4, by a z-test."""
    variance = Moments.of(2 * np.random.default_rng(4).normal(size=(2, 20000))).variance()
    assert abs((variance.mean() - 4) / (variance.std() / np.sqrt(20000))) < Z_LIMIT


def test_film() -> None:
    """Variances beyond float32, of what is not, are kept with its digits."""
    for unit in (1e-30, 1.0, 1e30):
        moments = Moments.of(samples(7) * unit)
        film = Film(7, moments.mean.astype(np.float32), np.sqrt(moments.m2).astype(np.float32))
        np.testing.assert_allclose(film.variance(), moments.variance(), rtol=2e-7)


@pytest.mark.parametrize("n", [0, 1])
def test_variance_needs_two_samples(n: int) -> None:
    """The error says so."""
    with pytest.raises(ValueError, match=f"at least two samples; got {n}"):
        Moments(n, np.zeros(1), np.zeros(1)).variance()


def test_luminance() -> None:
    """White is 1 (the weights' sum), green is most of it."""
    assert luminance(np.ones(3)) == pytest.approx(1)
    assert luminance(np.eye(3)).tolist() == pytest.approx([0.212671, 0.715160, 0.072169])


@pytest.mark.parametrize("shape", [(8, 8), (9, 7), (1, 1), (5, 17)])
@pytest.mark.parametrize("size", [1, 2, 4, 5, 32])
def test_patch_means_by_hand(shape: tuple[int, int], size: int) -> None:
    """Each patch's value is the mean of its pixels, at ragged borders and in patches larger than the image too."""
    image = np.random.default_rng(5).random(shape)
    means = patch_mean(image, size)
    assert means.shape == (-(-shape[0] // size), -(-shape[1] // size))
    for i, j in np.ndindex(means.shape):
        block = image[i * size : (i + 1) * size, j * size : (j + 1) * size]
        assert means[i, j] == pytest.approx(block.mean(), rel=1e-12)


@pytest.mark.parametrize("size", [1, 3, 4, 100])
def test_spreading_puts_patches_back(size: int) -> None:
    """Each pixel has its patch's value, and averaging again gives the patches back."""
    image = np.random.default_rng(6).random((10, 7))
    means = patch_mean(image, size)
    spread = patch_spread(means, size, image.shape)
    assert spread.shape == image.shape
    np.testing.assert_allclose(patch_mean(spread, size), means, rtol=1e-12)
    assert spread[9, 6] == means[9 // size, 6 // size]


@pytest.mark.parametrize("size", [0, -1])
def test_bad_patches(size: int) -> None:
    """A patch has at least one pixel."""
    with pytest.raises(ValueError, match="patch must be at least 1 pixel"):
        patch_mean(np.ones((2, 2)), size)
