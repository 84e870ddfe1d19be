"""Means over patches, and patches put back into an image."""

import numpy as np
import pytest

from dmis.base.patches import patch_mean, patch_spread


@pytest.mark.parametrize("shape", [(9, 7), (1, 1), (5, 17)])
@pytest.mark.parametrize("size", [1, 4, 32])
def test_patch_means_by_hand(shape: tuple[int, int], size: int) -> None:
    """The value of each patch is the mean of its pixels, also at ragged borders and if it is larger than the image."""
    image = np.random.default_rng(5).random(shape)
    means = patch_mean(image, size)
    assert means.shape == (-(-shape[0] // size), -(-shape[1] // size))
    for i, j in np.ndindex(means.shape):
        block = image[i * size : (i + 1) * size, j * size : (j + 1) * size]
        assert means[i, j] == pytest.approx(block.mean(), rel=1e-12)


@pytest.mark.parametrize("size", [1, 3, 100])
def test_spreading_puts_patches_back(size: int) -> None:
    """`patch_spread` gives each pixel the value of its patch, and averaging again gives the patches back."""
    image = np.random.default_rng(6).random((10, 7))
    means = patch_mean(image, size)
    spread = patch_spread(means, size, image.shape)
    assert spread.shape == image.shape
    np.testing.assert_allclose(patch_mean(spread, size), means, rtol=1e-12)
    assert spread[9, 6] == means[9 // size, 6 // size]


def test_bad_patches() -> None:
    """A patch size below one pixel is refused."""
    with pytest.raises(ValueError, match="patch must be at least 1 pixel"):
        patch_mean(np.ones((2, 2)), 0)
