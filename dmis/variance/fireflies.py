"""Fireflies: pixels that a few very bright samples make noisy, found by their variance and their neighbours."""

from __future__ import annotations

import numpy as np

from dmis.base.color import luminance
from dmis.base.vectors import Array

FEW = 4.0
"""A pixel of a firefly is the work of fewer than this many of its samples."""
SPREADS = 6.0
"""And is this many standard errors of its neighbours brighter than they are."""


def find_fireflies(image: Array, variance: Array, samples: Array) -> np.ndarray:
    """Return which pixels look like fireflies, ``(H, W)`` bool.

    It takes milliseconds, whatever the number of samples.

    Two conditions, both on luminance, of which the variance is that of channels that rise and fall together. The mean
    x of n samples with the estimated variance v of this mean is carried by ``k = 1 / (v / x^2 + 1 / n)`` samples
    (Kish's effective number, ``(sum Y)^2 / sum Y^2``): by one, if all others are black. It must be less than `FEW`. And
    x must exceed the median of the eight pixels around it by `SPREADS` times their median standard error, and be twice
    as large. A small lamp that is seen directly passes the second, not the first; a dark corner that few samples reach
    passes the first.

    Parameters
    ----------
    image, variance
        ``(H, W, 3)`` linear RGB, and the variance of it, see `dmis.pipeline.result.Result`. Where the variance is not
        known, with one sample, nothing is found.
    samples
        Camera samples of each pixel, ``(H, W)`` or one number.
    """
    x, v = luminance(np.asarray(image, np.float64)), luminance(np.sqrt(np.asarray(variance, np.float64))) ** 2
    carried = v + x * x / samples > x * x / FEW  # False where v is not a number
    near, noise = _around(x), np.sqrt(_around(v))
    return carried & (x > near + SPREADS * noise) & (x > 2 * near)


def _around(values: Array) -> Array:
    """Median of the eight neighbours in ``(H, W)``; the border is reflected."""
    height, width = values.shape
    wide = np.pad(values, 1, mode="reflect" if min(height, width) > 1 else "edge")
    places = [(dy, dx) for dy in range(3) for dx in range(3) if (dy, dx) != (1, 1)]
    return np.asarray(np.median([wide[dy : dy + height, dx : dx + width] for dy, dx in places], axis=0))
