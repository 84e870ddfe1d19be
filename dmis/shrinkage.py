"""Shrinkage: the curve of each patch, moved towards those of its kind by as much as it is uncertain (empirical Bayes).

Patches differ in brightness by orders of magnitude, so what they share can only be the shape of their curves: ``rho(w)
= sum V(w) / sum V(1/2)`` over all patches of a kind. (A mean of the patches' own ratios would favour those whose pilot
missed a spike.) Kinds are materials, where it is known what the camera sees (`dmis.guides`): gold and the floor under
it do not share a shape, and whichever covers more of the image would speak for both. Else all patches are of one kind.

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

from dataclasses import replace

import numpy as np

from dmis.curves import Pooled
from dmis.vec import Array


def shrink(curves: Pooled, kinds: Array | None = None) -> Pooled:
    """The curves of patches ``(G, rows, columns)``, moved towards the shape of their kind; errors are those after it.

    The scale of a patch is V(1/2), or its standard error if that is more: the estimate of a quiet patch may be
    negative, which would turn the shape upside down. Where the curve of a kind is bad, such as at an end of the grid
    where few patches see the spikes that matter, it warns those that saw none.

    Two failures are known. Where a patch saw no spike, sigma is too small as well, and the patch keeps more of its
    curve than it should. And neighbours that a filter has made alike count as independent in the error of rho.

    Parameters
    ----------
    kinds
        Which share of each patch is of which kind, ``(K, rows, columns)``, of sum 1; patches of several have the mean
        of their shapes. None: all are of one kind.
    """
    at = curves.half
    curve, half, pixels = curves.curve, curves.curve[at], curves.pixels
    of = np.ones((1, *half.shape)) if kinds is None else kinds
    total = _over(of, pixels * half)
    if not (total > 0).any():
        return curves
    of, total = of[total > 0], total[total > 0]  # the others are black
    share_of = _divide(of, of.sum(axis=0), 0.0)
    freedom = np.maximum(pixels - 1, 1)
    scale = np.maximum(half, np.sqrt(np.maximum(curves.square[at] - half * half, 0) / freedom))
    rho = _spread(share_of, _over(of, pixels * curve) / total)
    e = curve - rho * half
    second = curves.square - 2 * rho * curves.cross + rho * rho * curves.square[at]
    error = np.maximum(second - e * e, 0) / freedom
    rho_error = _spread(share_of**2, _over(of**2, pixels**2 * error) / total**2)
    trust = _divide(1.0, scale * scale + error, 0.0)
    scatter = _divide(_over(of, trust * (e * e - error)), _over(of, trust * scale * scale), 0.0)
    prior = scale * scale * _spread(share_of, np.maximum(scatter, 0))
    share = _divide(prior, prior + error, 1.0)
    mean = rho * scale + share * e
    posterior = share * error + ((1 - share) * scale) ** 2 * rho_error
    # such that `Pooled.gain_error` is the root of the posterior variance, times cost
    return replace(curves, curve=mean, square=mean * mean + freedom * posterior, cross=mean * mean[at])


def _over(of: Array, values: Array) -> Array:
    """Sums over the patches of each kind, ``(..., K)``."""
    return np.einsum("kyx,...yx->...k", of, values)


def _spread(of: Array, values: Array) -> Array:
    """What the kinds have, ``(..., K)``, back on their patches."""
    return np.einsum("kyx,...k->...yx", of, values)


def _divide(a: Array | float, b: Array, otherwise: float) -> Array:
    """a / b, and `otherwise` where b is 0."""
    return np.divide(a, b, out=np.full(np.broadcast_shapes(np.shape(a), b.shape), otherwise), where=b > 0)
