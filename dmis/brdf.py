"""BRDF lobes: ``eval``, ``pdf`` and ``sample`` for batches of surface points.

A lobe is plain data. In a scene its parameters are numbers, RGB triples or textures; bound to a batch
(`dmis.scene.Group.bind`) they are float32 arrays ``()``, ``(3, 1)``, ``(N,)`` or ``(3, N)``, and the methods
broadcast over them. All methods take uniform numbers as arguments.

Conventions: ``wo`` and ``wi`` point away from the surface; the shading normal ``n`` is on the side of ``wo``;
pdfs are per solid angle; ``eval`` leaves the cosine out. Isotropic lobes need only cosines (`dmis.pair`), so no
tangent frame is ever built to evaluate them. ``eval`` is symmetric in the side of ``wi`` (it uses \\|cos\\|, as pbrt
does where shading and geometric normals disagree), ``pdf`` is 0 below the shading horizon.

Sources: Lambert; Oren and Nayar 1994; Torrance and Sparrow 1967 with Blinn's distribution (1977); Ashikhmin and
Shirley 2000 (anisotropic lobe, diffuse base under a glossy coat). The forms are those of Pharr and Humphreys,
"Physically Based Rendering", 2nd edition, chapters 8 and 14.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from dmis.pair import ONE, Frame, Pair
from dmis.vec import TINY, Array, dot, normalise
from dmis.warp import INV_PI, TWO_PI, square_to_power, square_to_sphere, to_world

# Fresnel ----------------------------------------------------------------------------------------------------------


def dielectric(cos: Array, eta: Array | np.float32) -> Array:
    """Unpolarised Fresnel reflectance at relative index `eta`, exact; total internal reflection gives 1."""
    sin2_t = (1 - cos * cos) / (eta * eta)
    cos_t = np.sqrt(np.maximum(1 - sin2_t, 0))
    a = (eta * cos - cos_t) / (eta * cos + cos_t + TINY)
    b = (cos - eta * cos_t) / (cos + eta * cos_t + TINY)
    return np.maximum((a * a + b * b) / 2, sin2_t >= 1)


@dataclass(frozen=True)
class Dielectric:
    """Fresnel reflectance of a surface whose index, inside over outside, is `eta`."""

    eta: float = 1.5

    def __call__(self, cos: Array) -> Array:
        return dielectric(cos, np.float32(self.eta))


@dataclass(frozen=True)
class Coat:
    """Fresnel reflectance of a coat of index `eta`: from outside, whichever side of the mesh that is."""

    eta: float = 1.5

    def __call__(self, cos: Array) -> Array:
        return dielectric(cos, np.float32(self.eta))


@dataclass(frozen=True)
class Conductor:
    """Fresnel reflectance of a metal, the approximate form of PBR 8.2.1.

    Index `eta` and absorption `k` are RGB triples; bound to points, ``(1 or 3, N)``.
    """

    eta: Any
    k: Any

    def __call__(self, cos: Array) -> Array:
        eta, k = per_point(self.eta), per_point(self.k)
        a = eta * eta + k * k
        cos2, twice = cos * cos, 2 * eta * cos
        parallel_base = a * cos2 + 1
        perp_base = a + cos2
        return ((parallel_base - twice) / (parallel_base + twice) + (perp_base - twice) / (perp_base + twice)) / 2


Fresnel = Dielectric | Coat | Conductor


def per_point(colour: Any) -> Array:
    """A triple as ``(3, 1)``; what is bound to points as it is, ``(1 or 3, N)``."""
    values = np.asarray(colour, np.float32)
    return values[:, None] if values.ndim == 1 else values


# Distributions of half vectors --------------------------------------------------------------------------------------


class Distribution(Protocol):
    """Half vectors of microfacets: D with ``int D cos_h = 1``; how they are sampled, and its solid-angle density."""

    def density(self, pair: Pair) -> Array: ...

    def pdf_h(self, pair: Pair) -> Array: ...

    def sample_h(self, surface: Frame, u: Array) -> Array: ...


@dataclass(frozen=True, eq=False)
class Blinn:
    """Blinn's distribution, ``D = (e+2)/(2 pi) cos_h^e``; pbrt's roughness is ``1/e``."""

    exponent: Any

    def density(self, pair: Pair) -> Array:
        e = self.exponent
        return (e + 2) / TWO_PI * pair.power_h(e)

    def pdf_h(self, pair: Pair) -> Array:
        return (self.exponent + 1) * pair.power_h(self.exponent) / TWO_PI

    def sample_h(self, surface: Frame, u: Array) -> Array:
        return to_world(square_to_power(u, self.exponent), surface.n)


@dataclass(frozen=True, eq=False)
class Anisotropic:
    """Ashikhmin and Shirley's distribution, exponents `u` and `v` along the two tangents."""

    u: Any
    v: Any

    def density(self, pair: Pair) -> Array:
        return np.sqrt((self.u + 2) * (self.v + 2)) / TWO_PI * self._lobe(pair)

    def pdf_h(self, pair: Pair) -> Array:
        return np.sqrt((self.u + 1) * (self.v + 1)) / TWO_PI * self._lobe(pair)

    def sample_h(self, surface: Frame, u: Array) -> Array:
        phi = TWO_PI * u[0]  # one angle for all four quadrants: tan(phi') = sqrt((u+1)/(v+1)) tan(phi)
        x, y = np.sqrt(self.v + 1) * np.cos(phi), np.sqrt(self.u + 1) * np.sin(phi)
        r = 1 / np.sqrt(np.maximum(x * x + y * y, TINY))
        x, y = x * r, y * r
        log_cos = np.log(np.maximum(1 - u[1], TINY)) / (self.u * x * x + self.v * y * y + 1)
        cos, sin = np.exp(log_cos), np.sqrt(-np.expm1(2 * log_cos))
        s, t = surface.tangents
        return s * (sin * x) + t * (sin * y) + surface.n * cos

    def _lobe(self, pair: Pair) -> Array:
        x, y = pair.half
        x2, y2 = x * x, y * y
        return pair.power_h((self.u * x2 + self.v * y2) / np.maximum(x2 + y2, TINY))


# Lobes --------------------------------------------------------------------------------------------------------------


def cosine_pdf(pair: Pair) -> Array:
    """Density of `cosine_sample`, ``(N,)``."""
    return np.maximum(pair.cos_i_signed, 0) * INV_PI


def cosine_sample(surface: Frame, u: Array) -> Array:
    """A point on the unit sphere that touches the surface: no tangent frame is needed."""
    return normalise(surface.n + square_to_sphere(u))


def half_vector_pdf(distribution: Distribution, pair: Pair) -> Array:
    """Density of wi = reflect(wo, h): dh/dwi = 1/(4 wo.h)."""
    return distribution.pdf_h(pair) / (4 * pair.cos_d) * pair.above


def half_vector_sample(distribution: Distribution, surface: Frame, u: Array) -> Array:
    """wi = reflect(wo, h), ``(3, N)``; some of them below the horizon."""
    return reflect(surface, distribution.sample_h(surface, u))


def reflect(surface: Frame, h: Array) -> Array:
    """wo mirrored at the half vectors `h`, ``(3, N)``."""
    return h * (2 * dot(surface.wo, h)) - surface.wo


@dataclass(frozen=True, eq=False)
class Lambert:
    """``f = reflectance / pi``, sampled with density cos/pi."""

    reflectance: Any

    def eval(self, pair: Pair) -> Array:
        return self.reflectance * INV_PI

    def pdf(self, pair: Pair) -> Array:
        return cosine_pdf(pair)

    def sample(self, surface: Frame, u: Array) -> Array:
        return cosine_sample(surface, u)


@dataclass(frozen=True, eq=False)
class OrenNayar:
    """Rough diffuse reflection (Oren and Nayar 1994, PBR 8.4.1), `sigma` in degrees; sampled like `Lambert`."""

    reflectance: Any
    sigma: float

    def eval(self, pair: Pair) -> Array:
        s2 = np.radians(self.sigma) ** 2
        a, b = np.float32(1 - s2 / (2 * (s2 + 0.33))), np.float32(0.45 * s2 / (s2 + 0.09))
        # max(0, cos(phi_i - phi_o)) sin(alpha) tan(beta), with no azimuth: the sines cancel against the cosine's
        across = np.maximum(pair.cos_io - pair.cos_i_signed * pair.cos_o, 0)
        return self.reflectance * (INV_PI * (a + b * across / np.maximum(np.maximum(pair.cos_i, pair.cos_o), TINY)))

    def pdf(self, pair: Pair) -> Array:
        return cosine_pdf(pair)

    def sample(self, surface: Frame, u: Array) -> Array:
        return cosine_sample(surface, u)


@dataclass(frozen=True, eq=False)
class Microfacet:
    """Torrance-Sparrow: ``f = R D G F / (4 cos_i cos_o)``, sampled through its half-vector distribution.

    Some sampled directions fall below the horizon, so the pdf integrates to less than 1 (to 0.6 for a Blinn
    exponent of 10 at 80 degrees). They count as samples of value zero.
    """

    reflectance: Any
    distribution: Distribution
    fresnel: Fresnel | None = None

    def eval(self, pair: Pair) -> Array:
        # D G / (4 cos_i cos_o), with G = min(1, 2 cos_h min(cos_i, cos_o) / cos_d)
        shadowing = np.minimum(np.minimum(pair.cos_i, pair.cos_o) * pair.cos_h * 2 / pair.cos_d, ONE)
        out = self.distribution.density(pair) * shadowing / np.maximum(4 * pair.cos_i * pair.cos_o, TINY)
        if self.fresnel is not None:
            out = out * self.fresnel(pair.cos_d)
        return self.reflectance * out

    def pdf(self, pair: Pair) -> Array:
        return half_vector_pdf(self.distribution, pair)

    def sample(self, surface: Frame, u: Array) -> Array:
        return half_vector_sample(self.distribution, surface, u)


@dataclass(frozen=True, eq=False)
class BlendBase:
    """The diffuse half of Ashikhmin and Shirley's Fresnel blend (PBR 8.5), dimmed by the coat above it."""

    diffuse: Any
    specular: Any

    def eval(self, pair: Pair) -> Array:
        through = (1 - fifth(1 - pair.cos_i / 2)) * (1 - fifth(1 - pair.cos_o / 2))
        return self.diffuse * (1 - self.specular) * (np.float32(28 / 23) * INV_PI * through)

    def pdf(self, pair: Pair) -> Array:
        return cosine_pdf(pair)

    def sample(self, surface: Frame, u: Array) -> Array:
        return cosine_sample(surface, u)


@dataclass(frozen=True, eq=False)
class BlendCoat:
    """The glossy half of Ashikhmin and Shirley's Fresnel blend (PBR 8.5), with Schlick's Fresnel."""

    specular: Any
    distribution: Distribution

    def eval(self, pair: Pair) -> Array:
        schlick = self.specular + fifth(1 - pair.cos_d) * (1 - self.specular)
        coat = self.distribution.density(pair)
        return schlick * (coat / np.maximum(4 * pair.cos_d * np.maximum(pair.cos_i, pair.cos_o), TINY))

    def pdf(self, pair: Pair) -> Array:
        return half_vector_pdf(self.distribution, pair)

    def sample(self, surface: Frame, u: Array) -> Array:
        return half_vector_sample(self.distribution, surface, u)


@dataclass(frozen=True, eq=False)
class SpecularReflection:
    """A perfect mirror. A delta lobe: it has no pdf, never enters MIS, and is followed as a ray of its own."""

    reflectance: Any
    fresnel: Fresnel | None = None

    def scatter(self, surface: Frame) -> tuple[Array, Array]:
        """Direction ``(3, N)`` and the factor (BRDF times cosine over probability) ``(3, N)`` or ``(3, 1)``."""
        wi = surface.n * (2 * surface.cos_o) - surface.wo
        if self.fresnel is None:
            return wi, self.reflectance
        if isinstance(self.fresnel, Dielectric):
            return wi, self.reflectance * dielectric(surface.cos_o, index(self.fresnel.eta, surface.outside))
        return wi, self.reflectance * self.fresnel(surface.cos_o)


@dataclass(frozen=True, eq=False)
class SpecularTransmission:
    """Perfect refraction into a medium of relative index `eta`, a delta lobe.

    `eta` is inside over outside; ``surface.outside`` tells on which side wo is. Radiance is scaled by 1/eta^2, as
    physics has it, unless `scaled` is False, as in pbrt-v2: then it is the same on both sides.
    """

    transmittance: Any
    eta: float = 1.5
    scaled: bool = True

    def scatter(self, surface: Frame) -> tuple[Array, Array]:
        """Direction ``(3, N)`` and factor ``(3, N)``; total internal reflection gives factor 0."""
        eta = index(self.eta, surface.outside)
        cos_o, ratio = surface.cos_o, 1 / eta
        cos_t = np.sqrt(np.maximum(1 - (1 - cos_o * cos_o) * ratio * ratio, 0))
        wi = surface.n * (ratio * cos_o - cos_t) - surface.wo * ratio
        passed = 1 - dielectric(cos_o, eta)
        return wi, self.transmittance * (passed * ratio * ratio if self.scaled else passed)


def index(eta: float, outside: Array) -> Array:
    """Index of refraction beyond the surface over index on wo's side."""
    return np.where(outside, np.float32(eta), np.float32(1 / eta))


class Glossy(Protocol):
    """Lobes that are functions, and take part in MIS: any frozen dataclass with these methods."""

    def eval(self, pair: Pair) -> Array: ...

    def pdf(self, pair: Pair) -> Array: ...

    def sample(self, surface: Frame, u: Array) -> Array: ...


Delta = SpecularReflection | SpecularTransmission
"""Lobes that are Dirac deltas."""
Lobe = Glossy | Delta


def fifth(x: Array) -> Array:
    """``x^5``, of Schlick's Fresnel."""
    x2 = x * x
    return x2 * x2 * x
