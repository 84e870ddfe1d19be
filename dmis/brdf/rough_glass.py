"""Rough glass: facets of the distribution of Trowbridge and Reitz that reflect light, or let it through.

A facet's normal h divides the light by Fresnel's equations: it mirrors wo, or refracts it by Snell's law. With the
index eta beyond the surface, relative to wo's side, light comes through from wi where ``h ~ wo + eta wi``. D, G2 and
the sampling of half vectors that wo can see are those of `dmis.ggx`. Radiance that comes through is scaled by
``1/eta^2``, as in a smooth surface (`dmis.brdf.specular.SpecularTransmission`).

One bounce between facets is all there is, as in `dmis.ggx`.

Source: Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007, with Smith's masking
correlated in height for both directions, as in pbrt-v3 and v4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import Array, dot
from dmis.brdf.cosines import Frame, Pair
from dmis.brdf.distributions import Roughness, TrowbridgeReitz
from dmis.brdf.fresnel import Dielectric, dielectric
from dmis.brdf.lobe import Lobe
from dmis.brdf.microfacet import GGX, visible
from dmis.brdf.specular import index

_LEAST = np.float32(1e-12)


@dataclass(frozen=True, eq=False)
class RoughReflection(Lobe):
    """What the facets mirror: `dmis.brdf.microfacet.GGX` with Fresnel's reflectance of the side that wo is on."""

    reflectance: Any
    roughness: Roughness
    fresnel: Dielectric
    colours: ClassVar[tuple[str, ...]] = ("reflectance",)
    factor: ClassVar[str | None] = "reflectance"

    def eval(self, pair: Pair) -> Array:
        """BRDF without the cosine, ``(1, N)`` or ``(3, N)``; 0 below the shading horizon."""
        eta = index(self.fresnel.eta, pair.surface.outside)
        return GGX(self.reflectance, self.roughness).eval(pair) * dielectric(pair.cos_d, eta)

    def pdf(self, pair: Pair) -> Array:
        """Density of `sample`, ``(N,)``."""
        return GGX(self.reflectance, self.roughness).pdf(pair)

    def sample(self, surface: Frame, u: Array) -> Array:
        """Directions ``(3, N)``."""
        return GGX(self.reflectance, self.roughness).sample(surface, u)

    def albedo(self) -> Array:
        """Return the colour times Fresnel's reflectance at normal incidence, see `dmis.brdf.lobe.Lobe.albedo`."""
        return self.reflectance * self.fresnel(np.ones(1, np.float32))

    def has_sides(self) -> bool:
        """Return whether the reflectance of the two sides differs."""
        return True


@dataclass(frozen=True, eq=False)
class RoughTransmission(Lobe):
    """What the facets let through; its surface's normal is on the side of wi, that of wo is beyond it.

    ``f = T (1 - F) D G2 |wo.h| |wi.h| / (cos_i cos_o (wo.h + eta wi.h)^2)`` with F at ``wo.h``. The weight
    ``f cos_i / pdf = T (1 - F) G2 / G1 / eta^2``. Half vectors that reflect totally have no direction beyond, so the
    pdf integrates to less than 1.
    """

    transmittance: Any
    roughness: Roughness
    eta: float
    colours: ClassVar[tuple[str, ...]] = ("transmittance",)
    factor: ClassVar[str | None] = "transmittance"
    transmissive: ClassVar[bool] = True

    def eval(self, pair: Pair) -> Array:
        """BTDF without the cosine, ``(1, N)`` or ``(3, N)``; 0 where no facet refracts wo to wi."""
        eta, passed, cos = self._refracted(pair)
        o, i = self._stretched(pair, pair.surface.wo, pair.cos_o), self._stretched(pair, pair.wi, pair.cos_i)
        masked = 2 / np.maximum(o * pair.cos_i - i * pair.cos_o, _LEAST)  # G2 / (cos_i cos_o), and cos_o < 0
        return self.transmittance * (passed * masked * (1 - dielectric(cos, eta)))

    def pdf(self, pair: Pair) -> Array:
        """Density of `sample`, ``(N,)``: D_wo times ``dh/dwi = eta^2 |wi.h| / (wo.h + eta wi.h)^2``."""
        eta, passed, _ = self._refracted(pair)
        o = self._stretched(pair, pair.surface.wo, pair.cos_o)
        return passed * (2 * eta * eta) / np.maximum(o - pair.cos_o, _LEAST)

    def sample(self, surface: Frame, u: Array) -> Array:
        """Directions ``(3, N)``; wo itself, which is not beyond, where light is totally reflected."""
        h = visible(self.roughness, surface, u)
        ratio, cos = 1 / index(self.eta, surface.outside), dot(surface.wo, h)
        cos2_t = 1 - (1 - cos * cos) * (ratio * ratio)
        wi = h * (ratio * cos - np.sqrt(np.maximum(cos2_t, 0))) - surface.wo * ratio
        return np.where(cos2_t > 0, wi, surface.wo)

    def passed(self, surface: Frame) -> Array:
        """What a smooth surface would let through, ``(N,)``."""
        return 1 - dielectric(np.abs(surface.cos_o), index(self.eta, surface.outside))

    def _refracted(self, pair: Pair) -> tuple[Array, Array, Array]:
        """eta; ``D |wo.h| |wi.h| / (wo.h + eta wi.h)^2``, 0 where no facet refracts; ``|wo.h|``. Each ``(N,)``."""
        eta = index(self.eta, pair.surface.outside)
        half = Pair(pair.surface, pair.wi * eta)  # wo + eta wi is the half vector, not yet of unit length
        o, i = 1 + eta * pair.cos_io, eta + pair.cos_io
        length2 = np.maximum(o + eta * i, _LEAST)
        side = -(half.cos_i_signed + pair.cos_o)  # h is on wo's side of the surface if it is turned by this sign
        refracts = (o * side > 0) & (i * side < 0) & pair.above
        passed = TrowbridgeReitz(self.roughness).density(half) * np.abs(o * i) / (length2 * length2) * refracts
        return eta, passed, np.abs(o) / np.sqrt(length2)

    def _stretched(self, pair: Pair, w: Array, cos: Array) -> Array:
        return self.roughness.stretched(pair.surface, w, cos)

    def eta_scale(self) -> float:
        """Return the index by whose square radiance is divided inside, see `dmis.brdf.lobe.Lobe.eta_scale`."""
        return self.eta
