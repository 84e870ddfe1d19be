"""Pixel filters (reconstruction filters): the weights with which a pixel averages the image around it.

A pixel draws its camera samples in proportion to its filter, from its own stream (Ernst, Stamminger and Greiner,
"Filter Importance Sampling", 2006). All samples have the same weight, pixels stay independent, and the variance of a
pixel is that of its samples. Filters must not be negative: box, triangle and Gaussian, but neither Mitchell's nor a
sinc. Each is a product of its profiles along x and y.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from dmis.base.validate import number, one_of, pair
from dmis.base.vectors import Array

PIXEL_FILTERS = ("box", "triangle", "gaussian")
"""Names of the pixel filters."""
MAX_RADIUS = 64.0
"""Largest radius in pixels."""
TABLE_NODES = 4097
"""Nodes of the table from which Gaussians are sampled."""
MAX_SIGMAS = 7.0
"""Standard deviations beyond which a Gaussian has less mass than float32 uniform numbers resolve."""


@dataclass(frozen=True)
class PixelFilter:
    """A pixel filter, centred on the middle of its pixel.

    Parameters
    ----------
    kind
        ``box``; ``triangle``, which falls linearly to 0 at its radius; ``gaussian``, less its value at the radius.
    radius
        Half of the width along x and y, in pixels.
    sigma
        Standard deviation of the Gaussian in pixels, before it is cut off at the radius.
    """

    kind: str = "gaussian"
    radius: tuple[float, float] = (1.5, 1.5)
    sigma: float = 0.5

    def __post_init__(self) -> None:
        one_of("kind of a pixel filter", self.kind, PIXEL_FILTERS)
        in_range = partial(number, least=1e-6, most=MAX_RADIUS, more="in pixels")
        object.__setattr__(self, "radius", pair("radius of a pixel filter", self.radius, in_range))
        object.__setattr__(self, "sigma", number("sigma of a pixel filter", self.sigma, 1e-3, 1e3, "in pixels"))

    def offsets(self, u: Array) -> Array:
        """Return positions from the pixel's corner, ``(2, N)`` float32, drawn from the filter by `u` ``(2, N)``."""
        return np.stack([0.5 + self._along(a, radius) for a, radius in zip(u, self.radius, strict=True)])

    def _along(self, u: Array, radius: float) -> Array:
        """Return one coordinate ``(N,)``: the inverse of the profile's cumulative distribution at `u` ``(N,)``."""
        centred = 2 * u - 1
        if self.kind == "box":
            return np.float32(radius) * centred
        if self.kind == "triangle":
            return np.float32(radius) * np.copysign(1 - np.sqrt(1 - np.abs(centred)), centred)
        x, cdf = _gaussian(radius, self.sigma)
        return np.interp(u, cdf, x).astype(np.float32)


@cache
def _gaussian(radius: float, sigma: float) -> tuple[Array, Array]:
    """Return positions from -radius to radius, and there the cumulative distribution of the cut-off Gaussian."""
    reach = min(radius, MAX_SIGMAS * sigma)
    x = np.linspace(-reach, reach, TABLE_NODES)
    # exp(a) - exp(b) through expm1: a Gaussian wide beside its radius is all but flat
    value = -np.exp(-x * x / (2 * sigma**2)) * np.expm1((x * x - radius**2) / (2 * sigma**2))
    cdf = np.concatenate([[0.0], np.cumsum(value[1:] + value[:-1])])
    return x, cdf / cdf[-1]
