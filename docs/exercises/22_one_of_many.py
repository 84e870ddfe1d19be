"""Exercise 22 (easy): the density with one of several lamps.

A light sample picks lamp k with the probability q_k, then a uniform point on this lamp.
For directions of either technique, return the density of light sampling.

Copy this file to mine_22.py, and check it:
``python docs/exercises/checks 22 mine_22.py``.
"""

import numpy as np


def light_density(met, distance, cos_l, area, q):
    """Return p_l, ``(N,)``; 0 if the ray hits no lamp, or its dark side.

    Parameters
    ----------
    met
        Number of the lamp that each ray hits, or -1, ``(N,)``.
    distance, cos_l
        Distance to the lamp, and cosine between its normal and the way back to the
        point, negative on the dark side, ``(N,)``. Both are 0 if the ray hits no lamp.
    area, q
        Area and probability of each lamp, ``(L,)``; the probabilities sum to 1.
    """
    density = distance**2 / (area[met] * np.maximum(cos_l, 1e-9))
    return np.where(met >= 0, density, 0)  # wrong: the density for one lamp alone
