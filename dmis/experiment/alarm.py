"""Alarm for images whose mean differs from that of their reference by more than noise explains.

A reference of another scene, or of an earlier lobe, makes every error in a table wrong, and none of them looks wrong.
The means of the two images show it, because their noise is small.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.experiment.reference import Reference

ALARM_LIMIT = 6.0
"""Difference between the means of image and reference that raises an alarm, in standard errors."""
NOISE_LIMIT = 0.05
"""Largest mean squared error of a reference, over the smallest error that is measured against it."""


class ReferenceWarning(UserWarning):
    """Warning that the means of an image and of its reference differ by more than `ALARM_LIMIT` standard errors."""


def mean_z(image: Array, reference: Reference, spp: int) -> float:
    """Return the difference of the means of image and reference in standard errors, of the channel where it is largest.

    The image ``(H, W, 3)`` was rendered with `spp` camera samples per pixel.
    With d = x - (r1 + r2) / 2 in N pixels, ``z = mean d / s``, where s^2 is the larger of two estimates:

    * ``mean d^2 / N``: if both images are right, d has mean 0 in every pixel, and pixels are uncorrelated. A difference
      that is no noise is in s, too: z is at most the root of N, so an image of less than 37 pixels raises no alarm.
    * The noise of the reference by its halves, ``mean (r1 - r2)^2 / 4 N``, scaled from its samples to those of the
      image: an image that misses rare bright samples is smooth, and its d^2 too small.
    """
    difference = np.asarray(image, np.float64) - reference.mean
    halves = (reference.first.astype(np.float64) - reference.second) ** 2 / 4
    noise = halves.mean(axis=(0, 1)) * (1 + 2 * reference.spp / spp)
    # s^2 = max(mean d^2, noise of image and reference by the halves) / N
    error = np.sqrt(np.maximum((difference**2).mean(axis=(0, 1)), noise) / (difference.size / 3))
    mean = difference.mean(axis=(0, 1))
    z = np.divide(mean, error, out=np.zeros(3), where=error > 0)
    return float(z[np.argmax(np.abs(z))])


def summary(runs: Iterable[Any]) -> str:
    """Return one line with the number of `runs` that raise an alarm, the worst and its causes; empty if none does."""
    runs = list(runs)
    alarms = [run for run in runs if abs(run.mean_z) > ALARM_LIMIT]
    if not alarms:
        return ""
    worst = max(alarms, key=lambda run: abs(run.mean_z))
    return (
        f"Alarm in {len(alarms)} of {len(runs)} renders: the mean of the image is {abs(worst.mean_z):.1f} standard "
        f"errors {'above' if worst.mean_z > 0 else 'below'} that of its reference (rule {worst.rule}, {worst.spp} "
        f"samples per pixel, seed {worst.seed}). Possible causes: a reference of another scene; a stale one, made "
        f"before a lobe, light, camera or reader changed (delete its file, and raise "
        f"dmis.pipeline.fingerprint.MEANING if shipped code changed); a biased combiner (optimal), or a biased rule or "
        f"technique of your own; too few samples, so that rare bright ones are missing (raise spp)."
    )


def reference_noise(reference: Reference, errors: Iterable[float]) -> str:
    """Return a line if the reference's own error is more than `NOISE_LIMIT` of the smallest of `errors`, else ""."""
    smallest = min(errors, default=float("inf"))
    if not reference.mse > NOISE_LIMIT * smallest:
        return ""
    return (
        f"The reference is too noisy for this table: its own mean squared error is {reference.mse:.2g}, more than "
        f"{NOISE_LIMIT:.0%} of the smallest error here, {smallest:.2g}. Render it with more samples per pixel "
        f"(--reference-spp)."
    )
