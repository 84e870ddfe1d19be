"""Exercise 12 (hard): the variance as a function of the share.

Take N samples, of which exactly w N are light samples, and weight them by the balance
heuristic. Derive V, which is N times the variance of the mean of all samples. Light
samples vary around their mean m_l, and BRDF samples around their mean m_b. The starter
computes V for another case: each sample picks its technique at random.

Copy this file to mine_12.py, and check it:
``python docs/exercises/checks 12 mine_12.py``.
"""

import numpy as np


def variance_curve(f, p_l, p_b, dx, w):
    """Return V at each share, ``(G,)``.

    Parameters
    ----------
    f, p_l, p_b
        Integrand and densities at points x in steps of `dx`, ``(K,)``.
    w
        Shares of light samples, ``(G,)``.
    """
    p_w = w[:, None] * p_l + (1 - w[:, None]) * p_b
    m_2 = (f**2 / p_w).sum(axis=1) * dx
    return m_2 - (np.sum(f) * dx) ** 2  # wrong: this is for random techniques
