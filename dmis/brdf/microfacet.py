"""Microfacet reflection: Torrance–Sparrow with any distribution of half vectors, and GGX with visible normals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import TINY, Array, dot, normalise
from dmis.brdf.distributions import Distribution, HalfVectorLobe, Roughness, TrowbridgeReitz, reflect, stretched
from dmis.brdf.fresnel import Fresnel
from dmis.brdf.lobe import MIN_DIVISOR, ONE, Directions, Lobe, LocalFrame
from dmis.samplers.warp import TWO_PI


@dataclass(frozen=True, eq=False)
class Microfacet(HalfVectorLobe):
    """Torrance-Sparrow: ``f = R D G F / (4 cos_i cos_o)``, sampled through its half-vector distribution.

    Some sampled directions fall below the horizon, so the pdf integrates to less than 1 (to 0.6 for a Blinn
    exponent of 10 at 80 degrees). They count as samples of value zero.
    """

    reflectance: Any
    distribution: Distribution
    fresnel: Fresnel | None = None
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, directions: Directions) -> Array:
        # D G / (4 cos_i cos_o), with G = min(1, 2 cos_h min(cos_i, cos_o) / cos_d)
        smaller = np.minimum(directions.cos_i, directions.cos_o)
        shadowing = np.minimum(smaller * directions.cos_h * 2 / directions.cos_d, ONE)
        divisor = np.maximum(4 * directions.cos_i * directions.cos_o, TINY)
        out = self.distribution.density(directions) * shadowing / divisor
        if self.fresnel is not None:
            out = out * self.fresnel(directions.cos_d)
        return self.reflectance * out


@dataclass(frozen=True, eq=False)
class GGX(Lobe):
    """``f = R D G2 F / (4 cos_i cos_o)``, sampled through visible half vectors.

    ``f cos_i / pdf = R F G2 / G1`` is never more than R. Some of the directions fall below the horizon, so the pdf
    integrates to less than 1.
    """

    reflectance: Any
    roughness: Roughness
    fresnel: Fresnel | None = None
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, directions: Directions) -> Array:
        o, i = stretched(self.roughness, directions)
        # G2 / (4 cos_i cos_o) without the division by cosines: L = (|w'| - cos) / (2 cos)
        out = self._facets(directions) / np.maximum(2 * (o * directions.cos_i + i * directions.cos_o), MIN_DIVISOR)
        if self.fresnel is not None:
            out = out * self.fresnel(directions.cos_d)
        return self.reflectance * out

    def pdf(self, directions: Directions) -> Array:
        """Return the density of `sample`: D_wo over ``4 wo.h``, ``(N,)``."""
        o = self.roughness.stretched(directions.surface, directions.surface.wo, directions.cos_o)
        return self._facets(directions) / np.maximum(2 * (directions.cos_o + o), MIN_DIVISOR)

    def _facets(self, directions: Directions) -> Array:
        """Return D, 0 below the horizon, ``(N,)``."""
        return TrowbridgeReitz(self.roughness).density(directions) * directions.above

    def sample(self, surface: LocalFrame, u: Array) -> Array:
        return reflect(surface, visible_half_vectors(self.roughness, surface, u))


def visible_half_vectors(roughness: Roughness, surface: LocalFrame, u: Array) -> Array:
    """Sample half vectors that wo can see, ``(3, N)``, on its side of the surface.

    Stretched by alpha, facets are a hemisphere. Light along the stretched wo is reflected by a hemisphere uniformly
    into the directions whose cosine is above ``-wo'_z``: so half vectors come from a uniform direction in that cap.
    """
    s, t = roughness.axes(surface)
    v = normalise(np.stack([dot(s, surface.wo), dot(t, surface.wo), np.abs(surface.cos_o)]))
    below = u[0] * (1 + v[2])  # 1 - z of the direction in the cap
    r = np.sqrt(np.maximum(below * (2 - below), 0))
    phi = TWO_PI * u[1]
    x = r * np.cos(phi) + v[0]
    y = r * np.sin(phi) + v[1]
    z = (1 - u[0]) * (1 + v[2])
    return normalise(s * x + t * y + surface.n * np.copysign(z, surface.cos_o))
