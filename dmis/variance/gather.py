"""Statistic of a pilot at w = 1/2: means or variances of a function of its shading samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.records import Record
from dmis.variance.curves import samples_by_light, unrecorded_samples


class Gather:
    """Means or unbiased variances per pixel of a function of the samples, summed over lights.

    A `dmis.estimator.records.Statistic`. A rule asks for it with ``statistic = functools.partial(dmis.Gather, f)``, and
    finds the means over patches as ``values`` (`dmis.fit.pooling.PooledRule.pooled`).

    Parameters
    ----------
    integrand
        ``f(x, d)``: from ``X = f / q`` and ``d = (p_l - p_b) / (p_l + p_b)`` of a light and a BRDF sample, ``(2, N)``
        each (`dmis.variance.curves`), to values per camera sample ``(..., N)``.
    pixels, shading_samples
        Number of pixels of the tile, and of shading samples of each camera sample.
    variance
        Whether the variance of the values is gathered in place of their mean.
    """

    def __init__(
        self, integrand: Callable[[Array, Array], Array], pixels: int, shading_samples: int, variance: bool = False
    ) -> None:
        self._integrand = integrand
        self._pixels = pixels
        self._shading_samples = shading_samples
        self._variance = variance
        self._n = 0
        self._sum: Array | float = 0

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """See `dmis.estimator.records.Statistic.add`."""
        self._n += count
        n = radiance.shape[1]
        pairs = self._shading_samples // 2
        black = unrecorded_samples(2, n)  # so that there is a sum, even without a record
        for light in (*samples_by_light(records, self._shading_samples, n), black):
            for x, d in zip(*light, strict=True):
                values = self._integrand(x, d)
                of_pixels = values.reshape(*values.shape[:-1], count, self._pixels)
                if self._variance:
                    result = of_pixels.var(axis=-2, ddof=1, dtype=np.float64)
                else:
                    result = of_pixels.mean(axis=-2)
                self._sum = self._sum + count / pairs * result

    def sums(self) -> dict[str, Array]:
        """Return the sums of `values` per pixel, ``(..., P)``, see `dmis.estimator.records.Statistic.sums`."""
        return {"values": np.asarray(self._sum / max(self._n, 1))}
