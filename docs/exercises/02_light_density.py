"""Exercise 2 (medium): the density of a point on a light, per solid angle.

A point on a light of area A is picked uniformly, so its density is 1 / A per area. The
estimator needs the density per solid angle: multiply by r^2 / cos. Here r is the
distance from p to x, and cos the cosine between the light's normal and the direction
from x to p.

Copy this file to mine_02.py, and check it:
``python docs/exercises/checks 2 mine_02.py``.
"""

import numpy as np


def light_density(p, x, normal, area):
    """Return the density of the points `x`, seen from `p`, per solid angle, ``(N,)``.

    Parameters
    ----------
    p, x
        Shading points, and points on the light, ``(3, N)``.
    normal
        Unit normal ``(3,)`` of the side that shines; the density is 0 behind it.
    area
        Area of the light.
    """
    return np.full(p.shape[1], 1 / area)  # wrong: this is the density per area
