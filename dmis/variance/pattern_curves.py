"""Variance of a camera sample with each pattern of light and BRDF samples, from a first round of two pairs.

Pixels have one of four colours, by whether row and column are even or odd, and sums are kept apart by colour: what is
decided for the pixels of a colour comes from the others' samples, so that a pixel's own may be part of its image.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.patterns import SHARES
from dmis.estimator.records import Record
from dmis.variance.curves import Curves


class PatternCurves(Curves):
    """Sums of the curves at the shares of `dmis.estimator.patterns.PATTERNS`, whose counts need no rounding.

    Parameters
    ----------
    pixels, shading_samples, combiner
        See `dmis.variance.curves.Curves`.
    """

    by_colour = True

    def __init__(self, pixels: int, shading_samples: int, combiner: str = "balance") -> None:
        super().__init__(pixels, shading_samples, combiner, SHARES)
        self._rounding_variance = np.zeros(len(SHARES))
        self._halves = np.zeros(pixels)

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block, as `dmis.variance.curves.Curves.add` does."""
        super().add(records, radiance, count)
        half = count // 2
        samples = radiance.reshape(3, count, -1)
        first, second = (a.mean(axis=1, dtype=np.float64) for a in (samples[:, :half], samples[:, half : 2 * half]))
        self._halves += np.square(second - first).mean(axis=0)

    def sums(self) -> dict[str, Array]:
        """Return the sums per pixel, see `dmis.variance.curves.Curves.sums`.

        Those of rounding are left out. In their place are `halves`, squared differences between the means of the first
        and of the second half of the samples, ``(P,)``.
        """
        sums = super().sums()
        del sums["pattern"]
        return sums | {"halves": self._halves}
