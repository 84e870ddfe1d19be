"""Solution of exercise 4: variance with n - 1, then divided by n."""

import numpy as np


def mean_and_error(samples):
    """Return the mean of samples, and its standard error, two ``(...)``."""
    variance = samples.var(axis=0, ddof=1)
    return samples.mean(axis=0), np.sqrt(variance / len(samples))
