"""Exercise 3 (hard): direct light, one light sample for each point.

A matte surface has the BRDF albedo / pi. Nothing is between the points and the light.
An estimate is f / p: BRDF times radiance times cosine, divided by the density per solid
angle. The light shines on one side only, and a part of it may be below the surface of a
point. Three lines are enough, if they handle these cases.

Copy this file to mine_03.py, and check it:
``python docs/exercises/checks 3 mine_03.py``.
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
        A `dmis.QuadLight`. ``light.sample(p, u)`` has the fields ``wi`` ``(3, N)``,
        directions to the light; ``radiance`` ``(3, N)`` or ``(3, 1)``, as if each
        direction met the bright side; ``emits`` ``(N,)``, whether it does; and ``pdf``
        ``(N,)``, the density per solid angle.
    u
        Uniform numbers, ``(2, N)``.
    """
    sample = light.sample(p, u)
    return (
        albedo / np.pi * sample.radiance * dot(n, sample.wi)
    )  # wrong: what is missing?
