"""Solution of exercise 8: p_h / (4 |wo . h|), equation (5) of the theory page."""

import numpy as np

from dmis.base.vectors import dot, normalise
from dmis.samplers.warp import power_pdf, square_to_power


def sample(wo, u, exponent):
    """Return `wo` ``(3, N)`` reflected about half vectors; the normal is +z."""
    h = square_to_power(u, exponent)
    return 2 * dot(wo, h) * h - wo


def pdf(wo, wi, exponent):
    """Return the density of `wi` ``(3, N)`` per solid angle, ``(N,)``."""
    h = normalise(wo + wi)
    return power_pdf(abs(h[2]), exponent) / (4 * np.maximum(abs(dot(wo, h)), 1e-9))
