"""Statistics per pixel, mergeable in any order of splits; and square patches of pixels.

Means and sums of squared deviations are float64 from the first addition on (squares of float32 numbers overflow and
underflow where the numbers do not, and one pixel may have 65536 samples in a block), and merge by Chan, Golub and
LeVeque's formula (1983), which does not cancel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dmis.vec import Array

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
"""Weights of linear RGB in luminance (sRGB primaries), as in pbrt."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean and spread of n samples.

    Attributes
    ----------
    n
        Number of samples: the same for all entries, or an array that broadcasts to them.
    mean
        Their mean, any shape, float64.
    m2
        Sum of squared deviations from it, the same shape.
    """

    n: int | Array
    mean: Array
    m2: Array

    @classmethod
    def of(cls, samples: Array) -> Moments:
        """Moments over the first axis of `samples` ``(n, ...)``."""
        n = len(samples)
        mean = samples.sum(axis=0, dtype=np.float64) / n
        deviation = samples - mean.astype(samples.dtype)
        return cls(n, mean, np.square(deviation, dtype=np.float64).sum(axis=0))

    def merge(self, other: Moments) -> Moments:
        """Moments of both sets of samples together."""
        n = self.n + other.n
        delta = other.mean - self.mean
        return Moments(
            n, self.mean + delta * (other.n / n), self.m2 + other.m2 + delta * delta * (self.n * other.n / n)
        )

    def variance(self) -> Array:
        """Unbiased variance of one sample.

        From n samples its own relative standard error is ``sqrt(2 / (n - 1))`` for a normal distribution: 140 % at
        n = 2. Rendering is worse: with a spike that one sample in a hundred sees, two samples mostly report
        a variance far below the truth.

        Raises
        ------
        ValueError
            If there are fewer than two samples.
        """
        if np.min(self.n) < 2:
            raise ValueError(f"a variance needs at least two samples; got {np.min(self.n):g}")
        return self.m2 / (self.n - 1)


@dataclass(frozen=True, eq=False)
class Film:
    """Moments of the pixels of an image, in half the memory of `Moments`.

    Seven digits are what a mean of float32 samples has, and more than an estimate of a variance deserves. Squares may
    be beyond float32, so the root of m2 is kept, which is of the size of the samples.

    Attributes
    ----------
    n
        As in `Moments`.
    mean, root
        Mean, and root of m2, ``(H, W, 3)`` float32.
    """

    n: int | Array
    mean: Array
    root: Array

    @property
    def m2(self) -> Array:
        """Sum of squared deviations, float64."""
        return np.square(self.root, dtype=np.float64)

    def variance(self) -> Array:
        """See `Moments.variance`."""
        return Moments(self.n, self.mean, self.m2).variance()


def luminance(rgb: Array) -> Array:
    """Luminance of linear RGB in the last axis.

    Of a variance per channel it is the channels' variances weighted by luminance: the variance of the luminance of a
    grey that rises and falls as they do, and an upper bound of the variance of their own luminance.
    """
    return rgb @ LUMINANCE


def patch_sum(values: Array, size: int) -> Array:
    """Sums over square patches of `size` entries in the last two axes, ``(..., ceil(H / size), ceil(W / size))``.

    Patches at the right and bottom border may be smaller. A `size` larger than the image means one patch.
    """
    if size < 1:
        raise ValueError(f"patch must be at least 1 pixel; got {size}")
    if size == 1:
        return values
    for axis in (-2, -1):  # the first entries of all patches, the second, ...: np.add.reduceat is slow in short runs
        lines = np.moveaxis(values, axis, 0)
        total = lines[::size].copy(order="K")
        for k in range(1, min(size, len(lines))):
            part = lines[k::size]
            total[: len(part)] += part
        values = np.moveaxis(total, 0, axis)
    return values


def row_blocks(rows: int, size: int = 16) -> Iterator[slice]:
    """Some rows of an image after the other: what is worked out on the way stays small, and in the cache."""
    return (slice(k, min(k + size, rows)) for k in range(0, rows, size))


def patch_mean(image: Array, size: int) -> Array:
    """Means over square patches: each of the pixels that it has; see `patch_sum`."""
    if size == 1:
        return image
    return patch_sum(image, size) / patch_sum(np.ones(image.shape[-2:]), size)


def patch_spread(values: Array, size: int, shape: tuple[int, int]) -> Array:
    """The inverse of `patch_mean` in shape: each pixel of an image of `shape` gets its patch's value."""
    height, width = shape
    return values[np.arange(height)[:, None] // size, np.arange(width)[None] // size]
