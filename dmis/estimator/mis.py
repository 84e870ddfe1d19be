"""Heuristics of multiple importance sampling: the weight of a sample, given the densities of all techniques.

A heuristic takes the effective densities ``a_j = w_j p_j`` and returns ``W / a_k``, where W is the MIS weight of a
sample of technique k: the factor that multiplies ``f`` in its estimate. With the balance heuristic it is
``1 / sum a_j``, the reciprocal of the mixture density. Source: Veach and Guibas 1995; Veach 1997, chapter 9.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import reduce

import numpy as np

from dmis.base.vectors import TINY, Array

Heuristic = Callable[[Sequence[Array], int], Array]
"""``(a, k) -> W / a[k]``; k breaks ties, so that the weights of all techniques sum to 1."""


LARGEST_EXPONENT = 1e8
"""Exponent above which two float32 densities that differ have the weights 1 and 0 to float32's precision."""


def balance(a: Sequence[Array], k: int) -> Array:
    """``W = a_k / sum a``."""
    return 1 / np.maximum(_total(a), TINY)


def power(beta: float) -> Heuristic:
    """``W = a_k^beta / sum a^beta``, written with the ratios to a_k so that nothing overflows.

    From `LARGEST_EXPONENT` on it is `maximum`, its limit.
    """
    if not 0 < beta < np.inf:
        raise ValueError(
            f"the exponent of the power heuristic must be positive and finite; got {beta}. Use maximum for its limit"
        )
    if beta > LARGEST_EXPONENT:
        return maximum
    least = np.float32(1e-18 ** min(1, 2 / beta))  # of a ratio; below it W is 0 to any float

    def raised(a: Array, b: Array) -> Array:
        ratio = b / np.maximum(np.maximum(a, b * least), TINY)
        return ratio * ratio if beta == 2 else ratio ** np.float32(beta)

    def heuristic(a: Sequence[Array], k: int) -> Array:
        others = _total(raised(a[k], b) for j, b in enumerate(a) if j != k)
        return 1 / (np.maximum(a[k], TINY) * (1 + others))

    return heuristic


def maximum(a: Sequence[Array], k: int) -> Array:
    """``W = 1`` for the technique with the largest density, 0 for the others."""
    wins = reduce(np.logical_and, (a[k] > b if j < k else a[k] >= b for j, b in enumerate(a) if j != k))
    return wins / np.maximum(a[k], TINY)


def cutoff(alpha: float) -> Heuristic:
    """Balance among the techniques whose density is at least `alpha` times the largest."""
    if not 0 <= alpha <= 1:
        raise ValueError(
            f"the threshold of the cutoff heuristic must be in [0, 1], a share of the maximum; got {alpha}"
        )

    def heuristic(a: Sequence[Array], k: int) -> Array:
        threshold = np.float32(alpha) * reduce(np.maximum, a)
        return (a[k] >= threshold) / np.maximum(_total(b * (b >= threshold) for b in a), TINY)

    return heuristic


def _total(a: Iterable[Array]) -> Array:
    return reduce(np.add, a)
