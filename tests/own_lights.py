"""Lights as a user would write them: a sky and an area light with emission of their own."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import dmis
from dmis.base.vectors import Array, normalise
from dmis.geometry.shapes import quad
from dmis.light.light import AreaLight, InfiniteLight
from dmis.light.light_sample import INFINITE_DISTANCE, LightSample
from dmis.samplers.warp import square_to_sphere


@dataclass(frozen=True, eq=False)
class HalfSky(InfiniteLight):
    """Radiance 2 from above the plane x = 0, and 1 from below; sampled uniformly."""

    def radiance(self, wi: Array) -> Array:
        return np.where(wi[[0, 0, 0]] > 0, np.float32(2), np.float32(1))

    def sample(self, p: Array, u: Array) -> LightSample:
        return self.hit(p, square_to_sphere(u))

    def hit(self, p: Array, wi: Array) -> LightSample:
        n = wi.shape[1]
        pdf = np.full(n, 1 / (4 * np.pi), np.float32)
        return LightSample(wi, np.full(n, INFINITE_DISTANCE), self.radiance(wi), pdf, np.ones(n, bool))


@dataclass(frozen=True, eq=False)
class Panel(AreaLight):
    """A square that shines downwards from a height, brighter where x > 0."""

    height: float = 2.0
    textured: ClassVar[bool] = True

    def emission(self, p: Array) -> Array:
        return np.where(p[[0, 0, 0]] > 0, np.float32(8), np.float32(1))

    def brightness(self, length: float) -> float:
        return 8.0

    def mesh(self) -> dmis.Mesh:
        return quad((-1, -1, self.height), (0, 2, 0), (2, 0, 0))

    def sample(self, p: Array, u: Array) -> LightSample:
        to = np.stack([2 * u[0] - 1, 2 * u[1] - 1, np.full_like(u[0], self.height)]) - p
        return self.hit(p, normalise(to))

    def hit(self, p: Array, wi: Array) -> LightSample:
        distance = (np.float32(self.height) - p[2]) / np.where(wi[2] == 0, np.float32(1e-12), wi[2])
        x = p + wi * distance
        inside = (distance > 0) & (np.abs(x[:2]) <= 1).all(axis=0)
        pdf = np.where(inside, distance * distance / (4 * np.maximum(np.abs(wi[2]), np.float32(1e-12))), np.float32(0))
        return LightSample(wi, distance, self.emission(x), pdf, inside & (wi[2] > 0))
