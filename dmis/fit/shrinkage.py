"""Shrinkage: the curve of each patch, moved towards those of its kind by as much as it is uncertain (empirical Bayes).

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

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dmis.base.patches import row_blocks
from dmis.base.vectors import Array
from dmis.fit.curve_minimum import Pooled


def shrink(
    curves: Pooled,
    kinds: Array | None = None,
    change: Callable[[Pooled], Pooled] = lambda curves: curves,
    in_place: bool = False,
) -> Pooled:
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
    change
        What is done with the curves of each patch beforehand, see `dmis.fit.curve_minimum.Pooled.split`.
    in_place
        Whether the arrays of `curves` may be written to.
    """
    rows = list(row_blocks(len(curves.position)))  # curves are large, and what is worked out on the way is more
    of = np.ones((1, *curves.position.shape), np.float32) if kinds is None else kinds

    def block(k: int) -> Pooled:
        return change(curves.rows(rows[k]))

    at, sums = curves.half, np.zeros((len(curves.curve), len(of)))
    for k, part in enumerate(map(block, range(len(rows)))):
        sums += _over(of[:, rows[k]], part.pixels * part.curve)
    lit = sums[at] > 0  # the other kinds are black
    if not lit.any():
        return change(curves)
    if not lit.all():
        of, sums = of[lit], sums[:, lit]
    rho = sums / sums[at]
    variance, scatter, weight = np.zeros((3, *rho.shape))
    for k, part in enumerate(map(block, range(len(rows)))):
        here = of[:, rows[k]]
        own = _Own.of(part, rho, here)
        trust = _divide(1.0, own.scale * own.scale + own.error, 0.0)
        variance += _over(here**2, part.pixels**2 * own.error)
        scatter += _over(here, trust * (own.e * own.e - own.error))
        weight += _over(here, trust * own.scale * own.scale)
    tau_2, rho_error = np.maximum(_divide(scatter, weight, 0.0), 0), variance / sums[at] ** 2
    out = curves
    if not in_place:
        curve, square, cross = np.empty((3, *curves.curve.shape))
        out = replace(curves, curve=curve, square=square, cross=cross)
    for k, part in enumerate(map(block, range(len(rows)))):
        own, found = _Own.of(part, rho, of[:, rows[k]]), out.rows(rows[k])
        prior = own.scale * own.scale * _spread(own.share_of, tau_2)
        share = _divide(prior, prior + own.error, 1.0)
        mean = own.rho * own.scale + share * own.e
        posterior = share * own.error + ((1 - share) * own.scale) ** 2 * _spread(own.share_of**2, rho_error)
        # such that `Pooled.gain_error` is the root of the posterior variance, times cost
        found.curve[:] = mean
        found.square[:] = mean * mean + np.maximum(part.pixels - 1, 1) * posterior
        found.cross[:] = mean * mean[at]
    return out


@dataclass(frozen=True, eq=False)
class _Own:
    """Of some patches: shares of the kinds, the shape of these, the scale s, and e with the square of its error."""

    share_of: Array
    rho: Array
    scale: Array
    e: Array
    error: Array

    @classmethod
    def of(cls, curves: Pooled, rho: Array, of: Array) -> _Own:
        at = curves.half
        half, freedom = curves.curve[at], np.maximum(curves.pixels - 1, 1)
        scale = np.maximum(half, np.sqrt(np.maximum(curves.square[at] - half * half, 0) / freedom))
        share_of = _divide(of, of.sum(axis=0), 0.0)
        shape = _spread(share_of, rho)
        e = curves.curve - shape * half
        second = curves.square - 2 * shape * curves.cross + shape * shape * curves.square[at]
        return cls(share_of, shape, scale, e, np.maximum(second - e * e, 0) / freedom)


def _over(of: Array, values: Array) -> Array:
    """Sums over the patches of each kind, ``(..., K)``."""
    return np.einsum("kyx,...yx->...k", of, values)


def _spread(of: Array, values: Array) -> Array:
    """What the kinds have, ``(..., K)``, back on their patches."""
    return np.einsum("kyx,...k->...yx", of, values)


def _divide(a: Array | float, b: Array, otherwise: float) -> Array:
    """a / b, and `otherwise` where b is 0."""
    return np.divide(a, b, out=np.full(np.broadcast_shapes(np.shape(a), b.shape), otherwise), where=b > 0)
