"""Spatial filters of maps of statistics or weights."""

from __future__ import annotations

import numpy as np

from dmis.vec import Array


def gaussian(values: Array, sigma: float = 1.0, radius: int = 2) -> Array:
    """Gaussian filter with ``(2 radius + 1)^2`` taps: 5x5 by default, as in thesis Sec. 3.4.

    Edges repeat the outermost value, so constants stay constant. Entries that are not finite count as absent: they are
    filled from their neighbours, and spoil none of them; where no neighbour is finite they stay as they are.

    Parameters
    ----------
    values
        ``(H, W)``.
    sigma
        Standard deviation in entries (the thesis does not give it).
    radius
        Half-width in entries.
    """
    from scipy.ndimage import gaussian_filter  # imported where used: it takes a third of a second

    if not (sigma > 0 and np.isfinite(sigma)):
        raise ValueError(f"sigma must be positive; got {sigma}")
    if radius < 0:
        raise ValueError(f"radius must not be negative; got {radius}")
    values = np.asarray(values, np.float64)
    present = np.isfinite(values)
    options = {"sigma": sigma, "radius": radius, "mode": "nearest"}
    total = gaussian_filter(np.where(present, values, 0), **options)
    if present.all():
        return total
    weight = gaussian_filter(present.astype(np.float64), **options)
    return np.where(weight > 1e-12, total / np.maximum(weight, 1e-12), values)


def effective(sigma: float = 1.0, radius: int = 2) -> float:
    """How many equal entries an average by `gaussian` is worth: one over the sum of its squared taps."""
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return float((taps.sum() ** 2 / (taps**2).sum()) ** 2)
