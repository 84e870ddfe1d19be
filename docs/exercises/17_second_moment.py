"""Exercise 17 (medium): the second moment at every share, from one pilot.

The pilot has w = 1/2, so its samples have the density q = (p_l + p_b) / 2 and the
values X = f / q. At another share w, what is the value of the same sample, and how much
more often does it occur? Express p_w / q by w and d = (p_l - p_b) / (p_l + p_b).

Copy this file to mine_17.py, and check it:
``python docs/exercises/checks 17 mine_17.py``.
"""

import numpy as np


def second_moment(x, d, w):
    """Return an unbiased estimate of the integral of f^2 / p_w at each share, ``(G,)``.

    Parameters
    ----------
    x, d
        X = f / q and d = (p_l - p_b) / (p_l + p_b) of the pilot's samples, ``(n,)``.
    w
        Shares from 0 to 1, ``(G,)``. If p_w and X are 0, the sample counts 0.
    """
    return np.full(len(w), (x**2).mean())  # right for w = 1/2 only
