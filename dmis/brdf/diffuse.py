"""Diffuse lobes: Lambert, of reflection and of transmission, and Oren–Nayar, sampled by the cosine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import TINY, Array, normalise
from dmis.brdf.cosines import Directions, LocalFrame
from dmis.brdf.lobe import Lobe
from dmis.samplers.warp import INV_PI, square_to_sphere


@dataclass(frozen=True, eq=False)
class Lambert(Lobe):
    """``f = reflectance / pi``, sampled with density cos/pi."""

    reflectance: Any
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, directions: Directions) -> Array:
        return self.reflectance * INV_PI

    def pdf(self, directions: Directions) -> Array:
        return np.maximum(directions.cos_i_signed, 0) * INV_PI

    def sample(self, surface: LocalFrame, u: Array) -> Array:
        """Sample directions with density ``cos/pi``: the unit sphere on the surface needs no frame."""
        return normalise(surface.n + square_to_sphere(u))

    def weight(self) -> Any:
        """Return the reflectance: the density is that of f with the cosine."""
        return self.reflectance


class CosineLobe(Lobe):
    """A lobe that is sampled by the cosine, as Lambert's is."""

    pdf = Lambert.pdf
    sample = Lambert.sample


@dataclass(frozen=True, eq=False)
class LambertTransmission(CosineLobe):
    """Light that comes through a thin sheet and leaves it evenly: ``f = transmittance / pi``, from either side."""

    transmittance: Any
    factor: ClassVar[str | None] = "transmittance"
    transmissive: ClassVar[bool] = True

    def eval(self, directions: Directions) -> Array:
        return self.transmittance * INV_PI

    def weight(self) -> Any:
        """Return the transmittance: the density is that of f with the cosine."""
        return self.transmittance

    def has_sides(self) -> bool:
        return False


@dataclass(frozen=True, eq=False)
class OrenNayar(CosineLobe):
    """Rough diffuse reflection (Oren and Nayar 1994, PBR 8.4.1), `sigma` in degrees; sampled like `Lambert`."""

    reflectance: Any
    sigma: float
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, directions: Directions) -> Array:
        s2 = np.radians(self.sigma) ** 2
        a, b = np.float32(1 - s2 / (2 * (s2 + 0.33))), np.float32(0.45 * s2 / (s2 + 0.09))
        # max(0, cos(phi_i - phi_o)) sin(alpha) tan(beta), with no azimuth: the sines cancel against the cosine's
        across = np.maximum(directions.cos_io - directions.cos_i_signed * directions.cos_o, 0)
        larger = np.maximum(np.maximum(directions.cos_i, directions.cos_o), TINY)
        return self.reflectance * (INV_PI * (a + b * across / larger))
