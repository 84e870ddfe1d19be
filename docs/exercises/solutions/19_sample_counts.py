"""Solution of exercise 19: n in proportion to the square root of V / C."""

import numpy as np


def sample_counts(variance, cost, budget):
    """Return numbers of samples (not rounded) whose cost is the budget, ``(H, W)``."""
    n = np.sqrt(variance / cost)
    return n * (budget / (n * cost).sum())
