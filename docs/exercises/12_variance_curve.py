"""Exercise 12 (hard): the variance as a function of the share.

Equation (10) of the theory page: with fixed numbers of samples, w of them light
samples, and the balance heuristic, the variance of one sample is

    V(w) = M_2 - w m_l^2 - (1 - w) m_b^2,    M_2 = integral of f^2 / p_w,
    m_l = integral of p_l f / p_w,           m_b = integral of p_b f / p_w.

Copy this file to mine.py, and check it: ``python -m dmis check mine.py --exercise 12``.
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
    return m_2 - (np.sum(f) * dx) ** 2  # wrong: this is for techniques drawn by lot
