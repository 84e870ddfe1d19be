"""Exercise 8 (medium): directions that are reflected about half vectors.

Microfacet lobes pick a half vector h around the normal, here with Blinn's density
p_h = (e + 1) / (2 pi) |cos|^e, and reflect wo about h. The density of the reflected
direction is different, because the reflection stretches solid angles.

Copy this file to mine_08.py, and check it:
``python docs/exercises/checks 8 mine_08.py``.
"""

from dmis.base.vectors import dot, normalise
from dmis.samplers.warp import power_pdf, square_to_power


def sample(wo, u, exponent):
    """Return `wo` ``(3, N)`` reflected about half vectors; the normal is +z.

    ``square_to_power(u, exponent)`` returns half vectors with the density p_h. Keep
    directions below the horizon.
    """
    h = square_to_power(u, exponent)
    return 2 * dot(wo, h) * h - wo


def pdf(wo, wi, exponent):
    """Return the density of `wi` ``(3, N)`` per solid angle, ``(N,)``."""
    h = normalise(wo + wi)
    return power_pdf(abs(h[2]), exponent)  # wrong: this is p_h
