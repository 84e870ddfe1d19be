"""Solution of exercise 17: the mean of X^2 / m.

The square of what the sample counts at w is (X / m)^2. It was drawn from q in place
of p_w, which is a factor of p_w / q = m.
"""

import numpy as np


def second_moment(x, d, w):
    """Return unbiased estimates of the integral of f^2 / p_w, ``(G,)``."""
    m = 1 + (2 * w[:, None] - 1) * d
    return (x**2 / np.maximum(m, 1e-9)).mean(axis=1)
