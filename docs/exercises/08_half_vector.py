"""Exercise 8 (medium): directions that are mirrored at half vectors.

Microfacet lobes pick a half vector h about the normal, here with Blinn's density
p_h = (e + 1) / (2 pi) |cos|^e, and mirror wo at it. The density of the mirrored
direction is another one, because mirroring stretches solid angles.

Copy this file to mine.py, and check it: ``python docs/exercises/checks 8 mine.py``.
"""

from dmis.base.vectors import dot, normalise
from dmis.samplers.warp import power_pdf, square_to_power


def sample(wo, u, exponent):
    """Return `wo` ``(3, N)`` mirrored at half vectors, ``(3, N)``; the normal is +z.

    ``square_to_power(u, exponent)`` has half vectors of the density p_h. Directions
    below the horizon stay as they are.
    """
    h = square_to_power(u, exponent)
    return 2 * dot(wo, h) * h - wo


def pdf(wo, wi, exponent):
    """Return the density of `wi` ``(3, N)`` per solid angle, ``(N,)``."""
    h = normalise(wo + wi)
    return power_pdf(abs(h[2]), exponent)  # wrong: this is p_h
