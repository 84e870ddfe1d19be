"""Exercise 19 (easy): which pixels deserve more samples?

The error of the image is the sum of V / n over its pixels; the cost is the sum of n C.
Equation (20) of the theory page is the best n.

Copy this file to mine_19.py, and check it:
``python docs/exercises/checks 19 mine_19.py``.
"""

import numpy as np


def sample_counts(variance, cost, budget):
    """Return numbers of samples (not rounded) with the cost `budget`, ``(H, W)``.

    Parameters
    ----------
    variance, cost
        Variance and cost of a sample of each pixel, above 0, ``(H, W)``.
    budget
        Allowed sum of n times cost.
    """
    return np.full(variance.shape, budget / cost.sum())  # equal: not the best
