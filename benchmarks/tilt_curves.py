"""Variance V(w) of a camera sample at every tilt w of the heuristic, from samples of the balance heuristic.

A camera sample with as many light as BRDF samples is a sum over its shading samples i, towards every light at every
vertex, of ``X_i(w) = t_k f / (a_k (w p_l + (1 - w) p_b))``, with ``t_l = w``, ``t_b = 1 - w`` and ``a_l = a_b = 1/2``
(docs/theory.md, Eq. 8a). From samples at w = 1/2 it is

    X_i(w) = X_i(1/2) t_k / (w r_l + (1 - w) r_b),   r_k = p_k / (p_l + p_b).

A light and a BRDF sample share their camera sample, so that the variances of the two techniques do not add up over a
pixel. So the sum of each camera sample is reweighted, emission and delta lights included, and V(w) is the sample
variance of these sums: unbiased, with every edge, texture and path in it, and without pairs of samples.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.vectors import TINY, Array
from dmis.estimator.records import Record
from dmis.variance.curves import GRID, summed_variance


class TiltCurves:
    """Sums over camera samples, per pixel, of the variance V(w) at the tilts of a grid.

    Parameters
    ----------
    pixels
        Number of pixels of the tile.
    shading_samples
        Shading samples of each camera sample, of the samples at w = 1/2 and of those whose variance is estimated.
    grid
        Tilts w from 0 to 1, ``(G,)``.
    """

    def __init__(self, pixels: int, shading_samples: int, grid: Array = GRID) -> None:
        self._s = shading_samples
        self._grid = grid
        self._n = 0
        self._total = np.zeros((len(grid), pixels))

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block: `count` camera samples of every pixel, sample-major, and their radiance ``(3, N)``."""
        self._n += count
        totals = np.repeat(radiance.mean(axis=0, dtype=np.float64)[None], len(self._grid), axis=0)
        for record in records:
            x = record.value.mean(axis=0) / np.float32(self._s)
            r_l, r_b = record.pdf / np.maximum(record.pdf.sum(axis=0), TINY)
            where = slice(None) if record.sample is None else record.sample
            for total, w in zip(totals, self._grid, strict=True):
                # X(w) - X(1/2) = X(1/2) (t_k / (w r_l + (1 - w) r_b) - 1)
                tilt = np.float32(1 - w if record.technique_index else w)
                total[where] += x * (tilt / np.maximum(w * r_l + (1 - w) * r_b, TINY) - 1)
        for g, total in enumerate(totals):
            self._total[g] += summed_variance(total[None], count)

    def sums(self) -> dict[str, Array]:
        """Return V(w) of each pixel as ``curve``, ``(G, P)``."""
        return {"curve": self._total / max(self._n, 1)}
