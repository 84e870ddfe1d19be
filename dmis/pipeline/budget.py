"""Whole numbers of camera samples from the shares that a rule asks for."""

from __future__ import annotations

import math

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.settings import MOST

LEVELS = np.array(sorted({round(2 ** (k / 2)) for k in range(33)}))
"""Numbers of camera samples that a pixel may have where they differ, a factor of about 1.4 apart."""


def split_budget(samples: int, shading_samples: int, factor: float) -> tuple[int, int]:
    """Return the numbers of camera samples and of shading samples of each, for `factor` times the `shading_samples`.

    The budget is `samples` camera samples with `shading_samples` each. Of the whole numbers nearest to
    ``samples / factor`` and ``factor shading_samples`` those are taken that use the most of it, and no more.
    """
    candidates = []
    for n in {max(1, math.floor(samples / factor)), max(1, math.ceil(samples / factor))}:
        samples_each = max(1, min(samples * shading_samples // n, MOST))
        candidates.append((-n * samples_each, abs(samples_each - shading_samples * factor), n, samples_each))
    return min(candidates)[2:]


def whole_samples(share: Array, spp: int, rng: np.random.Generator) -> np.ndarray:
    """Return whole numbers of camera samples in proportion to `share` ``(H, W)``, `spp` on average, at least 2, int32.

    Numbers are from `LEVELS`, so that pixels can be rendered together; systematic rounding with a random offset
    keeps their mean.

    Raises
    ------
    ValueError
        If a share is not positive and finite, or there are more samples than `LEVELS` has.
    """
    if spp > LEVELS[-1]:
        raise ValueError(f"camera samples must be at most {LEVELS[-1]} per pixel where a rule divides them; got {spp}")
    if not (np.isfinite(share).all() and (share > 0).all()):
        raise ValueError("samples of a fit must be positive and finite, because every pixel needs some")
    least, most = min(2, spp), LEVELS[-1]
    values, pixels = np.unique(share, return_counts=True)
    low_scale, high_scale = 0.0, most / values[0]
    # bisection for the scale at which the clipped samples have the mean spp; it ends when all pixels are at the least,
    # or when no float is between the two scales
    while high_scale * values[-1] > least and low_scale < (scale := (low_scale + high_scale) / 2) < high_scale:
        enough = np.clip(values * scale, least, most) @ pixels >= spp * share.size
        low_scale, high_scale = (low_scale, scale) if enough else (scale, high_scale)
    samples = np.empty(share.shape, np.int32)
    offset = rng.random()
    for row, row_samples in zip(share, samples, strict=True):
        target = np.clip(row.astype(float) * high_scale, least, most)
        low = np.clip(np.searchsorted(LEVELS, target, "right") - 1, 0, len(LEVELS) - 2)
        steps = np.cumsum(np.append(offset, (target - LEVELS[low]) / (LEVELS[low + 1] - LEVELS[low])))
        row_samples[:] = LEVELS[np.minimum(low + np.diff(np.floor(steps).astype(int)), len(LEVELS) - 1)]
        offset = steps[-1]
    return samples
