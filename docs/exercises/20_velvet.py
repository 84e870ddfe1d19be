"""Exercise 20 (medium): a better density for a lobe.

Tutorial 6 samples velvet like a matte surface, by cos / pi. But velvet is bright
where the cosine is small. Write a density that fits better: the relative variance of
f cos / p must be at most 0.3 (cos / pi has 1.4, a uniform density 0.37). Two uniform
numbers and the inverse of a simple distribution function are enough.

Copy this file to mine_20.py, and check it:
``python docs/exercises/checks 20 mine_20.py``.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dmis.base.vectors import normalise
from dmis.brdf.lobe import Lobe
from dmis.samplers.warp import INV_PI, square_to_sphere


@dataclass(frozen=True, eq=False)
class Velvet(Lobe):
    """Brighter where the view grazes."""

    reflectance: float
    colours: ClassVar = ("reflectance",)

    def eval(self, directions):
        """Return the BRDF without the cosine, ``(1, N)`` or ``(3, N)``. Keep it."""
        rim = (1 - directions.cos_o) * (1 - directions.cos_i)
        return self.reflectance * (INV_PI * rim * rim)

    def pdf(self, directions):
        """Return the density of `sample`, ``(N,)``; 0 below the horizon."""
        return np.maximum(directions.cos_i_signed, 0) * INV_PI

    def sample(self, surface, u):
        """Return directions ``(3, N)`` about ``surface.n``, from `u` ``(2, N)``."""
        return normalise(surface.n + square_to_sphere(u))
