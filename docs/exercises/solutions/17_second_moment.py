"""Solution of exercise 17: the mean of X^2 / m, with m = p_w / q.

At the share w a sample counts X / m, and its square is (X / m)^2. Because it was drawn
from q instead of p_w, the square gets the factor p_w / q = m.
"""

import numpy as np


def second_moment(x, d, w):
    """Return unbiased estimates of the integral of f^2 / p_w, ``(G,)``."""
    m = 1 + (2 * w[:, None] - 1) * d
    return (x**2 / np.maximum(m, 1e-9)).mean(axis=1)
