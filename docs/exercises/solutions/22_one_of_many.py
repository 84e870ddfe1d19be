"""Solution of exercise 22: the probability of the lamp times the density on it."""

import numpy as np


def light_density(met, distance, cos_l, area, q):
    """Return p_l, ``(N,)``; 0 if the ray hits no lamp, or its dark side."""
    lit = (met >= 0) & (cos_l > 0)
    density = q[met] * distance**2 / (area[met] * np.where(lit, cos_l, 1))
    return np.where(lit, density, 0)
