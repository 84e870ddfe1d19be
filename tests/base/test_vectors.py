"""Vectors in structure-of-arrays form."""

import numpy as np
import pytest

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


def test_dot_broadcasts() -> None:
    """A single vector ``(3, 1)`` goes with a batch."""
    b = random_directions(5, np.float32)
    np.testing.assert_array_equal(dot(np.array([[0], [0], [1]], np.float32), b), b[2])


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
def test_normalise_gives_unit_length(length: float) -> None:
    """Any length becomes 1 within a few float32 roundings, in the same direction."""
    w = random_directions(100, np.float32)
    np.testing.assert_allclose(normalise(w * np.float32(length)), w, atol=1e-6)


def test_normalise_keeps_zero() -> None:
    """A zero vector stays zero: no NaN may reach Embree."""
    assert not normalise(np.zeros((3, 2), np.float32)).any()


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
