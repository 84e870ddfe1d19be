"""Exercise 22 (easy): the density with one of several lamps.

A light sample picks lamp k with the probability q_k, then a point of it evenly. Return
the density per solid angle of directions, whichever technique drew them.

Copy this file to mine.py, and check it: ``python docs/exercises/checks 22 mine.py``.
"""

import numpy as np


def light_density(met, distance, cos_l, area, q):
    """Return p_l, ``(N,)``; 0 where no lamp is met, or its dark side.

    Parameters
    ----------
    met
        Number of the lamp that the ray in each direction meets, ``(N,)``; -1: none.
    distance, cos_l
        To the lamp, and cosine at the lamp between its normal and the way back,
        negative on its dark side, ``(N,)``. Where no lamp is met they are 0.
    area, q
        Area and probability of each lamp, ``(L,)``; the probabilities sum to 1.
    """
    density = distance**2 / (area[met] * np.maximum(cos_l, 1e-9))
    return np.where(met >= 0, density, 0)  # wrong: that of one lamp alone
