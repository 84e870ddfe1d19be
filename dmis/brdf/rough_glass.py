"""Rough glass: facets of the distribution of Trowbridge and Reitz that reflect light, or let it through.

A facet's normal h divides the light by Fresnel's equations: it mirrors wo, or refracts it by Snell's law. With the
index eta beyond the surface, relative to wo's side, light comes through from wi where ``h ~ wo + eta wi``. D, G2 and
the sampling of half vectors that wo can see are those of `dmis.brdf.microfacet.GGX`. Radiance that comes through is
scaled by ``1/eta^2``, as in a smooth surface (`dmis.brdf.specular.SpecularTransmission`).

Light is scattered by one facet only, as in `dmis.brdf.microfacet.GGX`.

Source: Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007, with Smith's masking
correlated in height for both directions, as in pbrt-v3 and v4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import Array, dot
from dmis.brdf.distributions import Roughness, TrowbridgeReitz, stretched
from dmis.brdf.fresnel import Dielectric, dielectric, relative_ior
from dmis.brdf.lobe import MIN_DIVISOR, Directions, Lobe, LocalFrame
from dmis.brdf.microfacet import GGX, visible_half_vectors


@dataclass(frozen=True, eq=False)
class RoughReflection(GGX):
    """Reflection by the facets: `dmis.brdf.microfacet.GGX` with Fresnel's reflectance of the side that wo is on."""

    fresnel: Dielectric

    def eval(self, directions: Directions) -> Array:
        facets = GGX(self.reflectance, self.roughness).eval(directions)
        return facets * self.fresnel.on_side(directions.cos_d, directions.surface.outside)

    def has_sides(self) -> bool:
        return True


@dataclass(frozen=True, eq=False)
class RoughTransmission(Lobe):
    """Transmission through the facets; its surface's normal is on the side of wi, that of wo is beyond it.

    ``f = T (1 - F) D G2 |wo.h| |wi.h| / (cos_i cos_o (wo.h + eta wi.h)^2)`` with F at ``wo.h``. The weight
    ``f cos_i / pdf = T (1 - F) G2 / G1 / eta^2``. Half vectors that reflect totally have no direction beyond, so the
    pdf integrates to less than 1.
    """

    transmittance: Any
    roughness: Roughness
    eta: float
    factor: ClassVar[str | None] = "transmittance"
    transmissive: ClassVar[bool] = True

    def eval(self, directions: Directions) -> Array:
        eta, transmitted, cos = self._refracted(directions)
        o, i = stretched(self.roughness, directions)
        # G2 / (cos_i cos_o), and cos_o < 0
        masked = 2 / np.maximum(o * directions.cos_i - i * directions.cos_o, MIN_DIVISOR)
        return self.transmittance * (transmitted * masked * (1 - dielectric(cos, eta)))

    def pdf(self, directions: Directions) -> Array:
        """Return the density of `sample`, ``(N,)``: D_wo times ``dh/dwi = eta^2 |wi.h| / (wo.h + eta wi.h)^2``."""
        eta, transmitted, _ = self._refracted(directions)
        o = self.roughness.stretched(directions.surface, directions.surface.wo, directions.cos_o)
        return transmitted * (2 * eta * eta) / np.maximum(o - directions.cos_o, MIN_DIVISOR)

    def sample(self, surface: LocalFrame, u: Array) -> Array:
        """Sample directions ``(3, N)``; wo itself, which is not beyond, where light is totally reflected."""
        h = visible_half_vectors(self.roughness, surface, u)
        ratio = 1 / relative_ior(self.eta, surface.outside)
        cos = dot(surface.wo, h)
        cos2_t = 1 - (1 - cos * cos) * (ratio * ratio)
        wi = h * (ratio * cos - np.sqrt(np.maximum(cos2_t, 0))) - surface.wo * ratio
        return np.where(cos2_t > 0, wi, surface.wo)

    def transmitted_share(self, surface: LocalFrame) -> Array:
        """Return the share of light that a smooth surface would let through, ``(N,)``."""
        return 1 - dielectric(np.abs(surface.cos_o), relative_ior(self.eta, surface.outside))

    def _refracted(self, directions: Directions) -> tuple[Array, Array, Array]:
        """Return eta, ``D |wo.h| |wi.h| / (wo.h + eta wi.h)^2`` (0 if no facet refracts) and ``|wo.h|``, ``(N,)``."""
        eta = relative_ior(self.eta, directions.surface.outside)
        half = Directions(directions.surface, directions.wi * eta)  # wo + eta wi is the half vector times a length
        o = 1 + eta * directions.cos_io
        i = eta + directions.cos_io
        length2 = np.maximum(o + eta * i, MIN_DIVISOR)
        side = -(half.cos_i_signed + directions.cos_o)  # h is on wo's side of the surface if it is turned by this sign
        refracts = (o * side > 0) & (i * side < 0) & directions.above
        transmitted = TrowbridgeReitz(self.roughness).density(half) * np.abs(o * i) / (length2 * length2) * refracts
        return eta, transmitted, np.abs(o) / np.sqrt(length2)

    def eta_scale(self) -> float:
        return self.eta
