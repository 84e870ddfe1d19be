"""Solution of exercise 16: (1 - p)^n, by logarithms."""

import numpy as np


def chance_of_no_hit(p, samples):
    """Return the probability that none of n samples hits a spike, ``(K,)``."""
    return np.exp(samples * np.log1p(-p))


def samples_needed(p, chance):
    """Return the least n whose probability of no hit is at most `chance`."""
    return int(np.ceil(np.log(chance) / np.log1p(-p) - 1e-9))
