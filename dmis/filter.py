"""Spatial filters of maps of statistics or MIS weights: Gaussian, and joint bilateral by feature buffers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dmis.base.validate import positive, whole
from dmis.base.vectors import Array

MAX_TAPS = 1001
"""Largest number of taps on a side of a filter."""


def gaussian(values: Array, sigma: float = 1.0, radius: int = 2, weight: Array | None = None) -> Array:
    """Return a map filtered by a Gaussian of ``(2 radius + 1)^2`` taps: 5x5 by default, as in thesis Sec. 3.4.

    Edges repeat the outermost value, so constants stay constant. Entries that are not finite have the weight 0: they
    are replaced by the mean of their neighbours, and stay as they are if no neighbour is finite. So are those of weight
    0 (normalised convolution, Knutsson and Westin 1993).

    Parameters
    ----------
    values
        ``(H, W)``.
    sigma
        Standard deviation in entries (the thesis does not give it).
    radius
        Half-width in entries.
    weight
        Weight of each entry in the averages, ``(H, W)``, not negative; None: all have the same.
    """
    positive("sigma", sigma)
    whole("radius", radius, 0)
    values = np.asarray(values, np.float64)
    count = np.isfinite(values).astype(np.float64)
    if weight is not None:
        count *= weight
    # sum_q g(p - q) c_q x_q / sum_q g(p - q) c_q
    total = _smooth(np.where(count > 0, values, 0) * count, sigma, radius)
    if (count == 1).all():
        return total
    norm = _smooth(count, sigma, radius)
    return np.where(norm > 1e-12, total / np.maximum(norm, 1e-12), values)


def _smooth(values: Array, sigma: float, radius: int, axes: tuple[int, ...] = (0, 1)) -> Array:
    """Return a map ``(H, W)`` convolved with a Gaussian of sum 1 along `axes`; beyond edges entries are repeated."""
    taps = np.exp(-0.5 / sigma**2 * np.arange(-radius, radius + 1) ** 2.0)
    taps /= taps.sum()
    for axis in axes:
        n = values.shape[axis]
        near = np.pad(values, [(radius * (k == axis),) * 2 for k in (0, 1)], mode="edge").swapaxes(0, axis)
        # sum_k g_k x_k, those at the same distance together
        total = near[radius : radius + n] * taps[radius]
        for k in range(radius):
            total += (near[k : k + n] + near[2 * radius - k :][:n]) * taps[k]
        values = total.swapaxes(0, axis)
    return values


def effective(shape: tuple[int, int], sigma: float = 1.0, radius: int = 2) -> Array:
    """Return the effective number of entries in each average by `gaussian`, ``(H, W)``.

    It is one over the sum of the squared weights. At the edge it is smaller, because the outermost entry has the weight
    of all entries beyond.
    """
    weights = (_smooth(np.eye(n), sigma, radius, (0,)) for n in shape)
    rows, columns = (1 / (w * w).sum(axis=1) for w in weights)
    return rows[:, None] * columns


def joint(
    values: Array, features: Mapping[str, Array], scales: Mapping[str, float], sigma: float = 1.0, radius: int = 2
) -> tuple[Array, Array]:
    """Return maps filtered by a joint (cross-) bilateral filter: a Gaussian in space times one in feature differences.

    ``w_pq = exp(-|p - q|^2 / (2 sigma^2) - sum_g |g_p - g_q|^2 / (2 scale_g^2))``. The weights depend on the features,
    which have no noise, and not on the values, so means stay unbiased where the features determine the expected values.
    Edges that are in no feature, such as those of shadows, are blurred.

    Parameters
    ----------
    values
        Maps ``(..., H, W)``, which are filtered with the same weights.
    features, scales
        Feature buffers by name, ``(C, H, W)`` each, and for each the distance that counts as one standard deviation.
    sigma, radius
        See `gaussian`. Taps outside the map are left out.

    Returns
    -------
    filtered
        Means with weights that sum to 1, ``(..., H, W)``.
    entries
        Effective number of entries in each mean, ``(sum w)^2 / sum w^2``, ``(H, W)``.
    """
    height, width = values.shape[-2:]
    stacked = np.concatenate([np.zeros((1, height, width)), *(g / scales[name] for name, g in features.items())])
    total = np.array(values, np.float64)
    weight, square = np.ones((2, height, width))
    for dy in range(min(radius, height - 1) + 1):
        for dx in range(-min(radius, width - 1), min(radius, width - 1) + 1):
            if (dy, dx) <= (0, 0):  # each pair of entries once; the centre is in `total` already
                continue
            p = ..., slice(0, height - dy), slice(max(-dx, 0), width - max(dx, 0))
            q = ..., slice(dy, height), slice(max(dx, 0), width - max(-dx, 0))
            difference = stacked[p] - stacked[q]
            w = np.exp(-0.5 * ((dy * dy + dx * dx) / sigma**2 + (difference * difference).sum(axis=0)))
            for a, b in ((p, q), (q, p)):
                total[a] += w * values[b]
                weight[a] += w
                square[a] += w * w
    return total / weight, weight * weight / square


def check_taps(size: int) -> None:
    """Raise a ValueError unless `size`, the taps on a side of a filter, is odd and from 1 to `MAX_TAPS`."""
    if not 1 <= size <= MAX_TAPS or size % 2 == 0:
        raise ValueError(f"size must be odd, 1 to {MAX_TAPS}, taps on a side of the filter; got {size}")
