"""Solution of exercise 7.

The density is cos t / (pi sin^2 T), so an angle is below t with the probability
u = sin^2 t / sin^2 T. Solve this for t.
"""

import numpy as np


def sample(u, half_angle):
    """Return directions ``(3, N)`` in the cone about +z, in proportion to cos t."""
    sin2 = u[0] * np.sin(half_angle) ** 2
    phi, sin = 2 * np.pi * u[1], np.sqrt(sin2)
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), np.sqrt(1 - sin2)])


def pdf(cos, half_angle):
    """Return the density per solid angle of directions with this cosine, ``(N,)``."""
    return cos / (np.pi * np.sin(half_angle) ** 2)
