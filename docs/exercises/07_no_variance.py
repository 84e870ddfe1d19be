"""Exercise 7 (easy): a density without variance.

The integrand for the desk lamp of tutorial 2 is cos t inside the lamp's cone, and 0
outside, where t is the angle to the axis +z. With a density in proportion to the
integrand, the variance is 0.

Copy this file to mine_07.py, and check it:
``python docs/exercises/checks 7 mine_07.py``.
"""

import numpy as np

from dmis.samplers.warp import cone_pdf, square_to_cone


def sample(u, half_angle):
    """Return directions ``(3, N)`` in the cone about +z, in proportion to cos t.

    Parameters
    ----------
    u
        Uniform numbers in [0, 1), ``(2, N)``.
    half_angle
        T, the half angle of the cone in radians.
    """
    return square_to_cone(u, np.float32(1 - np.cos(half_angle)))  # uniform: noisy


def pdf(cos, half_angle):
    """Return the density per solid angle of directions with this cosine, ``(N,)``."""
    return np.full_like(cos, cone_pdf(np.float32(1 - np.cos(half_angle))))
