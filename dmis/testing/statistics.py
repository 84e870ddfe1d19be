"""Significance levels and statistics of the checks.

All seeds are fixed, so that a check that passes once passes always. A right implementation fails any of the tests of
one check with a probability of at most `FALSE_ALARM`.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from dmis.base.vectors import Array

FALSE_ALARM = 1e-4
"""Probability that all statistical tests of one check together reject a right implementation."""


def level(tests: int) -> float:
    """Return the significance level of each of so many tests: Šidák's ``1 - (1 - FALSE_ALARM)^(1 / tests)``."""
    return float(-np.expm1(np.log1p(-FALSE_ALARM) / tests))


def z_limit(level: float) -> float:
    """Return the two-sided limit of a normal deviate at a significance level."""
    return -NormalDist().inv_cdf(level / 2)


def chi2_p(observed: Array, expected: Array, variance: Array | float = 0.0) -> float:
    """Return the p-value of counts against `expected` ones of the same shape by Pearson's chi-square test.

    Cells that expect fewer than 5 are pooled into one; a ValueError if no other is left. The `variance` of the error of
    `expected`, a number or an array of the same shape, adds to that of the counts.
    """
    from scipy.special import chdtrc

    cells = np.stack([np.ravel(a).astype(float) for a in np.broadcast_arrays(observed, expected, variance)])
    cells = cells[:, np.argsort(cells[1])]
    pooled = int(np.searchsorted(cells[1], 5))
    if pooled:
        # the smallest ones whose sum is 5 or more
        pooled = max(pooled, 1 + int(np.searchsorted(np.cumsum(cells[1]), 5)))
        cells = np.column_stack([cells[:, pooled:], cells[:, :pooled].sum(axis=1)])
    if cells.shape[1] < 2:
        raise ValueError("a chi-square test needs two cells that expect 5 or more; there are fewer. Take more samples")
    # sum (o - e)^2 / (e + error^2)
    statistic = ((cells[0] - cells[1]) ** 2 / (cells[1] + cells[2])).sum()
    return float(chdtrc(cells.shape[1] - 1, statistic))
