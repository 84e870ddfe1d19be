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

A layer of optical thickness t below the interface keeps ``exp(-t / c)`` of a ray of cosine c.

What a rough interface reflects, or lets through, is an average over the half vectors that light sees, by quadrature
once for each interface. Masking and shadowing are correlated, ``G2 = 1 / (1 + L(wo) + L(wi))``. The rule is Gauss's for
the cap of `dmis.brdf.microfacet.visible_half_vectors` and a midpoint rule around it, in float64. A smooth interface, of
alpha 0, has one half vector.

Sources: Saunderson 1942; Walter et al. 2007; Elias, Simonot and Menu 2001; Guo, Hasan and Zhao, "Position-Free Monte
Carlo Simulation for Arbitrary Layered BSDFs", 2018; bxdfs.h of pbrt-v4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.fresnel import dielectric
from dmis.brdf.lobe import CosineLobe, Directions
from dmis.samplers.warp import INV_PI

DIFFUSE_NODES = 64
"""Nodes of diffuse light on either side of the critical angle."""
HALF_VECTOR_NODES = 32
"""Nodes in each of the two coordinates of half vectors."""
LEAST_COSINE = np.float32(1e-7)
"""Smallest cosine: at the horizon the terms have the limit 0 / 0."""
TABLE_INTERVALS = 512
"""Intervals of tables over the cosine: error of a transmittance below 1e-4 for indices 1.1 to 4, alpha to 1."""
NODES = np.maximum(np.linspace(0, 1, TABLE_INTERVALS + 1) ** 2, LEAST_COSINE)
"""Cosines of the nodes of tables: shares of light are smooth to the horizon along their root."""


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


def interpolate(table: Array, cos: Array) -> Array:
    """Return the values of a `table` at `NODES` ``(..., TABLE_INTERVALS + 1)`` at cosines `cos` ``(N,)``."""
    at = np.sqrt(cos) * np.float32(TABLE_INTERVALS)
    node = at.astype(np.int32)
    low, high = (table.take(k, axis=-1, mode="clip") for k in (node, node + 1))
    return low + (high - low) * (at - node.astype(np.float32))


def reflected(cos: Array, alpha: float, reflectance: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return where light of cosines `cos` ``(M,)`` is reflected: cosines, and shares whose sum for each is the albedo.

    Both are ``(M, HALF_VECTOR_NODES, HALF_VECTOR_NODES)``. `reflectance` is Fresnel's, of the cosine to the facet.
    """
    cos_o, cos_d, cos_h, weight = _facets(cos, alpha)
    cos_i = 2 * cos_d * cos_h - cos_o
    return _leaving(cos_o, cos_i, alpha, weight * reflectance(cos_d))


def refracted(cos: Array, alpha: float, eta: float) -> tuple[Array, Array]:
    """Return where light is refracted to, as `reflected` does; `eta` is the index beyond over that before."""
    cos_o, cos_d, cos_h, weight = _facets(cos, alpha)
    beyond = np.sqrt(np.maximum(1 - (1 - cos_d * cos_d) / (eta * eta), 0))
    cos_i = cos_o / eta + cos_h * (beyond - cos_d / eta)
    return _leaving(cos_o, cos_i, alpha, weight * (1 - dielectric(cos_d, np.asarray(eta))))


def _leaving(cos_o: Array, cos_i: Array, alpha: float, share: Array) -> tuple[Array, Array]:
    """Return cosines, and the shares of what facets that wo sees send there past other facets: G2 / G1 of `share`."""
    above = cos_i > LEAST_COSINE
    cos_i = np.maximum(cos_i, LEAST_COSINE)
    o, i = (np.sqrt(alpha * alpha * np.maximum(1 - c * c, 0) + c * c) / c for c in (cos_o, cos_i))
    return cos_i, share * above * (1 + o) / (o + i)


def _facets(cos: Array, alpha: float) -> tuple[Array, Array, Array, Array]:
    """Return the half vectors that directions of cosines `cos` ``(M,)`` see: nodes of a quadrature, float64.

    These are the cosines of wo with the normal ``(M, 1, 1)``, of wo and of the normal with the half vectors ``(M,
    HALF_VECTOR_NODES, HALF_VECTOR_NODES)``, and weights ``(HALF_VECTOR_NODES, 1)``, whose sum over both axes is 1.
    """
    nodes, weights = gauss(HALF_VECTOR_NODES)
    u = (1 - (1 - nodes) ** 2)[:, None]  # many nodes near 1, where facets stand upright
    phi = np.pi * (np.arange(HALF_VECTOR_NODES) + 0.5) / HALF_VECTOR_NODES  # the other half circle is the same
    cos_o = cos[:, None, None].astype(np.float64)
    sin_o = np.sqrt(np.maximum(1 - cos_o * cos_o, 0))
    length = np.hypot(alpha * sin_o, cos_o)
    below = u * (1 + cos_o / length)
    r = np.sqrt(np.maximum(below * (2 - below), 0))
    x = alpha * (r * np.cos(phi) + alpha * sin_o / length)
    y = alpha * r * np.sin(phi)
    z = (1 - u) * (1 + cos_o / length)
    size = np.sqrt(x * x + y * y + z * z)
    return cos_o, (sin_o * x + cos_o * z) / size, z / size, (weights * 2 * (1 - nodes) / HALF_VECTOR_NODES)[:, None]


def gauss(count: int) -> tuple[Array, Array]:
    """Return nodes and weights of Gauss's rule in [0, 1]."""
    x, weights = np.polynomial.legendre.leggauss(count)
    return (x + 1) / 2, weights / 2
