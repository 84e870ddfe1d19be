"""Solution of exercise 20: (1 - cos) / pi, one of the two factors of the BRDF.

Its distribution function in c = cos is 1 - (1 - c)^2. The ratio f cos / p is then in
proportion to c (1 - c), with a relative variance of 0.2. The density 3 (1 - c)^2 / (2
pi), in proportion to the whole BRDF, is worse: its ratio is in proportion to c, and the
relative variance is 0.6, three times as large.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dmis.brdf.lobe import Lobe
from dmis.samplers.warp import INV_PI, to_world


@dataclass(frozen=True, eq=False)
class Velvet(Lobe):
    """Brighter where the view grazes."""

    reflectance: float
    colours: ClassVar = ("reflectance",)

    def eval(self, directions):
        """Return the BRDF without the cosine, ``(1, N)`` or ``(3, N)``."""
        rim = (1 - directions.cos_o) * (1 - directions.cos_i)
        return self.reflectance * (INV_PI * rim * rim)

    def pdf(self, directions):
        """Return the density of `sample`, ``(N,)``; 0 below the horizon."""
        cos = directions.cos_i_signed
        return np.where(cos > 0, INV_PI * (1 - cos), 0)

    def sample(self, surface, u):
        """Return directions ``(3, N)`` about ``surface.n``, from `u` ``(2, N)``."""
        cos = 1 - np.sqrt(u[0])
        sin, phi = np.sqrt(np.maximum(1 - cos * cos, 0)), np.float32(2 * np.pi) * u[1]
        return to_world(
            np.stack([sin * np.cos(phi), sin * np.sin(phi), cos]), surface.n
        )
