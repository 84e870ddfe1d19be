"""Combiners that need all samples of a pixel: the optimal weights of Kondapaneni et al. 2019.

Heuristics (`dmis.estimator.mis`) weigh each sample as it comes. The optimal combiner fits ``f`` by
``a_l p_l + a_b p_b`` over the samples of a pixel, and adds up the fit's integral, which is known because densities
integrate to 1 if rejected samples count, and what is left of f. It comes on top of any allocation.

This is the direct form, which applies the fit to the samples that it was made of: consistent, and slightly biased.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.vectors import Array, take
from dmis.estimator.mis import Combiner
from dmis.estimator.records import Record

MIN_SAMPLES_TO_FIT = 8
"""Samples of each technique that the fit needs in a pixel; with fewer the balance heuristic stays."""


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
            w = self._w.take(at)
            n = self._samples.take(at)
            light, brdf = record.pdf.astype(np.float64)
            mixture = np.maximum(n * (w * light + (1 - w) * brdf), 1e-300)
            light = light / mixture
            brdf = brdf / mixture
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
        alone = 1 / (np.maximum(self._samples, 1) * np.stack([share, 1 - share])) ** 2
        for a, b, plain, recorded in self._keys.values():
            missed = self._taken - recorded
            solved, good = _solve(a[0] + missed[0] * alone[0], a[1], a[2] + missed[1] * alone[1], b)
            out += np.where(good & enough, solved.sum(axis=0) - plain, 0)
        return out


def _solve(ll: Array, lb: Array, bb: Array, b: Array) -> tuple[Array, Array]:
    """Return the solution of ``A a = b``, `b` ``(2, 3, ...)``, and whether there is one, ``(...)`` bool."""
    determinant = ll * bb - lb * lb
    good = determinant > 1e-9 * ll * bb
    return np.stack([bb * b[0] - lb * b[1], ll * b[1] - lb * b[0]]) / np.where(good, determinant, 1), good


OPTIMAL = Combiner("optimal", collector=Optimal)
"""Balance, and a correction of each pixel by the optimal weights."""
