"""Means and variances of samples per pixel, which merge in any order and grouping.

Means and sums of squared deviations are float64 from the first addition on (squares of float32 numbers overflow and
underflow where the numbers do not, and one pixel may have 65536 samples in a block), and merge by Chan, Golub and
LeVeque's formula (1983), which does not cancel.

*Low-discrepancy points.* The samples of a pixel are then a sequence, whose neighbours fill each other's gaps, so their
sample variance says little of the error of their mean. Four contiguous parts of the sequence are four estimates of the
same mean (`SubBlocks`). As if they were independent, the mean of all has the variance

    v = sum_b (n_b / n)^2 (m_b - m)^2 B / (B - 1),  B = 4.

They fill each other's gaps as well, so that v is too large: for an error that falls as n^-a, by ``(4^a - 1) / 3``, a
factor of 2 where a = 1.4. It costs nothing, and is never too small on average.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.patterns import BLOCKS


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean and sum of squared deviations of n samples.

    Attributes
    ----------
    n
        Number of samples: the same for all entries, or an array that broadcasts to them.
    mean
        Their mean, any shape, float64.
    m2
        Sum of squared deviations from the mean, the same shape, float64.
    """

    n: int | Array
    mean: Array
    m2: Array

    @classmethod
    def of(cls, samples: Array) -> Moments:
        """Return the moments over the first axis of `samples` ``(n, ...)``."""
        # m2 = sum_i (x_i - mean)^2
        n = len(samples)
        mean = samples.sum(axis=0, dtype=np.float64) / n
        deviation = samples - mean.astype(samples.dtype)
        return cls(n, mean, np.square(deviation, dtype=np.float64).sum(axis=0))

    def merge(self, other: Moments) -> Moments:
        """Return the moments of the samples of both."""
        # m2 = m2_a + m2_b + (mean_b - mean_a)^2 n_a n_b / n   (Chan, Golub and LeVeque 1983)
        n = self.n + other.n
        delta = other.mean - self.mean
        return Moments(
            n, self.mean + delta * (other.n / n), self.m2 + other.m2 + delta * delta * (self.n * other.n / n)
        )

    def variance(self) -> Array:
        """Return the unbiased variance of one sample, m2 / (n - 1), float64.

        Its relative standard error from n samples is ``sqrt(2 / (n - 1))`` for a normal distribution: 140 % at n = 2.
        Rendering is worse: with a spike that one sample in a hundred hits, two samples mostly report a variance far
        below the true one. A ValueError if there are fewer than two samples.
        """
        if np.min(self.n) < 2:
            raise ValueError(f"a variance needs at least two samples; got {np.min(self.n):g}")
        return self.m2 / (self.n - 1)


class PixelMoments:
    """Accumulates the moments of P pixels from blocks of samples, each of all pixels or of some of them.

    Parameters
    ----------
    pixels
        P, number of pixels.
    """

    def __init__(self, pixels: int) -> None:
        self._pixels = pixels
        self._total = Moments(0, *np.zeros((2, 3, pixels)))

    def add(self, samples: Array, pixels: np.ndarray, first: int = 0) -> None:
        """Add n samples of each of A `pixels` ``(A,)``, which differ and ascend; `samples` are ``(n, 3, A)``.

        Their numbers, from `first` on, do not matter here.
        """
        total = self._total
        block = Moments.of(samples)
        if len(pixels) == self._pixels:
            self._total = total.merge(block)
            return
        n = np.broadcast_to(total.n, (1, self._pixels)).astype(float)
        merged = Moments(n[:, pixels], total.mean[:, pixels], total.m2[:, pixels]).merge(block)
        n[:, pixels] = merged.n
        total.mean[:, pixels] = merged.mean
        total.m2[:, pixels] = merged.m2
        self._total = Moments(n, total.mean, total.m2)

    def total(self) -> Moments:
        """Return the moments of all samples that were added, ``(3, P)``; ``(1, P)`` numbers where they differ."""
        return self._total


class SubBlocks:
    """Accumulates the sub-blocks of P pixels; takes samples as `PixelMoments` does.

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
            part = samples[..., chosen]
            places = pixels[chosen]
            blocks = max(1, min(int(n), BLOCKS))
            starts = -(-np.arange(blocks + 1) * int(n) // blocks) - first
            for block, begin, end in zip(self._sum, starts[:-1], starts[1:], strict=False):
                within = part[max(begin, 0) : max(end, 0)]
                if len(within):
                    block[:, places] += within.sum(axis=0, dtype=np.float64)

    def add_sums(self, sums: Array, pixels: np.ndarray) -> None:
        """Add to the sums of the sub-blocks of the `pixels` ``(A,)``; `sums` are ``(B, 3, A)``."""
        self._sum[:, :, pixels] += sums

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


@dataclass(frozen=True, eq=False)
class Film:
    """Moments of the pixels of an image, in half the memory of `Moments`.

    Float32 has the seven digits of a mean of float32 samples, which is more than an estimate of a variance needs.
    Squares may be beyond its range, so the root of m2 is stored, which is of the size of the samples.

    Attributes
    ----------
    n
        Number of samples, as in `Moments`.
    mean, root
        Mean, and root of m2, ``(H, W, 3)`` float32.
    """

    n: int | Array
    mean: Array
    root: Array

    def variance(self) -> Array:
        """Return the unbiased variance of one sample, see `Moments.variance`."""
        return Moments(self.n, self.mean, np.square(self.root, dtype=np.float64)).variance()


def join(first: Film, more: Film) -> Film:
    """Return the moments of both; a pixel may have no samples in one of them.

    The variance of the mean is as if the two were independent, which is too large for points that go on.
    """
    n = first.n + more.n
    mean = (first.mean * first.n + more.mean * more.n) / n
    # the variance of the mean of k samples is root^2 / (k - 1) / k
    v = sum(np.square(film.root, dtype=np.float64) * film.n / np.maximum(film.n - 1, 1) for film in (first, more))
    return Film(n, mean, np.sqrt(v / n * (n - 1)))
