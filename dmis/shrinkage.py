"""Shrinkage: the curve of each patch, moved towards the image's by as much as it is uncertain (empirical Bayes).

Patches differ in brightness by orders of magnitude, so what they share can only be the shape of their curves: ``rho(w)
= sum V(w) / sum V(1/2)`` over the image. (A mean of the patches' own ratios would favour those whose pilot missed a
spike.) Let s be the scale of a patch, its true V(1/2), and ``e(w) = V(w) - rho(w) V(1/2)`` from its pilot. No ratio of
noisy numbers is in e, its mean is 0 where the patch is like the image, and its standard error sigma follows from the
stored squares and products. Suppose that the true relative deviations ``E[e] / s`` scatter by tau^2(w) about 0:

    tau^2 = sum u (e^2 - sigma^2) / sum u s^2,  u = 1 / (s^2 + sigma^2),  not below 0,

by the method of moments, in which each patch counts about once however bright it is (DerSimonian and Laird 1986 weigh
alike). The best linear estimate of the true curve (James and Stein 1961, Efron and Morris 1973) is then

    rho s + B e,  B = s^2 tau^2 / (s^2 tau^2 + sigma^2),

with the posterior variance ``B sigma^2 + (1 - B)^2 s^2 var(rho)``. B is 1 where sigma is small or patches differ much:
they keep their curves; 0 where all differences are noise: they take the image's shape, and its minimum. V(1/2) stays as
the scale, and is not taken for uncertain, because it has no bearing on where the minimum is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dmis.curves import HALF, Pooled
from dmis.vec import Array


def shrink(curves: Pooled) -> Pooled:
    """The curves of patches ``(G, rows, columns)``, moved towards their image's shape; errors are those after it.

    The scale of a patch is V(1/2), or its standard error if that is more: the estimate of a quiet patch may be
    negative, which would turn the image's curve upside down. Where the image's curve is bad, such as at an end of the
    grid where few patches see the spikes that matter, it warns those that saw none.

    Two failures are known. Where a patch saw no spike, sigma is too small as well, and the patch keeps more of its
    curve than it should. And neighbours that a filter has made alike count as independent in the error of rho.
    """
    curve, half, pixels = curves.curve, curves.curve[HALF], curves.pixels
    total = (pixels * half).sum()
    if total <= 0:
        return curves
    freedom = np.maximum(pixels - 1, 1)
    scale = np.maximum(half, np.sqrt(np.maximum(curves.square[HALF] - half * half, 0) / freedom))
    rho = _upright((pixels * curve).sum(axis=(1, 2)) / total)
    e = curve - rho * half
    second = curves.square - 2 * rho * curves.cross + rho * rho * curves.square[HALF]
    error = np.maximum(second - e * e, 0) / freedom
    rho_error = _upright((pixels**2 * error).sum(axis=(1, 2)) / total**2)
    trust = _divide(1.0, scale * scale + error, 0.0)
    scatter = (trust * (e * e - error)).sum(axis=(1, 2)) / (trust * scale * scale).sum(axis=(1, 2))
    prior = scale * scale * _upright(np.maximum(scatter, 0))
    share = _divide(prior, prior + error, 1.0)
    mean = rho * scale + share * e
    posterior = share * error + ((1 - share) * scale) ** 2 * rho_error
    # such that `Pooled.gain_error` is the root of the posterior variance, times cost
    return replace(curves, curve=mean, square=mean * mean + freedom * posterior, cross=mean * mean[HALF])


def _upright(values: Array) -> Array:
    return values[:, None, None]


def _divide(a: Array | float, b: Array, otherwise: float) -> Array:
    """a / b, and `otherwise` where b is 0."""
    return np.divide(a, b, out=np.full(b.shape, otherwise), where=b > 0)
