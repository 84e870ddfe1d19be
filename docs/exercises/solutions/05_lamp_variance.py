r"""Solution of exercise 5.

E[X^2] is the integral of (2 pi u)^2 from cos T to 1, which is
4 pi^2 (1 - cos^3 T) / 3. The mean E[X] is pi sin^2 T.
"""

import numpy as np


def lamp_variance(half_angle):
    """Return the variance of one sample, for the lamp's half angle T in radians."""
    second = 4 * np.pi**2 * (1 - np.cos(half_angle) ** 3) / 3
    return second - (np.pi * np.sin(half_angle) ** 2) ** 2
