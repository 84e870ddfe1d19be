"""A light of one's own: a square lamp with bright and dark squares, which shines downwards.

``lamp = Checks(2.0)`` goes into the lights of a scene, and ``dmis.light_part(lamp)`` into its parts, if the camera
should see it.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dmis.geometry.shapes import quad
from dmis.light.light import AreaLight
from dmis.light.light_sample import LightSample


@dataclass(frozen=True, eq=False)
class Checks(AreaLight):
    height: float
    textured: ClassVar = True

    def emission(self, p):
        return np.where(p[:1] * p[1:2] > 0, np.float32(8), np.float32(1)) * np.ones((3, 1), np.float32)

    def brightness(self, length):
        return 8.0

    def mesh(self):
        # (0, 2, 0) x (2, 0, 0) points downwards
        return quad((-1, -1, self.height), (0, 2, 0), (2, 0, 0))

    def sample(self, p, u):
        to = np.stack([2 * u[0] - 1, 2 * u[1] - 1, np.full_like(u[0], self.height)]) - p
        return self.hit(p, to / np.sqrt((to * to).sum(axis=0)))

    def hit(self, p, wi):
        distance = (np.float32(self.height) - p[2]) / np.where(wi[2] == 0, np.float32(1e-12), wi[2])
        x = p + wi * distance
        inside = (distance > 0) & (np.abs(x[:2]) <= 1).all(axis=0)
        # uniform point: r^2 / (A cos), A = 4
        pdf = np.where(
            inside,
            distance * distance / (4 * np.maximum(np.abs(wi[2]), np.float32(1e-12))),
            np.float32(0),
        )
        return LightSample(wi, distance, self.emission(x), pdf, inside & (wi[2] > 0))
