"""Vectors as structure of arrays: a batch of N vectors is one ``(3, N)`` array; names of array types.

Rows are contiguous, so each operation runs over whole cache lines, several times faster than on ``(N, 3)`` arrays.
Inputs of shape ``(3, 1)`` broadcast. Selections from batches are in `dmis.base.selection`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
"""Array of any type; those of rays are float32."""
Floats = npt.NDArray[np.float64]
"""Array of float64, as statistics and meshes are."""
TINY = np.float32(1e-30)
"""Smallest divisor and radicand: it keeps rays finite, because one NaN makes Embree walk its whole tree."""


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
