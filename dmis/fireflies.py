"""Fireflies: pixels that single samples have made much too bright; how to find them, and two ways to be rid of them.

An unbiased image is right in the mean, and a sample that comes once in a thousand may carry half of the light of its
pixel, five hundred times as bright as that. Nothing is done about that by default, because what removes fireflies
removes light: `clamp` and `median_of_means` are **biased**, and images that are made with them say so in their
provenance. What helps without a bias is a technique that samples what was found by accident, or more samples.
docs/fireflies.md measures all of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dmis.variance import luminance
from dmis.vec import Array

if TYPE_CHECKING:
    from dmis.render import Result

FEW = 4.0
"""A pixel of a firefly is the work of fewer than this many of its samples."""
SPREADS = 6.0
"""And is this many standard errors of its neighbours brighter than they are."""


def find_fireflies(image: Array, variance: Array, samples: Array) -> np.ndarray:
    """Which pixels look like fireflies, ``(H, W)`` bool; a matter of milliseconds, whatever the number of samples.

    Two conditions, both on luminance, of which the variance is that of channels that rise and fall together. The mean
    x of n samples with the estimated variance v of this mean is carried by ``k = 1 / (v / x^2 + 1 / n)`` samples
    (Kish's effective number, ``(sum Y)^2 / sum Y^2``): by one, if all others are black. It must be less than `FEW`. And
    x must exceed the median of the eight pixels around it by `SPREADS` times their median standard error, and be twice
    as large. A small lamp that is seen directly passes the second, not the first; a dark corner that few samples reach
    passes the first.

    Parameters
    ----------
    image, variance
        ``(H, W, 3)`` linear RGB, and the variance of it, see `dmis.render.Result`. Where the variance is not known,
        with one sample, nothing is found.
    samples
        Camera samples of each pixel, ``(H, W)`` or one number.
    """
    x, v = luminance(np.asarray(image, np.float64)), luminance(np.sqrt(np.asarray(variance, np.float64))) ** 2
    carried = v + x * x / samples > x * x / FEW  # False where v is not a number
    near, noise = _around(x), np.sqrt(_around(v))
    return carried & (x > near + SPREADS * noise) & (x > 2 * near)


def _around(values: Array) -> Array:
    """Median of the eight neighbours in ``(H, W)``; the border is reflected."""
    height, width = values.shape
    wide = np.pad(values, 1, mode="reflect" if min(height, width) > 1 else "edge")
    places = [(dy, dx) for dy in range(3) for dx in range(3) if (dy, dx) != (1, 1)]
    return np.asarray(np.median([wide[dy : dy + height, dx : dx + width] for dy, dx in places], axis=0))


def clamp(radiance: Array, most: float) -> Array:
    """**Biased.** Camera samples ``(3, N)``, those with a channel above `most` scaled down to it, in their own colour.

    What is cut off is gone: the image is darker in the mean wherever a sample exceeds `most`, first where light is
    focused and where lamps and highlights are seen. No number of samples mends that.
    """
    brightest = radiance.max(axis=0)
    if not (brightest > most).any():
        return radiance
    return radiance * np.minimum(1, np.float32(most) / np.maximum(brightest, np.float32(most)))


def median_of_means(results: Sequence[Result]) -> Result:
    """**Biased.** The pixel-wise median of the images of independent renders, channel by channel.

    A firefly is in few of the renders, and the median passes over it. It passes over its light, too: the means of
    skewed samples mostly lie below their expectation, so that the median does, and the image is too dark where it is
    noisy. The bias vanishes as each render gets more samples. Of K renders without outliers the variance is up to pi/2
    times that of their mean.

    Parameters
    ----------
    results
        At least three, an odd number, of the same scene, rule, samples and settings, with different seeds.

    Returns
    -------
    Result
        With the samples, rays and seconds of all. Its variance is pi/2 times that of the mean.

    Raises
    ------
    ValueError
        If they are too few, or of different images, or two have the same seed.
    """
    from dmis.render import Result

    number = len(results)
    if number < 3 or number % 2 == 0:
        raise ValueError(f"results must be an odd number of at least 3, so that one is in the middle; got {number}")
    seeds = [result.provenance["seed"] for result in results]
    if len(set(seeds)) < number:
        raise ValueError(f"results must have different seeds, because equal ones are no new evidence; got {seeds}")
    same = {name: results[0].provenance[name] for name in ("scene_hash", "resolution", "rule", "spp", "settings")}
    for name, value in same.items():
        if any(result.provenance[name] != value for result in results):
            raise ValueError(f"results must be of the same image; they differ in {name}")
    rays = sum((Counter(result.rays) for result in results), Counter[str]())
    bias = [*results[0].provenance.get("bias", ()), f"median of means of {number} renders"]
    return Result(
        image=np.median([result.image for result in results], axis=0).astype(np.float32),
        deviation=np.sqrt(np.pi / 2 / number * np.mean([result.variance for result in results], axis=0)).astype(
            np.float32
        ),
        weight=np.mean([result.weight for result in results], axis=0),
        samples=np.sum([result.samples for result in results], axis=0),
        seconds={name: sum(result.seconds[name] for result in results) for name in results[0].seconds},
        rays=dict(rays),
        maps={},
        provenance={**results[0].provenance, "seed": seeds, "rays": dict(rays), "bias": bias},
    )
