"""Division of shading samples between techniques: systematic rounding, or at random for teaching.

A camera sample carries S shading samples. A share ``w`` of a pixel's ``n = S spp`` shading samples goes to the first
technique (light sampling), ``1 - w`` to the second (BRDF sampling). K techniques have shares ``w_1 .. w_K`` of sum 1,
a point of the simplex. Everywhere below a rule's fit they are an array ``(K, ...)``, see `shares_of`.

The shares are rounded to whole samples systematically, with a random offset per pixel: slot ``i`` goes
to the first technique where ``floor((i+1) w + xi) > floor(i w + xi)``. At w = 1/2 and S = 2 that is exactly one
sample of each technique per camera sample. Of more than two techniques, those behind the first divide what it leaves
in the same way, each with an offset of its own.

Estimates are divided by the nominal shares, not by the realised counts: every slot belongs to the first
technique with probability w over the offset, whatever its neighbours do, so the estimate is unbiased even where a
technique's count happens to be 0.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dmis.base.vectors import Array

Allocation = Literal["systematic", "random"]


def shares_of(weight: Array | float | Sequence[float]) -> Array:
    """Return the shares of all techniques, ``(K,)`` or ``(K, H, W)`` float32, from a rule's weight.

    A number or a map ``(H, W)`` is the share w of the first of two techniques, and becomes ``(w, 1 - w)``. An array
    ``(K,)`` or ``(K, H, W)`` has all shares already. This is the only place where the two forms meet.
    """
    shares = np.asarray(weight, np.float32)
    return shares if shares.ndim in (1, 3) else np.stack([shares, 1 - shares])


@dataclass(frozen=True, eq=False)
class Counts:
    """Numbers of shading samples of each technique, for each camera sample.

    Attributes
    ----------
    per_technique
        How many go to each technique but the last, which has the rest: ``(N,)`` int8, or one int for all camera
        samples.
    samples_before
        How many of its pixel's shading samples went to each technique before this camera sample, ``(K, N)``; None if
        the same number goes there every time, or at random, or if it was not tracked.
    """

    per_technique: tuple[np.ndarray | int, ...]
    samples_before: np.ndarray | None = None

    @property
    def first(self) -> np.ndarray | int:
        """Number of samples of the first technique."""
        return self.per_technique[0]

    def of_every_camera_sample(self, k: int, shading_samples: int) -> int | None:
        """Return how many of S shading samples every camera sample gives to technique `k`; None if they differ."""
        counts = [n for n in self.per_technique if isinstance(n, int)]
        if len(counts) < len(self.per_technique):
            return None
        return counts[k] if k < len(counts) else shading_samples - sum(counts)

    def take(self, index: np.ndarray) -> Counts:
        """Return the counts of the camera samples `index`."""
        samples_before = None if self.samples_before is None else self.samples_before.take(index, axis=1)
        return Counts(tuple(n if isinstance(n, int) else n.take(index) for n in self.per_technique), samples_before)


def allocate(
    shares: Array,
    shading_samples: int,
    pixel: np.ndarray,
    number: np.ndarray,
    offset: Array,
    rng: np.random.Generator | None,
    track_sequence: bool = True,
) -> Counts:
    """Divide the shading samples of N camera samples.

    Parameters
    ----------
    shares
        Of K techniques, ``(K, P)`` for P pixels, or ``(K, 1)`` for all of them.
    shading_samples
        S, shading samples per camera sample.
    pixel, number
        Pixel of each camera sample, and number of the sample within it, ``(N,)``.
    offset
        Random offsets of the systematic rounding in [0, 1), ``(K - 1, P)``.
    rng
        None for systematic rounding; otherwise each shading sample picks its technique at random (the one-sample
        model of MIS), with numbers from here.
    track_sequence
        Whether to count `Counts.samples_before`, which only samplers with a sequence ask for.
    """
    if shares.shape[1] == 1 and (rng is None or (shares == 1).any()):
        whole = [float(shading_samples * share) for share in shares[:-1, 0]]
        if all(n.is_integer() for n in whole):
            return Counts(tuple(int(n) for n in whole))
    if rng is not None:
        u = rng.random((shading_samples, len(pixel)), dtype=np.float32)
        bounds = (_of_samples(bound, pixel) for bound in itertools.accumulate(shares[:-1]))
        below = [(u < bound).sum(axis=0, dtype=np.int8) for bound in bounds]
        return Counts(tuple(np.diff(below, axis=0, prepend=np.int8(0))))
    per_technique: list[np.ndarray] = []
    samples_before: list[np.ndarray] = []
    slot, left = number * shading_samples, np.asarray(shading_samples)
    for k, (share, of_pixel) in enumerate(zip(shares[:-1], offset, strict=True)):
        fraction = share.astype(np.float64)  # of what the techniques before it have left
        if k:
            rest = shares[k:].sum(axis=0, dtype=np.float64)
            fraction = np.divide(fraction, rest, out=np.zeros_like(rest), where=rest > 0)
        fraction, start = _of_samples(fraction, pixel), of_pixel.take(pixel)
        before, after = ((n * fraction + start).astype(np.int32) for n in (slot, slot + left))  # rounded down
        per_technique.append(after - before)
        samples_before.append(before)
        slot, left = slot - before, left - per_technique[-1]
    return Counts(
        tuple(n.astype(np.int8) for n in per_technique), np.stack([*samples_before, slot]) if track_sequence else None
    )


def _of_samples(of_pixels: Array, pixel: np.ndarray) -> Array:
    """Return the values of the camera samples' pixels, ``(N,)``; one value for all pixels stays one."""
    return of_pixels if of_pixels.size == 1 else of_pixels.take(pixel)


def rounding_covariance(shares: Sequence[float], shading_samples: int) -> Array:
    """Return the covariance of ``n_k / S``, the realised shares of a camera sample's S shading samples, ``(K, K)``.

    They differ from the `shares` by the systematic rounding of `allocate`.
    """
    targets = np.asarray(shares, np.float64)
    covariance = np.zeros((len(targets), len(targets)))
    for probability, counts in _roundings(tuple(targets), shading_samples):
        off = np.array(counts) / shading_samples - targets
        covariance += probability * np.outer(off, off)
    return covariance


def _roundings(shares: tuple[float, ...], n: int) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Yield all ways to round n times the shares, with their probabilities."""
    if len(shares) == 1:
        yield 1.0, (n,)
        return
    rest = sum(shares)
    exact = n * shares[0] / rest if rest > 0 else 0.0
    low = math.floor(exact + 1e-9)
    for count, probability in ((low, 1 - exact + low), (low + 1, exact - low)):
        if probability > 1e-9:
            for other, counts in _roundings(shares[1:], n - count):
                yield probability * other, (count, *counts)
