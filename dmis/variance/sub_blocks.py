"""Variance of a mean of low-discrepancy points: the spread of four contiguous sub-blocks.

The samples of a pixel are a sequence, whose neighbours fill each other's gaps, so their sample variance says little of
the error of their mean. Four contiguous parts of the sequence are four estimates of the same mean. As if they were
independent, the mean of all has the variance

    v = sum_b (n_b / n)^2 (m_b - m)^2 B / (B - 1),  B = 4.

They fill each other's gaps as well, so that v is too large: for an error that falls as n^-a, by ``(4^a - 1) / 3``, a
factor of 2 where a = 1.4. It costs nothing, and is never too small on average.
"""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Array
from dmis.variance.moments import Moments

BLOCKS = 4
"""Number of sub-blocks; a pixel of fewer samples has one for each."""


class SubBlocks:
    """Accumulates the sub-blocks of P pixels; takes samples as `dmis.variance.moments.PixelMoments` does.

    Parameters
    ----------
    n
        Samples of each pixel, one number or ``(P,)``.
    pixels
        P, number of pixels.
    """

    def __init__(self, n: np.ndarray | int, pixels: int) -> None:
        self._n = np.broadcast_to(n, pixels)
        self._sum = np.zeros((BLOCKS, 3, pixels))

    def add(self, samples: Array, pixels: np.ndarray, first: int) -> None:
        """Add the samples ``(count, 3, A)``, those from number `first` on, of the `pixels` ``(A,)``."""
        numbers = self._n.take(pixels)
        for n in np.unique(numbers):
            chosen = slice(None) if (numbers == n).all() else np.flatnonzero(numbers == n)
            part, of = samples[..., chosen], pixels[chosen]
            starts = _starts(int(n)) - first
            for block, begin, end in zip(self._sum, starts[:-1], starts[1:], strict=False):
                within = part[max(begin, 0) : max(end, 0)]
                if len(within):
                    block[:, of] += within.sum(axis=0, dtype=np.float64)

    def total(self) -> Moments:
        """Return mean and n of the samples, with the m2 that independent samples of the variance v would have."""
        n = np.maximum(self._n, 1)
        mean = self._sum.sum(axis=0) / n
        blocks = np.minimum(n, BLOCKS)
        v = np.zeros_like(mean)
        for b, total in enumerate(self._sum):
            # n_b of the n samples: those i with floor(i B / n) = b
            size = np.where(b < blocks, -(-(b + 1) * n // blocks) - -(-b * n // blocks), 0)
            v += np.square((total - size * mean) / n)
        v *= blocks / np.maximum(blocks - 1, 1)
        # the variance of a mean is m2 / (n - 1) / n
        number = int(self._n[0]) if (self._n == self._n[0]).all() else self._n[None].astype(float)
        return Moments(number, mean, v * n * (n - 1))


def _starts(n: int) -> np.ndarray:
    """Return where the sub-blocks of n samples begin, and the end of the last."""
    blocks = max(1, min(n, BLOCKS))
    return -(-np.arange(blocks + 1) * n // blocks)
