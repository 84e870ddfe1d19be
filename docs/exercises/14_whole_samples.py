"""Exercise 14 (medium): shares become whole numbers of samples.

A pixel has S slots for samples, and w S of them should be light samples. But w S is
seldom a whole number. Each slot must be a light sample with probability w, and the
number of light samples must be w S rounded up or down. Equation (12) of the theory page
achieves this with one random offset for each pixel.

Copy this file to mine_14.py, and check it:
``python docs/exercises/checks 14 mine_14.py``.
"""

import numpy as np


def light_slots(w, slots, offset):
    """Return whether each slot is a light sample, ``(S, N)`` bool.

    Parameters
    ----------
    w
        Share of light samples of each pixel, ``(N,)``.
    slots
        S, number of samples of a pixel.
    offset
        A uniform random number in [0, 1) for each pixel, ``(N,)``.
    """
    lots = np.random.default_rng(1).random((slots, len(w)))
    return lots < w  # random: right on average, but the number varies
