"""How facets are spread: roughness alpha, equal in all directions or not, and Beckmann's distribution of half vectors.

Both of today's distributions of slopes, Beckmann's (Gaussian) and that of Trowbridge and Reitz (GGX, `dmis.ggx`), have
elliptic contours, so they know a half vector h only by its slopes over alpha, ``q = (h_u / (alpha_u h_n))^2 +
(h_v / (alpha_v h_n))^2``, and all that differs between isotropic and anisotropic surfaces is here. Isotropic ones
need no tangents to be evaluated.

Source: Beckmann and Spizzichino 1963; Heitz, "Understanding the Masking-Shadowing Function", JCGT 3(2), 2014.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.pair import Frame, Pair
from dmis.vec import TINY, Array, dot, frame, normalise
from dmis.warp import INV_PI, TWO_PI

LEAST_ALPHA = 1e-4
"""Least roughness that float32 directions resolve: their rounding is 1e-3 of its slopes."""
_LEAST = np.float32(1e-12)


@dataclass(frozen=True, eq=False)
class Isotropic:
    """The same roughness `alpha` in all directions."""

    alpha: Any

    @property
    def area(self) -> Any:
        """``alpha_u alpha_v``."""
        return self.alpha * self.alpha

    def q(self, pair: Pair) -> Array:
        """Squared slope of the half vector over alpha."""
        return pair.tan2_h / self.area

    def stretched(self, surface: Frame, w: Array, cos: Array) -> Array:
        """Length of the unit vector `w`, whose cosine is `cos`, with its tangential parts multiplied by alpha."""
        return np.sqrt(self.area * np.maximum(1 - cos * cos, 0) + cos * cos)

    def axes(self, surface: Frame) -> tuple[Array, Array]:
        """Two orthogonal tangents, as long as the roughness along them, each ``(3, N)``."""
        s, t = frame(surface.n)
        return s * self.alpha, t * self.alpha


@dataclass(frozen=True, eq=False)
class Elliptic:
    """Roughness `alpha_u` along the surface's first tangent, `alpha_v` along the second."""

    alpha_u: Any
    alpha_v: Any

    @property
    def area(self) -> Any:
        """``alpha_u alpha_v``."""
        return self.alpha_u * self.alpha_v

    def q(self, pair: Pair) -> Array:
        """Squared slope of the half vector over alpha."""
        s, t = pair.surface.tangents
        h = pair.surface.wo + pair.wi
        x, y = dot(s, h) / self.alpha_u, dot(t, h) / self.alpha_v
        normal = pair.cos_i_signed + pair.cos_o
        return (x * x + y * y) / np.maximum(normal * normal, _LEAST)

    def stretched(self, surface: Frame, w: Array, cos: Array) -> Array:
        """Length of the unit vector `w`, whose cosine is `cos`, with its tangential parts multiplied by alpha."""
        s, t = self.axes(surface)
        x, y = dot(s, w), dot(t, w)
        return np.sqrt(x * x + y * y + cos * cos)

    def axes(self, surface: Frame) -> tuple[Array, Array]:
        """Two orthogonal tangents, as long as the roughness along them, each ``(3, N)``."""
        s, t = surface.tangents
        return s * self.alpha_u, t * self.alpha_v


Roughness = Isotropic | Elliptic


@dataclass(frozen=True, eq=False)
class Beckmann:
    """Gaussian slopes, ``D = exp(-q) / (pi alpha_u alpha_v cos_h^4)``; half vectors are sampled with ``D cos_h``."""

    roughness: Roughness

    def density(self, pair: Pair) -> Array:
        """D, ``(N,)``."""
        secant2 = 1 + pair.tan2_h
        return np.exp(-self.roughness.q(pair)) * (secant2 * secant2) * (INV_PI / self.roughness.area)

    def pdf_h(self, pair: Pair) -> Array:
        """Solid-angle density of `sample_h`, ``(N,)``."""
        return self.density(pair) * pair.cos_h

    def sample_h(self, surface: Frame, u: Array) -> Array:
        """Half vectors ``(3, N)``: a normal deviate of slopes in polar coordinates, stretched by alpha."""
        r = np.sqrt(-np.log(np.maximum(1 - u[0], TINY)))
        phi = TWO_PI * u[1]
        s, t = self.roughness.axes(surface)
        return normalise(s * (r * np.cos(phi)) + t * (r * np.sin(phi)) + surface.n)
