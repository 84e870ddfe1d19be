"""Pixel filters: how much of the image around it a pixel is the mean of.

A pixel's camera samples are drawn in proportion to its filter, from its own stream (Ernst, Stamminger and Greiner,
"Filter Importance Sampling", 2006): all count the same, pixels stay independent, and variances mean what they meant.
That needs filters that are not negative: box, triangle and Gaussian, but not Mitchell's, nor a sinc. Each is a product
of its profiles along x and y.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from dmis.checks import number, pair
from dmis.vec import Array

KINDS = ("box", "triangle", "gaussian")
WIDEST = 64.0
"""Largest radius in pixels."""
NODES = 4097
"""Of the table by which Gaussians are sampled."""
FAR = 7.0
"""Standard deviations beyond which a Gaussian has nothing left that float32 numbers would find."""


@dataclass(frozen=True)
class PixelFilter:
    """A filter about the middle of a pixel.

    Parameters
    ----------
    kind
        ``box``; ``triangle``, which falls linearly to 0 at its radius; ``gaussian``, less its value at the radius.
    radius
        Half of the width along x and y, in pixels.
    sigma
        Standard deviation of the Gaussian in pixels, before it is cut off.
    """

    kind: str = "gaussian"
    radius: tuple[float, float] = (1.5, 1.5)
    sigma: float = 0.5

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(
                f"a pixel filter must be {', '.join(KINDS)}, because samples are drawn from it, which those with "
                f"negative parts cannot be; got {self.kind!r}"
            )
        object.__setattr__(self, "radius", pair("radius of a pixel filter", self.radius, number))
        if not all(0 < radius <= WIDEST for radius in self.radius):
            raise ValueError(f"the radius of a pixel filter must be above 0, at most {WIDEST:g}; got {self.radius}")
        object.__setattr__(self, "sigma", number("sigma of a pixel filter", self.sigma, 1e-3, 1e3, "in pixels"))

    def offsets(self, u: Array) -> Array:
        """Positions from the pixel's corner, ``(2, N)`` float32, in proportion to the filter; `u` is ``(2, N)``."""
        return np.stack([0.5 + self._along(a, radius) for a, radius in zip(u, self.radius, strict=True)])

    def _along(self, u: Array, radius: float) -> Array:
        """One coordinate: u through the inverse of the profile's cumulative distribution, ``(N,)``."""
        side = 2 * u - 1
        if self.kind == "box":
            return np.float32(radius) * side
        if self.kind == "triangle":
            return np.float32(radius) * np.copysign(1 - np.sqrt(1 - np.abs(side)), side)
        x, share = _gaussian(radius, self.sigma)
        return np.interp(u, share, x).astype(np.float32)


@cache
def _gaussian(radius: float, sigma: float) -> tuple[Array, Array]:
    """Positions from -radius to radius, and the share of the Gaussian, less its value there, up to each."""
    reach = min(radius, FAR * sigma)
    x = np.linspace(-reach, reach, NODES)
    # exp(a) - exp(b) through expm1: a Gaussian wide beside its radius is all but flat
    value = -np.exp(-x * x / (2 * sigma**2)) * np.expm1((x * x - radius**2) / (2 * sigma**2))
    share = np.concatenate([[0.0], np.cumsum(value[1:] + value[:-1])])
    return x, share / share[-1]
