"""Exercise 3 (hard): direct light, one light sample for each point.

A matte surface has the BRDF albedo / pi. The light is visible from every point. An
estimate is f / p: BRDF times radiance times cosine, divided by the density per solid
angle.

Copy this file to mine.py, and check it: ``python docs/exercises/checks 3 mine.py``.
"""

import numpy as np

from dmis.base.vectors import dot


def direct_light(p, n, albedo, light, u):
    """Return one estimate of the reflected radiance at each point, ``(3, N)``.

    Parameters
    ----------
    p, n
        Points and unit normals, ``(3, N)``.
    albedo
        Share of the light that the surface reflects, by channel, ``(3, 1)``.
    light
        A `dmis.QuadLight`. ``light.sample(p, u)`` holds ``wi`` ``(3, N)``,
        ``radiance`` ``(3, N)`` or ``(3, 1)``, ``emits`` and ``pdf`` ``(N,)``.
    u
        Uniform numbers, ``(2, N)``.
    """
    sample = light.sample(p, u)
    return (
        albedo / np.pi * sample.radiance * dot(n, sample.wi)
    )  # wrong: what is missing?
