"""GGX: microfacets as they are mostly used today.

Trowbridge and Reitz's distribution of half vectors, ``D = 1 / (pi alpha_u alpha_v cos_h^4 (1 + q)^2)``, with q of
`dmis.roughness`, and Smith's masking and shadowing, correlated in height, ``G2 = 1 / (1 + L(wo) + L(wi))`` with
``L = (|w'| / cos - 1) / 2``, where w' is w with its tangential parts multiplied by alpha. Directions are sampled
through the half vectors that wo can see, which are distributed as ``D_wo = G1(wo) max(0, wo.h) D / cos_o``.

One bounce between facets is all there is: what would leave after two or more is missing, up to half of the light at
alpha 1.

Sources: Trowbridge and Reitz 1975; Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR
2007; Heitz, "Understanding the Masking-Shadowing Function", JCGT 3(2), 2014; Dupuy and Benyoub, "Sampling Visible GGX
Normals with Spherical Caps", HPG 2023.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.brdf import Fresnel, reflect
from dmis.pair import Frame, Pair
from dmis.roughness import Roughness
from dmis.vec import Array, dot, normalise
from dmis.warp import INV_PI, TWO_PI

_LEAST = np.float32(1e-12)


@dataclass(frozen=True, eq=False)
class TrowbridgeReitz:
    """The distribution without masking, for other models of facets; half vectors are sampled with ``D cos_h``."""

    roughness: Roughness

    def density(self, pair: Pair) -> Array:
        """D, ``(N,)``."""
        ratio = (1 + pair.tan2_h) / (1 + self.roughness.q(pair))
        return ratio * ratio * (INV_PI / self.roughness.area)

    def pdf_h(self, pair: Pair) -> Array:
        """Solid-angle density of `sample_h`, ``(N,)``."""
        return self.density(pair) * pair.cos_h

    def sample_h(self, surface: Frame, u: Array) -> Array:
        """Half vectors ``(3, N)``: slopes in polar coordinates, stretched by alpha; ``u0 = r^2 / (1 + r^2)``."""
        r = np.sqrt(u[0] / np.maximum(1 - u[0], _LEAST))
        phi = TWO_PI * u[1]
        s, t = self.roughness.axes(surface)
        return normalise(s * (r * np.cos(phi)) + t * (r * np.sin(phi)) + surface.n)


@dataclass(frozen=True, eq=False)
class GGX:
    """``f = R D G2 F / (4 cos_i cos_o)``, sampled through visible half vectors.

    ``f cos_i / pdf = R F G2 / G1`` is never more than R. Some of the directions fall below the horizon, so the pdf
    integrates to less than 1.
    """

    reflectance: Any
    roughness: Roughness
    fresnel: Fresnel | None = None

    def eval(self, pair: Pair) -> Array:
        """BRDF without the cosine, ``(1, N)`` or ``(3, N)``; 0 below the shading horizon."""
        o, i = self._stretched(pair, pair.surface.wo, pair.cos_o), self._stretched(pair, pair.wi, pair.cos_i)
        # G2 / (4 cos_i cos_o) without the division by cosines: L = (|w'| - cos) / (2 cos)
        out = (
            TrowbridgeReitz(self.roughness).density(pair)
            * pair.above
            / np.maximum(2 * (o * pair.cos_i + i * pair.cos_o), _LEAST)
        )
        if self.fresnel is not None:
            out = out * self.fresnel(pair.cos_d)
        return self.reflectance * out

    def pdf(self, pair: Pair) -> Array:
        """Density of `sample`: D_wo over ``4 wo.h``, ``(N,)``."""
        o = self._stretched(pair, pair.surface.wo, pair.cos_o)
        return TrowbridgeReitz(self.roughness).density(pair) * pair.above / np.maximum(2 * (pair.cos_o + o), _LEAST)

    def sample(self, surface: Frame, u: Array) -> Array:
        """Directions ``(3, N)``: wo mirrored at half vectors that it can see."""
        return reflect(surface, visible(self.roughness, surface, u))

    def _stretched(self, pair: Pair, w: Array, cos: Array) -> Array:
        return self.roughness.stretched(pair.surface, w, cos)


def visible(roughness: Roughness, surface: Frame, u: Array) -> Array:
    """Half vectors that wo can see, ``(3, N)``, on its side of the surface, whichever that is.

    Stretched by alpha, facets are a hemisphere. Light along the stretched wo is reflected by a hemisphere uniformly
    into the directions whose cosine is above ``-wo'_z``: so half vectors come from a uniform direction in that cap.
    """
    s, t = roughness.axes(surface)
    v = normalise(np.stack([dot(s, surface.wo), dot(t, surface.wo), np.abs(surface.cos_o)]))
    below = u[0] * (1 + v[2])  # 1 - z of the direction in the cap
    r = np.sqrt(np.maximum(below * (2 - below), 0))
    phi = TWO_PI * u[1]
    x, y, z = r * np.cos(phi) + v[0], r * np.sin(phi) + v[1], (1 - u[0]) * (1 + v[2])
    return normalise(s * x + t * y + surface.n * np.copysign(z, surface.cos_o))
