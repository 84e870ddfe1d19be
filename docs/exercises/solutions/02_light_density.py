"""Solution of exercise 2: r^2 / (A cos), and 0 behind the light."""

import numpy as np


def light_density(p, x, normal, area):
    """Return the density of `x`, seen from `p`, per solid angle, ``(N,)``."""
    to_p = p - x
    r2 = (to_p * to_p).sum(axis=0)
    cos = np.tensordot(normal, to_p, 1) / np.sqrt(r2)
    return np.where(cos > 0, r2 / (area * np.maximum(cos, 1e-9)), 0)
