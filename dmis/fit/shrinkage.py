"""Shrinkage of variance curves by empirical Bayes: the less certain a patch's curve, the closer to that of its kind.

Patches differ in brightness by orders of magnitude, so what they share can only be the shape of their curves: ``rho(w)
= sum V(w) / sum V(1/2)`` over all patches of a kind. (A mean of the patches' own ratios would favour those whose pilot
missed a spike.) Kinds are materials, where it is known what the camera sees (`dmis.scene.feature_buffers`): gold and
the floor under it do not share a shape, and whichever covers more of the image would speak for both. Else all patches
are of one kind.

Let s be the scale of a patch, its true V(1/2), and ``e(w) = V(w) - rho(w) V(1/2)`` from its pilot. No ratio of noisy
numbers is in e, its mean is 0 where the patch is like its kind, and its standard error sigma follows from the stored
squares and products. Suppose that the true relative deviations ``E[e] / s`` scatter by tau^2(w) about 0:

    tau^2 = sum u (e^2 - sigma^2) / sum u s^2,  u = 1 / (s^2 + sigma^2),  not below 0,

by the method of moments, in which each patch counts about once however bright it is (DerSimonian and Laird 1986 weigh
alike). The best linear estimate of the true curve (James and Stein 1961, Efron and Morris 1973) is then

    rho s + B e,  B = s^2 tau^2 / (s^2 tau^2 + sigma^2),

with the posterior variance ``B sigma^2 + (1 - B)^2 s^2 var(rho)``. B is 1 where sigma is small or patches differ much:
they keep their curves; 0 where all differences are noise: they take the shape of their kind, and its minimum. V(1/2)
stays as the scale, and is not taken for uncertain, because it has no bearing on where the minimum is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmis.base.patches import row_blocks
from dmis.base.vectors import Array
from dmis.fit.curve_minimum import PatchCurves


def shrink_in_place(curves: PatchCurves, kinds: Array | None = None) -> PatchCurves:
    """Overwrite the curves of patches ``(G, rows, columns)`` with those moved towards the shape of their kind.

    The scale of a patch is V(1/2), or its standard error if that is more: the estimate of a quiet patch may be
    negative, which would turn the shape upside down. Where the curve of a kind is bad, such as at an end of the grid
    where few patches see the spikes that matter, patches without a spike in their pilot are moved away from that end.

    Two failures are known. Where a patch saw no spike, sigma is too small as well, and the patch keeps more of its
    curve than it should. And neighbours that a filter has made alike count as independent in the error of rho.

    Parameters
    ----------
    kinds
        Share of each kind in each patch, ``(K, rows, columns)``, of sum 1; patches of several kinds have the mean of
        their shapes. None: all are of one kind.

    Returns
    -------
    The curves, with the errors that they have after shrinkage.
    """
    row_parts = list(row_blocks(len(curves.position)))  # curves are large, and intermediate results are larger
    if kinds is None:
        kinds = np.ones((1, *curves.position.shape), np.float32)
    # rho(w) = sum V(w) / sum V(1/2)
    sums = np.zeros((len(curves.curve), len(kinds)))
    for rows in row_parts:
        part = curves.rows(rows)
        sums += _sum_over_patches(kinds[:, rows], part.pixels * part.curve)
    lit = sums[curves.baseline] > 0  # the other kinds are black
    if not lit.any():
        return curves
    kinds, sums = kinds[lit], sums[:, lit]
    rho = sums / sums[curves.baseline]
    tau_2, rho_variance = _scatter_of_kinds(curves, rho, kinds)
    rho_variance /= sums[curves.baseline] ** 2
    for rows in row_parts:
        part = curves.rows(rows)
        mean, posterior = _Deviations.of(part, rho, kinds[:, rows]).shrunk(tau_2, rho_variance)
        # such that `PatchCurves.gain_error` is the root of the posterior variance
        part.curve[:] = mean
        part.square[:] = mean * mean + np.maximum(part.pixels - 1, 1) * posterior
        part.cross[:] = mean * mean[curves.baseline]
    return curves


def _scatter_of_kinds(curves: PatchCurves, rho: Array, kinds: Array) -> tuple[Array, Array]:
    """Return tau^2 of each kind, ``(G, K)``, and the variance of the sum of its curves, from which rho was made."""
    variance, scatter, weight = np.zeros((3, *rho.shape))
    for rows in row_blocks(len(curves.position)):
        part, of_kind = curves.rows(rows), kinds[:, rows]
        deviations = _Deviations.of(part, rho, of_kind)
        # tau^2 = sum u (e^2 - sigma^2) / sum u s^2,  u = 1 / (s^2 + sigma^2)
        u = _divide(1.0, deviations.scale * deviations.scale + deviations.error, 0.0)
        variance += _sum_over_patches(of_kind**2, part.pixels**2 * deviations.error)
        scatter += _sum_over_patches(of_kind, u * (deviations.e * deviations.e - deviations.error))
        weight += _sum_over_patches(of_kind, u * deviations.scale * deviations.scale)
    return np.maximum(_divide(scatter, weight, 0.0), 0), variance


@dataclass(frozen=True, eq=False)
class _Deviations:
    """Deviations e of the curves of patches from the shape of their kinds.

    Attributes
    ----------
    kinds
        Share of each kind in each patch, of sum 1, ``(K, rows, columns)``.
    rho, e, error
        Shape of the kinds, e, and the square of its standard error sigma, ``(G, rows, columns)``.
    scale
        s, ``(rows, columns)``.
    """

    kinds: Array
    rho: Array
    scale: Array
    e: Array
    error: Array

    @classmethod
    def of(cls, curves: PatchCurves, rho: Array, kinds: Array) -> _Deviations:
        """Return the deviations of `curves` from the shapes `rho` ``(G, K)``."""
        baseline = curves.baseline
        half, freedom = curves.curve[baseline], np.maximum(curves.pixels - 1, 1)
        scale = np.maximum(half, np.sqrt(np.maximum(curves.square[baseline] - half * half, 0) / freedom))
        kinds = _divide(kinds, kinds.sum(axis=0), 0.0)
        shape = _mean_of_kinds(kinds, rho)
        # e(w) = V(w) - rho(w) V(1/2)
        e = curves.curve - shape * half
        second = curves.square - 2 * shape * curves.cross + shape * shape * curves.square[baseline]
        return cls(kinds, shape, scale, e, np.maximum(second - e * e, 0) / freedom)

    def shrunk(self, tau_2: Array, rho_variance: Array) -> tuple[Array, Array]:
        """Return the shrunk curves and their posterior variance, ``(G, rows, columns)``."""
        # B = s^2 tau^2 / (s^2 tau^2 + sigma^2)
        prior = self.scale * self.scale * _mean_of_kinds(self.kinds, tau_2)
        b = _divide(prior, prior + self.error, 1.0)
        # rho s + B e, of the variance  B sigma^2 + (1 - B)^2 s^2 var(rho)
        mean = self.rho * self.scale + b * self.e
        variance = b * self.error + ((1 - b) * self.scale) ** 2 * _mean_of_kinds(self.kinds**2, rho_variance)
        return mean, variance


def _sum_over_patches(kinds: Array, values: Array) -> Array:
    """Return the sums of `values` ``(..., rows, columns)`` over the patches of each kind, ``(..., K)``."""
    return np.einsum("kyx,...yx->...k", kinds, values)


def _mean_of_kinds(kinds: Array, values: Array) -> Array:
    """Return on each patch the mean of the `values` ``(..., K)`` of its kinds, ``(..., rows, columns)``."""
    return np.einsum("kyx,...k->...yx", kinds, values)


def _divide(a: Array | float, b: Array, otherwise: float) -> Array:
    """Return a / b, and `otherwise` where b is 0."""
    return np.divide(a, b, out=np.full(np.broadcast_shapes(np.shape(a), b.shape), otherwise), where=b > 0)
