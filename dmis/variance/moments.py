"""Means and variances of samples per pixel, which merge in any order and grouping; the film of an image.

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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dmis.base.patches import PATCH
from dmis.base.vectors import Array, distinct
from dmis.estimator.allocation import SampleBlock
from dmis.estimator.mis import BRDF, LIGHT, Technique
from dmis.estimator.records import BLOCKS


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
    """Accumulates the moments of P `pixels` from blocks of samples, each of all pixels or of some of them."""

    def __init__(self, pixels: int) -> None:
        self._pixels = pixels
        self._total = Moments(0, *np.zeros((2, 3, pixels)))

    def add(self, blocks: Sequence[SampleBlock], values: Array, subsets: Array | None = None) -> None:
        """Add the `values` ``(3, N)`` of the camera samples of a batch; `subsets` are those of `SubBlocks` alone."""
        for block in blocks:
            moments = Moments.of(values[:, block.columns].reshape(3, block.count, -1).swapaxes(0, 1))
            if len(block.pixels) == self._pixels:
                self._total = self._total.merge(moments)
            else:
                self._merge_some(moments, block.pixels)

    def _merge_some(self, block: Moments, pixels: np.ndarray) -> None:
        """Merge the moments of some `pixels`."""
        total = self._total
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
    """Accumulates the sub-blocks of P `pixels` with n samples each, ``(P,)`` or one number, as `PixelMoments` does."""

    def __init__(self, n: np.ndarray | int, pixels: int) -> None:
        self._n = np.broadcast_to(n, pixels)
        self._sum = np.zeros((BLOCKS, 3, pixels))

    def add(self, blocks: Sequence[SampleBlock], values: Array, subsets: Array | None = None) -> None:
        """Add the `values` ``(3, N)`` of the camera samples of a batch, and those of `subsets` by sub-block.

        The latter are ``(B, 3, N)``, see `dmis.estimator.patterns.LightSubsets`.
        """
        for block in blocks:
            samples = values[:, block.columns].reshape(3, block.count, -1).swapaxes(0, 1)
            numbers = self._n.take(block.pixels)
            for n in distinct(numbers):
                chosen = slice(None) if (numbers == n).all() else np.flatnonzero(numbers == n)
                part = samples[..., chosen]
                places = block.pixels[chosen]
                starts = -(-np.arange(min(n, BLOCKS) + 1) * n // min(n, BLOCKS)) - block.first
                for total, begin, end in zip(self._sum, starts[:-1], starts[1:], strict=False):
                    within = part[max(begin, 0) : max(end, 0)]
                    if len(within):
                        total[:, places] += within.sum(axis=0, dtype=np.float64)
        if subsets is not None:
            for block in blocks:
                sums = subsets[..., block.columns].reshape(BLOCKS, 3, block.count, -1).sum(axis=2, dtype=np.float64)
                self._sum[..., block.pixels] += sums

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
    """What the samples of a round add up to: moments of pixels, rays, and sums of a statistic.

    A tile makes a film of its pixels, which is merged into that of the image. A rule is sent the film of each round.

    Float32 has the seven digits of a mean of float32 samples, which is more than an estimate of a variance needs.
    Squares may be beyond its range, so the root of m2 is stored, which is of the size of the samples.

    Attributes
    ----------
    n
        Number of samples, the same for all pixels or ``(H, W, 1)``.
    mean, root
        Mean, and root of m2, the sum of squared deviations from it, ``(H, W, 3)`` float32.
    rays
        Rays traced, by kind.
    sums
        Sums of the round's statistic over patches of `dmis.base.patches.PATCH` pixels, ``(..., rows, columns)``.
    shading_samples
        Shading samples of each camera sample.
    features
        Feature buffers of these patches ``(C, rows, columns)``, or of pixels ``(C, H, W)``, as the round asked.
    techniques
        The techniques that took the samples.
    budget
        Camera samples per pixel of the whole render, the pilot's included.
    embree_seconds, worker_seconds
        Of a tile: CPU seconds of its ray queries, and of all of it if another process has rendered it; else 0.
    """

    n: int | Array
    mean: Array
    root: Array
    rays: Mapping[str, int] = field(default_factory=dict)
    sums: Mapping[str, Array] = field(default_factory=dict)
    shading_samples: int = 4
    features: Mapping[str, Array] = field(default_factory=dict)
    techniques: tuple[Technique, ...] = (LIGHT, BRDF)
    budget: int = 128
    embree_seconds: float = 0.0
    worker_seconds: float = 0.0

    @classmethod
    def of(cls, moments: Moments, **others: Any) -> Film:
        """Return the film of moments ``(H, W, 3)`` and `others` of its attributes."""
        return cls(moments.n, moments.mean, np.sqrt(moments.m2), **others)

    def __repr__(self) -> str:
        height, width = self.mean.shape[:2]
        techniques = " + ".join(technique.name for technique in self.techniques)
        sums = ", ".join(self.sums) or "none"
        return f"Film({width}x{height}, {np.mean(self.n):.3g} spp, {techniques}, sums: {sums})"

    @property
    def moments(self) -> Film:
        """The film without sums and features, which are large: what a later round is joined to."""
        return replace(self, sums={}, features={})

    def variance(self) -> Array:
        """Return the unbiased variance of one sample, see `Moments.variance`."""
        return Moments(self.n, self.mean, np.square(self.root, dtype=np.float64)).variance()

    def of_area(self, area: tuple[slice, slice]) -> Film:
        """Return the film with the moments of an area alone, as views; its rays and sums stay."""
        n = self.n if isinstance(self.n, int) else self.n[area]
        return replace(self, n=n, mean=self.mean[area], root=self.root[area])

    def merge(self, part: Film, area: tuple[slice, slice], before: Film | None = None) -> None:
        """Write the pixels and sums of a part of the image to their places in the arrays, and count its rays.

        The pixels are joined to those of the film `before`, which may have the same arrays.
        """
        pixels = part
        if before is not None:
            earlier = before.of_area(area)
            pixels = join_films(earlier, replace(part, n=self.of_area(area).n - earlier.n))
        assert isinstance(self.rays, dict) and isinstance(self.sums, dict)
        self.mean[area], self.root[area] = pixels.mean, pixels.root
        for kind, number in part.rays.items():
            self.rays[kind] = self.rays.get(kind, 0) + number
        for name, values in part.sums.items():
            if name not in self.sums:
                shape = (-(-n // PATCH) for n in self.mean.shape[:2])
                self.sums[name] = np.zeros((*values.shape[:-2], *shape))
            row, column = (side.start // PATCH for side in area)
            height, width = values.shape[-2:]
            self.sums[name][..., row : row + height, column : column + width] = values

    def lock(self) -> None:
        """Make all arrays read-only: the film is sent to a rule."""
        for array in (self.mean, self.root, *self.sums.values(), *self.features.values()):
            array.flags.writeable = False

    def unlocked(self) -> tuple[Array, Array]:
        """Return mean and root, to be overwritten."""
        self.mean.flags.writeable = self.root.flags.writeable = True
        return self.mean, self.root

    def variance_of_mean(self, rows: slice) -> Array:
        """Return the variance of the mean of the pixels of some rows, float64; NaN with one sample."""
        n = np.broadcast_to(self.n, (*self.mean.shape[:2], 1))[rows].astype(np.float64)
        freedom = np.where(n > 1, n - 1, np.nan)
        return np.asarray(np.square(self.root[rows], dtype=np.float64) / (freedom * n))


def join_films(first: Film, more: Film) -> Film:
    """Return the moments of both, float64; a pixel may have no samples in one of them.

    The variance of the mean is as if the two were independent, which is too large for points that go on.
    """
    n = first.n + more.n
    mean = (first.mean.astype(float) * first.n + more.mean.astype(float) * more.n) / n
    # the variance of the mean of k samples is root^2 / (k - 1) / k
    v = sum(np.square(film.root, dtype=np.float64) * film.n / np.maximum(film.n - 1, 1) for film in (first, more))
    return Film(n, mean, np.sqrt(v / n * (n - 1)))


def average_films(parts: Sequence[tuple[Film, int]], gain: float) -> tuple[Array, Array]:
    """Return the average of images with weights fixed beforehand, their budgets of samples, and its deviation.

    The results overwrite the arrays of the first part, row by row, because images are large. Both are in the
    units of the scene that was given, which has `gain` times the radiance of the one that was rendered.
    The actual numbers of adaptive samples depend on the pilot, and must not be weights: that would be biased.
    """
    total = sum(n for _, n in parts)
    image, deviation = parts[0][0].unlocked()
    for row in range(len(image)):
        at = slice(row, row + 1)
        mean, variance = np.zeros((2, *image[at].shape))
        for film, n in parts:
            mean += film.mean[at] * (n / total)
            variance += film.variance_of_mean(at) * (n / total) ** 2
        mean *= gain
        if not (np.abs(mean) <= np.finfo(np.float32).max).all():
            most = np.abs(mean).max()
            raise ValueError(f"radiance must be below 3.4e38, the largest float32; the image has {most:g}")
        with np.errstate(over="ignore"):  # a deviation may be beyond float32 where the mean is not
            image[at], deviation[at] = mean, np.sqrt(variance) * gain
    return image, deviation


def pilot_shares(parts: Sequence[tuple[Film, int]]) -> dict[str, float]:
    """Return the shares that all images but the first, those of pilots, have of the average with these weights.

    ``pilot_samples`` is that of the weights, ``pilot_variance`` that of the variance, where this is known.
    """
    total = sum(n for _, n in parts)
    # (n_k / n)^2 V_k, the variance of the average due to image k
    variances = [film.variance_of_mean(slice(None)) * (n / total) ** 2 for film, n in parts]
    known = np.isfinite(sum(variances))
    of_parts = [float(v.sum(where=known)) for v in variances]
    of_pilots = sum(of_parts[1:]) / max(sum(of_parts), 1e-300)
    return {"pilot_samples": 1 - parts[0][1] / total, "pilot_variance": of_pilots}
