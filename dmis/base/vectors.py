"""Batches as structure of arrays: N vectors are one ``(3, N)`` array; selections from batches; names of array types.

Rows are contiguous, so each operation runs over whole cache lines, several times faster than on ``(N, 3)`` arrays.
Inputs of shape ``(3, 1)`` broadcast. Selections are indices or slices, composed without copies where possible.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
"""Array of any type; those of rays are float32."""
Floats = npt.NDArray[np.float64]
"""Array of float64, as statistics and meshes are."""
Index = npt.NDArray[Any]
"""Whole numbers that index the last axis of a batch."""
Selection = Index | slice
"""A selection from the last axis of a batch: whole numbers, or a slice from start to stop."""
TINY = np.float32(1e-30)
"""Smallest divisor and radicand: it keeps rays finite, because one NaN makes Embree walk its whole tree."""
ROWS_PER_BLOCK = 4096
"""Rows of a table that `columns` transposes at a time: they stay in the cache."""


def dot(a: Array, b: Array) -> Array:
    """Return the dot product of ``(3, N)`` batches, shape ``(N,)``."""
    product = a[0] * b[0]
    product += a[1] * b[1]
    product += a[2] * b[2]
    return product


def normalise(a: Array) -> Array:
    """Scale a ``(3, N)`` batch to unit length; a zero vector stays zero."""
    return a * (1 / np.sqrt(np.maximum(dot(a, a), TINY)))


def frame(n: Array) -> tuple[Array, Array]:
    """Return two unit tangents that complete the unit normals `n` ``(3, N)`` to right-handed frames.

    Branch-free construction of Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    """
    x, y, z = n
    sign = np.copysign(np.float32(1), z)
    a = -1 / (sign + z)
    b = x * y * a
    s = np.empty_like(n)
    t = np.empty_like(n)
    s[0] = 1 + sign * x * x * a
    s[1] = sign * b
    s[2] = -sign * x
    t[0] = b
    t[1] = sign + y * y * a
    t[2] = -y
    return s, t


def take(a: Array, index: Selection | None) -> Array:
    """Return the entries `index` of the last axis; constants (last axis 1 or none) and ``index=None`` pass through.

    Slices are views: nothing is copied. An empty selection from an axis of length 1 is empty, because such an axis may
    be a constant or a batch of one. Indices are not range-checked, which saves a quarter of the time.
    """
    if index is None or a.ndim == 0:
        return a
    if a.shape[-1] == 1:
        return a if size(index, 1) else a[..., :0]
    return a[..., index] if isinstance(index, slice) else a.take(index, axis=-1, mode="wrap")


def take_optional(values: Array | None, index: Selection | None) -> Array | None:
    """Return `take` of the values; None if they are None."""
    return None if values is None else take(values, index)


def accumulate(total: Array, value: Array, index: Selection | None) -> None:
    """Add `value` ``(3, K)`` to the columns `index` of `total` (None: all of them), repeated ones included."""
    if index is None or isinstance(index, slice):
        total[:, index or slice(None)] += value
        return
    for row, values in zip(total, value, strict=True):
        np.add.at(row, index, values)


def distinct(values: npt.ArrayLike) -> np.ndarray:
    """Return the different values of an array, ascending, as `numpy.unique` does.

    `numpy.unique` imports numpy.ma unless it counts the values, which takes 0.01 s of a first render.
    """
    return np.unique(values, return_counts=True)[0]


def columns(table: Array, index: Index) -> Array:
    """Return the rows `index` ``(N,)`` of a table ``(T, C)`` as columns ``(C, N)``, transposed block by block."""
    transposed = np.empty((table.shape[1], len(index)), table.dtype)
    for begin in range(0, len(index), ROWS_PER_BLOCK):
        block = slice(begin, begin + ROWS_PER_BLOCK)
        transposed[:, block] = table.take(index[block], axis=0).T
    return transposed


def indices(condition: np.ndarray) -> Index | None:
    """Return the indices at which `condition` holds; None if it holds everywhere, so that nothing must be gathered."""
    index = np.flatnonzero(condition)
    return None if len(index) == len(condition) else index


def compose(outer: Selection | None, inner: Selection | None) -> Selection | None:
    """Return the selection `inner` from the selection `outer`, where None means everything."""
    if outer is None or inner is None:
        return inner if outer is None else outer
    if isinstance(outer, slice):
        start = outer.start
        return slice(start + inner.start, start + inner.stop) if isinstance(inner, slice) else inner + start
    return take(outer, inner)


def size(index: Selection | None, everything: int) -> int:
    """Return the number of entries that `index` selects from `everything` entries."""
    if index is None:
        return everything
    return index.stop - index.start if isinstance(index, slice) else len(index)
