"""Errors of images against references.

A reference that was rendered itself has noise. Two independent halves r1, r2 of it give an estimate without that noise:
``mean[(x - r1)(x - r2)]`` has the expectation of ``mean[(x - r)^2]`` with the exact r.
"""

from __future__ import annotations

import numpy as np

from dmis.variance import patch_sum
from dmis.vec import Array

BLOCK = 16
"""Pixels on a side of what counts as independent in the error of one image, as far as the thesis's patches reach."""


def squared_error(image: Array, first: Array, second: Array | None = None) -> Array:
    """Squared error of each pixel, mean over channels, ``(H, W)``; with two halves single values may be negative."""
    return _product(image, first, second).mean(axis=2)


def mean_over_blocks(values: Array) -> tuple[float, float]:
    """Mean of `values` ``(H, W)``, such as squared errors of pixels, and its standard error.

    Pixels have samples of their own, but share with their neighbours what a rule has learned, and so their errors: the
    standard error is from the spread of sums over blocks of `BLOCK` pixels, smaller ones in images of few. It counts
    that values are unevenly divided over the image, too, and is rather too large for that.
    """
    height, width = values.shape
    mean = np.mean(values, dtype=np.float64)
    sums = patch_sum(values - mean, max(1, min(BLOCK, int(np.sqrt(height * width / 64)))))
    return float(mean), _error_of_sum(sums) / values.size


def ratio_over_blocks(values: Array, baseline: Array) -> tuple[float, float]:
    """Ratio of the means of two maps ``(H, W)``, such as squared errors of two images of a scene, and half of its 95 %
    confidence interval, by the spread of ``values - ratio * baseline`` as in `mean_over_blocks`: what is uneven in both
    alike does not count.
    """
    quotient = np.mean(values, dtype=np.float64) / np.mean(baseline, dtype=np.float64)
    _, error = mean_over_blocks(values - quotient * baseline)
    return float(quotient), float(1.96 * error / abs(np.mean(baseline, dtype=np.float64)))


def _error_of_sum(parts: Array) -> float:
    """Standard error of the sum of independent `parts`, less their mean; `nan` of a single one."""
    n = parts.size
    return float(np.sqrt((parts**2).sum() * n / (n - 1))) if n > 1 else float("nan")


def mse(image: Array, first: Array, second: Array | None = None) -> float:
    """Mean squared error over pixels and channels, against a reference or two independent halves of one.

    Parameters
    ----------
    image, first, second
        ``(H, W, 3)`` linear RGB. With two halves the reference's own noise is not counted; without `second` it is.

    Raises
    ------
    ValueError
        If they differ in shape.
    """
    return float(_product(image, first, second).mean())


def mean_and_error(values: Array) -> tuple[float, float]:
    """Mean of independent values, such as those of seeds, and its standard error, `nan` for a single one."""
    values = np.asarray(values, np.float64).reshape(-1)
    spread = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    return float(values.mean()), float(spread)


def ratio(values: Array, baseline: Array, confidence: float = 0.95) -> tuple[float, float]:
    """Ratio of two means over the same seeds, and half the width of its confidence interval.

    By the delta method: the deviations ``values - ratio * baseline`` have mean zero, and their spread over the mean
    of the baseline is the ratio's standard error. The interval is Student's, since seeds are few.

    Parameters
    ----------
    values, baseline
        One number per seed, ``(K,)``, such as mean squared errors of two rules; `nan` half-width for K = 1.
    """
    values, baseline = np.asarray(values, np.float64), np.asarray(baseline, np.float64)
    if values.shape != baseline.shape or values.ndim != 1 or not len(values):
        raise ValueError(
            f"values and baseline must hold one number for each seed; got {values.shape}, {baseline.shape}"
        )
    quotient = values.mean() / baseline.mean()
    if len(values) < 2:
        return float(quotient), float("nan")
    from scipy.stats import t  # imported where used: scipy.stats takes half a second

    _, error = mean_and_error(values - quotient * baseline)
    return float(quotient), float(t.ppf((1 + confidence) / 2, len(values) - 1) * error / abs(baseline.mean()))


def relmse(image: Array, first: Array, second: Array | None = None, epsilon: float = 0.01) -> float:
    """Mean of ``(x - r)^2 / (r^2 + epsilon)`` over pixels and channels, no outliers trimmed.

    Parameters
    ----------
    image, first, second
        See `mse`; r is the mean of the halves. In the denominator its noise does count: of a reference of few samples
        the result is too large.
    epsilon
        In units of radiance, squared: what is much darker than its root counts little.

    Raises
    ------
    ValueError
        If the images differ in shape.
    """
    reference = _mean(first, second)
    return float((_product(image, first, second) / (reference * reference + epsilon)).mean())


def block_error(image: Array, reference: Array, size: int = 8) -> float:
    """Relative L2 difference of the means over blocks: ``sqrt(sum (A - R)^2 / sum R^2)``; ragged borders are left
    out.
    """
    a, r = (_blocks(np.asarray(x, np.float64), size) for x in (image, reference))
    return float(np.sqrt(((a - r) ** 2).sum() / (r * r).sum()))


def _mean(first: Array, second: Array | None) -> Array:
    first = np.asarray(first, np.float64)
    return first if second is None else (first + second) / 2


def _product(image: Array, first: Array, second: Array | None) -> Array:
    image = np.asarray(image, np.float64)
    second = first if second is None else second
    if image.shape != np.shape(first) or image.shape != np.shape(second):
        raise ValueError(
            f"image and reference must have the same shape; got {image.shape}, {np.shape(first)}, {np.shape(second)}"
        )
    return (image - first) * (image - second)


def _blocks(image: Array, size: int) -> Array:
    size = min(size, *image.shape[:2])
    height, width = (n // size * size for n in image.shape[:2])
    return image[:height, :width].reshape(height // size, size, width // size, size, -1).mean(axis=(1, 3))
