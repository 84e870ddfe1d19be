"""A diffuse base under a dielectric coat: what leaves through the coat, all reflections between the two included.

Light crosses the coat, is scattered by the Lambertian base, and then leaves or is reflected back to the base by the
coat's inner side, any number of times. A Lambertian base forgets where light came from, so these times are a geometric
series. With the coat's `transmittance` T(c) from outside and its `internal_reflectance` I of diffuse light, index eta
inside over outside and reflectance R of the base::

    f = T(cos_i) T(cos_o) R / (pi eta^2 (1 - R I))

which is exact for a smooth coat, and for a rough one if light meets one facet at each crossing, as in
`dmis.brdf.microfacet.GGX`. What the coat reflects at its outer side is a lobe of its own: a mirror, or GGX
(`dmis.brdf.models.coated_diffuse` puts them together). With R = 1, without absorption, a smooth coat and its base
reflect everything.

This is pbrt-v4's ``coateddiffuse`` without a scattering medium, in the mean: v4 follows light at random through the
layers. It does not move light sideways, and its coat absorbs, with an optical thickness that it calls ``thickness``. It
ends a path after ``maxdepth`` interfaces, half of which are the base: `bounces` terms of the series, the next of which
would be (R I)^bounces. Its roulette changes no mean. Where the coat is rough, v4's ``f`` is brighter than its own
``Sample_f``, which has the mean given here: it puts together two estimates of the way out with weights whose sum is
not 1, because one has the density of the reversed path.

A layer of optical thickness t below the interface keeps ``exp(-t / c)`` of a ray of cosine c. Facets are averaged once
for each interface, see `dmis.brdf.facet_quadrature`.

Sources: Saunderson 1942; Walter et al. 2007; Elias, Simonot and Menu 2001; Guo, Hasan and Zhao, "Position-Free Monte
Carlo Simulation for Arbitrary Layered BSDFs", 2018; bxdfs.h of pbrt-v4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.cosines import Directions
from dmis.brdf.diffuse import CosineLobe
from dmis.brdf.facet_quadrature import LEAST_COSINE, NODES, gauss, interpolate, reflected, refracted
from dmis.brdf.fresnel import dielectric
from dmis.samplers.warp import INV_PI

DIFFUSE_NODES = 64
"""Nodes of diffuse light on either side of the critical angle."""


def transmittance(cos: Array, eta: float, alpha: float = 0.0, thickness: float = 0.0) -> Array:
    """Return the share of the light from outside that arrives below the layer, ``(N,)``, at cosines outside in [0, 1].

    It is ``1 - F`` times the absorption if the interface is smooth (`alpha` 0); else linear between the nodes of a
    table in ``sqrt(cos)``, along which the share is smooth to the horizon.
    """
    if alpha:
        return interpolate(_table(eta, alpha, thickness), cos)
    share = 1 - dielectric(cos, np.float32(eta))
    if thickness:
        inside = np.sqrt(np.maximum(1 - (1 - cos * cos) * np.float32(1 / (eta * eta)), 0))
        share *= np.exp(np.float32(-thickness) / np.maximum(inside, LEAST_COSINE))
    return share


@cache
def _table(eta: float, alpha: float, thickness: float) -> Array:
    """Return `transmittance` at `NODES`, ``(TABLE_INTERVALS + 1,)``."""
    cos, share = refracted(NODES, alpha, eta)
    return (share * np.exp(-thickness / cos)).sum(axis=(1, 2)).astype(np.float32)


@cache
def internal_reflectance(eta: float, alpha: float = 0.0, thickness: float = 0.0) -> float:
    """Return the share of diffuse light from below the layer that comes back to its lower side.

    ``2 int R(c) c dc`` over cosines c inside, where R is the interface's reflectance from inside at the index
    ``1 / eta``, absorption on the way up and down included. With m the cosine of the critical angle, ``c = m sqrt(1 -
    s^2)`` below it and ``c = sqrt(m^2 + (1 - m^2) s^2)`` above (where s is the cosine outside) take away the root
    that Fresnel's reflectance has there. Smooth and without absorption it is ``1 - (1 - F) / eta^2``, where F is the
    same integral from outside.
    """
    nodes, weights = gauss(DIFFUSE_NODES)
    critical2 = 1 - 1 / (eta * eta)
    cos2 = np.concatenate([critical2 * (1 - nodes**2), critical2 + (1 - critical2) * nodes**2])
    weights = np.concatenate([critical2 * weights, (1 - critical2) * weights]) * np.tile(2 * nodes, 2)
    up = np.sqrt(np.maximum(cos2, LEAST_COSINE))
    down, share = reflected(up, alpha, lambda cos: dielectric(cos, np.asarray(1 / eta)))
    absorbed = np.exp(-thickness / down) * np.exp(-thickness / up)[:, None, None]
    return float(weights @ (share * absorbed).sum(axis=(1, 2)))


@dataclass(frozen=True, eq=False)
class CoatedBase(CosineLobe):
    """Light that a Lambertian base reflects through its coat; the same from both sides of a mesh.

    Only the reflectance and the share may differ from point to point.

    Parameters
    ----------
    reflectance
        Of the base, at most 1.
    eta
        The coat's index of refraction, inside over outside, at least 1.
    roughness
        The coat's alpha; 0 is smooth.
    thickness
        Optical thickness of the coat, which absorbs ``1 - exp(-thickness / cos)``.
    bounces
        How many reflections by the base count; None: all.
    share
        Of a mixture with other materials, which the lobe is in proportion to.
    """

    reflectance: Any
    eta: float = 1.5
    roughness: float = 0.0
    thickness: float = 0.0
    bounces: int | None = None
    share: Any = 1.0
    colours: ClassVar[tuple[str, ...]] = ("reflectance",)
    factor: ClassVar[str | None] = "share"

    def eval(self, directions: Directions) -> Array:
        coat = self.eta, self.roughness, self.thickness
        again = self.reflectance * internal_reflectance(*coat)
        series = 1 / (1 - again) if self.bounces is None else (1 - again**self.bounces) / (1 - again)
        through = transmittance(directions.cos_i, *coat) * transmittance(directions.cos_o, *coat)
        return self.share * self.reflectance * series * (through * np.float32(INV_PI / (self.eta * self.eta)))

    def albedo(self) -> Array:
        return self.share * self.reflectance
