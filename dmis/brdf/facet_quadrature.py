"""Light that the facets of a rough interface reflect, or let through, by quadrature over the half vectors it sees.

Facets have the distribution of `dmis.brdf.microfacet.GGX`, light meets one of them, and masking and shadowing are
correlated, ``G2 = 1 / (1 + L(wo) + L(wi))``. Half vectors are averaged by a Gauss rule for the cap of
`dmis.brdf.microfacet.visible_half_vectors` and a midpoint rule around it, in float64. A smooth interface, of alpha 0,
has one half vector.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.fresnel import dielectric

HALF_VECTOR_NODES = 32
"""Nodes in each of the two coordinates of half vectors."""
LEAST_COSINE = np.float32(1e-7)
"""Smallest cosine: at the horizon the terms have the limit 0 / 0."""
TABLE_INTERVALS = 512
"""Intervals of tables over the cosine: error of a transmittance below 1e-4 for indices 1.1 to 4, alpha to 1."""
NODES = np.maximum(np.linspace(0, 1, TABLE_INTERVALS + 1) ** 2, LEAST_COSINE)
"""Cosines of the nodes of tables: shares of light are smooth to the horizon along their root."""


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
    x, y = alpha * (r * np.cos(phi) + alpha * sin_o / length), alpha * r * np.sin(phi)
    z = (1 - u) * (1 + cos_o / length)
    size = np.sqrt(x * x + y * y + z * z)
    return cos_o, (sin_o * x + cos_o * z) / size, z / size, (weights * 2 * (1 - nodes) / HALF_VECTOR_NODES)[:, None]


def gauss(count: int) -> tuple[Array, Array]:
    """Return nodes and weights of Gauss's rule in [0, 1]."""
    x, weights = np.polynomial.legendre.leggauss(count)
    return (x + 1) / 2, weights / 2
