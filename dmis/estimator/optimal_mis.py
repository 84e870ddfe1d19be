"""Combiners that need all samples of a pixel: the optimal weights of Kondapaneni et al. 2019.

Heuristics (`dmis.estimator.mis`) weigh each sample as it comes. The optimal combiner fits ``f`` by
``a_l p_l + a_b p_b`` over the samples of a pixel, and adds up the fit's integral, which is known because densities
integrate to 1 if rejected samples count, and what is left of f. It comes on top of any allocation.

The direct form, ``optimal``, applies the fit to the samples that it was made of: consistent, and slightly biased. The
progressive form, ``optimal-progressive``, applies it to later ones, and is unbiased.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.selection import take
from dmis.base.vectors import Array
from dmis.estimator.records import Record

MIN_SAMPLES_TO_FIT = 8
"""Samples of each technique that the fit needs in a pixel; with fewer the balance heuristic stays."""
STAGES = 16
"""Number of stages into which the progressive form divides the samples of a pixel: at 128 camera samples the first fit
has `MIN_SAMPLES_TO_FIT` samples of each technique, and misses a sixteenth of them.
"""


class Optimal:
    """Sums for the direct estimator of one tile: solve ``A a = b`` per pixel, light and channel; it is ``sum a``.

    With ``S = sum_k n_k p_k``, ``A_ij = sum p_i p_j / S^2`` and ``b_i = sum f p_i / S^2`` over all samples. Samples
    that met no light, or that the surface rejected, are no records: there the other density is 0, and they count.

    Parameters
    ----------
    shares
        Of the two techniques, ``(2, P)`` or ``(2, 1)``.
    samples
        Shading samples of each pixel in all, ``(P,)``.
    """

    stages = 1

    def __init__(self, shares: Array, samples: Array) -> None:
        pixels = len(samples)
        self._w = np.broadcast_to(np.asarray(shares[0], np.float64), (pixels,))
        self._samples = np.asarray(samples, np.float64)
        self._taken = np.zeros((2, pixels))
        self._keys: dict[tuple[int, ...], tuple[Array, Array, Array, Array]] = {}

    def add(self, records: Sequence[Record], pixel: Array, first: Array, shading_samples: int) -> None:
        """Add one block.

        Parameters
        ----------
        pixel
            Pixel of each camera sample, ``(N,)``.
        first
            How many shading samples of each camera sample went to the first technique, ``(N,)``.
        """
        pixels = len(self._samples)
        self._taken[0] += np.bincount(pixel, first, pixels)
        self._taken[1] += np.bincount(pixel, shading_samples - first, pixels)
        for record in records:
            if record.key not in self._keys:
                zeros = (np.zeros((3, pixels)), np.zeros((2, 3, pixels)), np.zeros((3, pixels)), np.zeros((2, pixels)))
                self._keys[record.key] = zeros
            a, b, plain, recorded = self._keys[record.key]
            at = take(pixel, record.sample)
            w, n = self._w.take(at), self._samples.take(at)
            light, brdf = record.pdf.astype(np.float64)
            mixture = np.maximum(n * (w * light + (1 - w) * brdf), 1e-300)
            light, brdf = light / mixture, brdf / mixture
            for k, product in enumerate((light * light, light * brdf, brdf * brdf)):
                a[k] += np.bincount(at, product, pixels)
            for channel in range(3):
                value = record.value[channel] / n  # f / S
                plain[channel] += np.bincount(at, value, pixels)
                b[0, channel] += np.bincount(at, value * light, pixels)
                b[1, channel] += np.bincount(at, value * brdf, pixels)
            recorded[record.technique_index] += np.bincount(at, minlength=pixels)

    def correction(self) -> Array:
        """Return the change of the mean of each pixel by the optimal weights, ``(3, P)``; 0 without a fit."""
        out = np.zeros((3, len(self._samples)))
        enough = (self._taken >= MIN_SAMPLES_TO_FIT).all(axis=0) & (self._w > 0) & (self._w < 1)
        share = np.where(enough, self._w, 0.5)
        alone = 1 / (self._samples * np.stack([share, 1 - share])) ** 2
        for a, b, plain, recorded in self._keys.values():
            missed = self._taken - recorded
            solved, good = _solve(a[0] + missed[0] * alone[0], a[1], a[2] + missed[1] * alone[1], b)
            out += np.where(good & enough, solved.sum(axis=0) - plain, 0)
        return out


class Progressive(Optimal):
    """Sums for the progressive estimator (Kondapaneni et al. 2019, Sec. 7): unbiased.

    The samples of a pixel are taken in `STAGES` stages. What all stages before found as ``a`` is the control variate of
    the next; it is 0 in the first, and until there are `MIN_SAMPLES_TO_FIT` samples of each technique. With n samples
    in all, n_k of them in stage k, the estimate is

        ``sum_k [sum_k f / S + sum_j a_j (n_k / n - sum_k p_j / S)]``,

    the second sums over the samples of stage k. Their terms have the mean 0 whatever a is, because a comes from other
    samples, and so does each stage's rounding of the shares (`slot`); hence samples must be independent. Costs the
    sums of the direct form for each stage. Known failures: few samples per pixel, where the first fit comes late and is
    noisy (of what the direct form saves, four fifths at 64 camera samples and half at 16 where f is smooth); spikes.
    """

    stages = STAGES

    def __init__(self, shares: Array, samples: Array) -> None:
        super().__init__(np.tile(np.broadcast_to(shares, (2, *samples.shape)), STAGES), np.tile(samples, STAGES))

    def correction(self) -> Array:
        """Return the change of the mean of each pixel by the control variates, ``(3, P)``."""
        taken, w, n = (a.reshape(*a.shape[:-1], STAGES, -1) for a in (self._taken, self._w, self._samples))
        usable = (w > 0) & (w < 1)
        share = np.where(usable, np.stack([w, 1 - w]), 0.5)
        enough = usable & (_before(taken) >= MIN_SAMPLES_TO_FIT).all(axis=0)
        out = np.zeros((3, taken.shape[-1]))
        for sums in self._keys.values():
            a, b, _, recorded = (total.reshape(*total.shape[:-1], STAGES, -1) for total in sums)
            missed = (taken - recorded) / (n * share) ** 2
            ll, lb, bb = a[0] + missed[0], a[1], a[2] + missed[1]
            fit, good = _solve(_before(ll), _before(lb), _before(bb), _before(b))
            # sum p_j / S, because n (w p_l + (1 - w) p_b) / S is 1
            density = n * np.stack([share[0] * ll + share[1] * lb, share[0] * lb + share[1] * bb])
            change = fit * (taken.sum(axis=0) / n - density)[:, None]
            out += np.where(good & enough, change, 0).sum(axis=(0, 2))
        return out


def slot(pixel: Array, number: Array, spp: Array | int, pixels: int, stages: int) -> Array:
    """Return pixel and stage of camera samples as one number, ``(N,)``: those of the first stage come first.

    Parameters
    ----------
    pixel, number
        Pixel of each, and number within it.
    spp
        Camera samples of each pixel, ``(P,)`` or one number.
    """
    if stages == 1:
        return pixel
    return number * stages // (spp if np.ndim(spp) == 0 else spp.take(pixel)) * pixels + pixel  # type: ignore[union-attr]


def _solve(ll: Array, lb: Array, bb: Array, b: Array) -> tuple[Array, Array]:
    """Return the solution of ``A a = b``, `b` ``(2, 3, ...)``, and whether there is one, ``(...)`` bool."""
    determinant = ll * bb - lb * lb
    good = determinant > 1e-9 * ll * bb
    return np.stack([bb * b[0] - lb * b[1], ll * b[1] - lb * b[0]]) / np.where(good, determinant, 1), good


def _before(sums: Array) -> Array:
    """Return the sums over the stages before each; stages are the last axis but one."""
    return np.cumsum(sums, axis=-2) - sums
