"""Variance of a camera sample with each pattern of light and BRDF samples, from a first round of two pairs.

Pixels have one of four colours, by whether row and column are even or odd, and sums are kept apart by colour: what is
decided for the pixels of a colour comes from the others' samples, so that a pixel's own may be part of its image.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.patterns import SHARES
from dmis.estimator.records import Record, Wants
from dmis.variance.curves import Curves, summed_variance


class PatternCurves(Curves):
    """Sums of the curves at the shares of `dmis.estimator.patterns.PATTERNS`, whose counts need no rounding.

    Parameters
    ----------
    pixels, shading_samples, combiner
        See `dmis.variance.curves.Curves`.
    lights
        L, lights whose variances are told apart, see `dmis.estimator.patterns`; 0: none.
    """

    wants = Wants(sums="colours")

    def __init__(self, pixels: int, shading_samples: int, combiner: str = "balance", lights: int = 0) -> None:
        super().__init__(pixels, shading_samples, combiner, SHARES)
        self._lights = np.zeros((lights + 1, pixels)) if lights else None
        self._rounding_variance = np.zeros(len(SHARES))

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block, as `dmis.variance.curves.Curves.add` does."""
        super().add(records, radiance, count)
        if self._lights is not None:
            *lights, rest = self._lights
            left = radiance.copy()
            for total, of_light in zip(lights, self._take_lights(records, len(lights), left), strict=True):
                total += summed_variance(of_light, count)
            rest += summed_variance(left, count)

    def _take_lights(self, records: Sequence[Record], lights: int, radiance: Array) -> Array:
        """Return what the first surface reflects of each light, ``(L, 1, N)``, and take it from `radiance`."""
        of_lights = np.zeros((lights, 1, radiance.shape[1]), np.float32)
        for record in records:
            if len(record.key) == 1 and record.key[0] < lights:
                where = slice(None) if record.sample is None else record.sample
                value = record.value / np.float32(2 * self._s)
                radiance[:, where] -= value
                of_lights[record.key[0], 0, where] += value.mean(axis=0)
        return of_lights

    def sums(self) -> dict[str, Array]:
        """Return the sums per pixel, see `dmis.variance.curves.Curves.sums`.

        Those of rounding are left out. In their place is `lights`, the variance of what the first surface reflects of
        each light, and of all the rest, ``(L + 1, P)``.
        """
        sums = super().sums()
        del sums["pattern"]
        lights = {} if self._lights is None else {"lights": self._lights / max(self._n, 1)}
        return sums | lights
