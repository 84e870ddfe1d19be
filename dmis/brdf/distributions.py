"""Distributions of microfacet normals, and sampling of half vectors from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import TINY, Array, dot, frame, normalise
from dmis.brdf.lobe import MIN_DIVISOR, Directions, Lobe, LocalFrame, Parameters
from dmis.samplers.warp import INV_PI, TWO_PI, square_to_power, to_world


class Distribution(Parameters):
    """Half vectors of microfacets: D with ``int D cos_h = 1``; how they are sampled, and its solid-angle density."""

    def density(self, directions: Directions) -> Array:
        """Return D, ``(N,)``."""
        raise NotImplementedError

    def pdf_h(self, directions: Directions) -> Array:
        """Return the solid-angle density of `sample_h`, ``(N,)``."""
        raise NotImplementedError

    def sample_h(self, surface: LocalFrame, u: Array) -> Array:
        """Sample half vectors ``(3, N)`` with uniform numbers `u` ``(2, N)``."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Blinn(Distribution):
    """Blinn's distribution, ``D = (e+2)/(2 pi) cos_h^e``; pbrt's roughness is ``1/e``."""

    exponent: Any
    scalars: ClassVar[tuple[str, ...]] = ("exponent",)

    def density(self, directions: Directions) -> Array:
        return (self.exponent + 2) / TWO_PI * directions.power_h(self.exponent)

    def pdf_h(self, directions: Directions) -> Array:
        return (self.exponent + 1) * directions.power_h(self.exponent) / TWO_PI

    def sample_h(self, surface: LocalFrame, u: Array) -> Array:
        return to_world(square_to_power(u, self.exponent), surface.n)


@dataclass(frozen=True, eq=False)
class Anisotropic(Distribution):
    """Ashikhmin and Shirley's distribution, exponents `u` and `v` along the two tangents."""

    u: Any
    v: Any
    scalars: ClassVar[tuple[str, ...]] = ("u", "v")
    anisotropic: ClassVar[bool] = True

    def density(self, directions: Directions) -> Array:
        return np.sqrt((self.u + 2) * (self.v + 2)) / TWO_PI * self._lobe(directions)

    def pdf_h(self, directions: Directions) -> Array:
        return np.sqrt((self.u + 1) * (self.v + 1)) / TWO_PI * self._lobe(directions)

    def sample_h(self, surface: LocalFrame, u: Array) -> Array:
        phi = TWO_PI * u[0]  # one angle for all four quadrants: tan(phi') = sqrt((u+1)/(v+1)) tan(phi)
        x = np.sqrt(self.v + 1) * np.cos(phi)
        y = np.sqrt(self.u + 1) * np.sin(phi)
        r = 1 / np.sqrt(np.maximum(x * x + y * y, TINY))
        x, y = x * r, y * r
        log_cos = np.log(np.maximum(1 - u[1], TINY)) / (self.u * x * x + self.v * y * y + 1)
        cos = np.exp(log_cos)
        sin = np.sqrt(-np.expm1(2 * log_cos))
        s, t = surface.tangents
        return s * (sin * x) + t * (sin * y) + surface.n * cos

    def _lobe(self, directions: Directions) -> Array:
        x, y = directions.half
        x2, y2 = x * x, y * y
        return directions.power_h((self.u * x2 + self.v * y2) / np.maximum(x2 + y2, TINY))


class HalfVectorLobe(Lobe):
    """A lobe that is sampled through the half vectors of its `distribution`."""

    distribution: Any

    def pdf(self, directions: Directions) -> Array:
        # wi = reflect(wo, h): dh/dwi = 1 / (4 wo.h)
        return self.distribution.pdf_h(directions) / (4 * directions.cos_d) * directions.above

    def sample(self, surface: LocalFrame, u: Array) -> Array:
        """Sample wo mirrored at half vectors, ``(3, N)``; some directions are below the horizon."""
        return reflect(surface, self.distribution.sample_h(surface, u))


def reflect(surface: LocalFrame, h: Array) -> Array:
    """Return wo mirrored at the half vectors `h`, ``(3, N)``."""
    return h * (2 * dot(surface.wo, h)) - surface.wo


def stretched(roughness: Roughness, directions: Directions) -> tuple[Array, Array]:
    """Return the lengths of wo and wi, their tangential parts multiplied by alpha, ``(N,)`` each."""
    o = roughness.stretched(directions.surface, directions.surface.wo, directions.cos_o)
    return o, roughness.stretched(directions.surface, directions.wi, directions.cos_i)


MIN_ALPHA = 1e-4
"""Smallest roughness that float32 directions resolve: their rounding is 1e-3 of its slopes."""


@dataclass(frozen=True, eq=False)
class Isotropic(Parameters):
    """Distribution with one roughness `alpha` in all directions."""

    alpha: Any
    scalars: ClassVar[tuple[str, ...]] = ("alpha",)

    @property
    def area(self) -> Any:
        """``alpha_u alpha_v``."""
        return self.alpha * self.alpha

    def q(self, directions: Directions) -> Array:
        """Return the squared slope of the half vector over alpha."""
        return directions.tan2_h / self.area

    def stretched(self, surface: LocalFrame, w: Array, cos: Array) -> Array:
        """Return the length of the unit vector `w` of cosine `cos`, its tangential parts multiplied by alpha."""
        return np.sqrt(self.area * np.maximum(1 - cos * cos, 0) + cos * cos)

    def axes(self, surface: LocalFrame) -> tuple[Array, Array]:
        """Return two orthogonal tangents, as long as the roughness along them, each ``(3, N)``."""
        s, t = frame(surface.n)
        return s * self.alpha, t * self.alpha


@dataclass(frozen=True, eq=False)
class Elliptic(Parameters):
    """Roughness `alpha_u` along the surface's first tangent, `alpha_v` along the second."""

    alpha_u: Any
    alpha_v: Any
    scalars: ClassVar[tuple[str, ...]] = ("alpha_u", "alpha_v")
    anisotropic: ClassVar[bool] = True

    @property
    def area(self) -> Any:
        """``alpha_u alpha_v``."""
        return self.alpha_u * self.alpha_v

    def q(self, directions: Directions) -> Array:
        """Return the squared slope of the half vector over alpha."""
        s, t = directions.surface.tangents
        h = directions.surface.wo + directions.wi
        x = dot(s, h) / self.alpha_u
        y = dot(t, h) / self.alpha_v
        normal = directions.cos_i_signed + directions.cos_o
        return (x * x + y * y) / np.maximum(normal * normal, MIN_DIVISOR)

    def stretched(self, surface: LocalFrame, w: Array, cos: Array) -> Array:
        """Return the length of the unit vector `w` of cosine `cos`, its tangential parts multiplied by alpha."""
        s, t = self.axes(surface)
        x, y = dot(s, w), dot(t, w)
        return np.sqrt(x * x + y * y + cos * cos)

    def axes(self, surface: LocalFrame) -> tuple[Array, Array]:
        """Return two orthogonal tangents, as long as the roughness along them, each ``(3, N)``."""
        s, t = surface.tangents
        return s * self.alpha_u, t * self.alpha_v


Roughness = Isotropic | Elliptic


@dataclass(frozen=True, eq=False)
class Slopes(Distribution):
    """A distribution of slopes that `roughness` stretches; half vectors are sampled with ``D cos_h``."""

    roughness: Roughness

    def pdf_h(self, directions: Directions) -> Array:
        return self.density(directions) * directions.cos_h

    def sample_h(self, surface: LocalFrame, u: Array) -> Array:
        """Sample half vectors ``(3, N)``: slopes in polar coordinates, stretched by alpha."""
        r = self._radius(u[0])
        phi = TWO_PI * u[1]
        s, t = self.roughness.axes(surface)
        return normalise(s * (r * np.cos(phi)) + t * (r * np.sin(phi)) + surface.n)

    def _radius(self, u: Array) -> Array:
        """Return slopes over alpha whose distribution function is `u`, ``(N,)``."""
        raise NotImplementedError


class TrowbridgeReitz(Slopes):
    """The distribution without masking: ``D = (1 + tan^2)^2 / (pi alpha_u alpha_v (1 + q)^2)``."""

    def density(self, directions: Directions) -> Array:
        ratio = (1 + directions.tan2_h) / (1 + self.roughness.q(directions))
        return ratio * ratio * (INV_PI / self.roughness.area)

    def _radius(self, u: Array) -> Array:
        return np.sqrt(u / np.maximum(1 - u, MIN_DIVISOR))  # u = r^2 / (1 + r^2)


class Beckmann(Slopes):
    """Gaussian slopes, ``D = exp(-q) / (pi alpha_u alpha_v cos_h^4)``."""

    def density(self, directions: Directions) -> Array:
        secant2 = 1 + directions.tan2_h
        return np.exp(-self.roughness.q(directions)) * (secant2 * secant2) * (INV_PI / self.roughness.area)

    def _radius(self, u: Array) -> Array:
        return np.sqrt(-np.log(np.maximum(1 - u, TINY)))  # u = 1 - exp(-r^2)
