"""Vectors in structure-of-arrays form, patches of pixels, and checks of arguments."""

import json
from typing import Any

import numpy as np
import pytest

from dmis.base.patches import patch_mean, patch_spread
from dmis.base.validate import did_you_mean, number, pair, whole
from dmis.base.vectors import ROWS_PER_BLOCK, Selection, columns, compose, dot, frame, normalise, size, take
from dmis.testing.sphere import polar


def random_directions(count: int, dtype: type) -> np.ndarray:
    v = np.random.default_rng(1).normal(size=(3, count))
    return (v / np.linalg.norm(v, axis=0)).astype(dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_dot_agrees_with_numpy(dtype: type) -> None:
    """The dot product is NumPy's, keeps the dtype and leaves its arguments alone."""
    a, b = np.random.default_rng(2).normal(size=(2, 3, 100)).astype(dtype)
    before = a.copy()
    product = dot(a, b)
    assert product.dtype == dtype
    np.testing.assert_allclose(product, np.einsum("ij,ij->j", a.astype(float), b), atol=8 * np.finfo(dtype).eps)
    np.testing.assert_array_equal(a, before)


def test_single_vectors_and_zero() -> None:
    """A single vector ``(3, 1)`` goes with a batch."""
    b = random_directions(5, np.float32)
    np.testing.assert_array_equal(dot(np.array([[0], [0], [1]], np.float32), b), b[2])
    # A zero vector stays zero: no NaN may reach Embree
    assert not normalise(np.zeros((3, 2), np.float32)).any()


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
def test_normalise_gives_unit_length(length: float) -> None:
    """Any length becomes 1 within a few float32 roundings, in the same direction."""
    w = random_directions(100, np.float32)
    np.testing.assert_allclose(normalise(w * np.float32(length)), w, atol=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_frame_is_orthonormal_and_right_handed(dtype: type) -> None:
    """``s x t = n``, all unit and at right angles, for random normals and axes, with zeros of both signs."""
    axes = np.concatenate([np.eye(3), -np.eye(3)]).T.astype(dtype)
    tilted = np.stack([polar(d) for d in (1e-3, 90.0, 179.999)], axis=1).astype(dtype)
    n = np.concatenate([random_directions(1000, dtype), axes, tilted], axis=1)
    s, t = frame(n)
    tolerance = 8 * np.finfo(dtype).eps  # a handful of roundings
    for a, b, expected in ((s, s, 1), (t, t, 1), (s, t, 0), (s, n, 0), (t, n, 0)):
        np.testing.assert_allclose(dot(a, b), expected, atol=tolerance)
    np.testing.assert_allclose(np.cross(s, t, axis=0), n, atol=tolerance)


def test_take_passes_constants_through() -> None:
    """Constants and None are not gathered; arrays are, along the last axis."""
    a, index = np.arange(6.0).reshape(2, 3), np.array([2, 0])
    np.testing.assert_array_equal(take(a, index), [[2, 0], [5, 3]])
    assert take(a, None) is a
    constant = np.ones((3, 1))
    assert take(constant, index) is constant
    scalar = np.float32(2)
    assert take(scalar, index) is scalar


@pytest.mark.parametrize("nothing", [np.array([], int), slice(0, 0)], ids=["array", "slice"])
def test_nothing_is_left_of_a_batch_of_one(nothing: Selection) -> None:
    """A batch of one looks like a constant, but not if nothing is selected from it; nor do two selections in a row."""
    assert take(np.ones((3, 1)), nothing).shape == (3, 0)
    assert size(compose(np.array([5]), nothing), 9) == 0


@pytest.mark.parametrize("number", [0, 1, ROWS_PER_BLOCK - 1, ROWS_PER_BLOCK, 2 * ROWS_PER_BLOCK + 1])
def test_columns_are_rows_turned(number: int) -> None:
    """Whatever the number of blocks, column k is the row that was asked for in place k; the columns are contiguous."""
    rng = np.random.default_rng(3)
    table = rng.random((50, 9), dtype=np.float32)
    index = rng.integers(0, 50, number).astype(np.int32)
    transposed = columns(table, index)
    assert transposed.flags.c_contiguous
    np.testing.assert_array_equal(transposed, table[index].T)


# Patches --------------------------------------------------------------------------------------------------------------


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


# Checks of arguments --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [8, 8.0, np.int64(8), np.uint8(8), np.float32(8), np.float64(8)])
def test_numbers_become_plain(value: Any) -> None:
    """Whatever their type; and can be written as JSON, which NumPy's integers cannot."""
    assert json.dumps([whole("n", value, 8, 8), number("x", value, 8, 8)]) == "[8, 8.0]"
    assert json.dumps(pair("p", np.array([value, value]), whole)) == "[8, 8]"


def test_large_numbers_stay_exact() -> None:
    assert whole("n", 10**400 + 1, 0) == 10**400 + 1


@pytest.mark.parametrize("value", [None, "8", [8], True, np.bool_(True), np.nan, np.inf, 8.5, np.float32(8.5), 1j])
def test_bad_whole_numbers(value: Any) -> None:
    with pytest.raises(ValueError, match="n must be a whole number of at least 1; got "):
        whole("n", value, 1)


@pytest.mark.parametrize("value", [None, "8", [8], True, np.nan, np.inf, -0.5, np.float32(2.5)])
def test_numbers_out_of_range(value: Any) -> None:
    with pytest.raises(ValueError, match="x must be a number from 0 to 2, of something; got "):
        number("x", value, 0, 2, "of something")


@pytest.mark.parametrize("value", [None, 8, (), (8,), (8, 8, 8)])
def test_bad_pairs(value: Any) -> None:
    with pytest.raises(ValueError, match="p must be two numbers; got "):
        pair("p", value, whole)


@pytest.mark.parametrize(
    ("name", "end"), [("thesi", ", did you mean 'thesis'?"), ("AUTO", ", did you mean 'auto'?"), ("nope", "")]
)
def test_a_name_that_is_alike_is_suggested(name: str, end: str) -> None:
    assert did_you_mean(name, ["auto", "balance", "thesis"]) == end
