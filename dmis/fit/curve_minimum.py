"""Choosing from curves: variance and cost of patches at every weight, and where both together are least."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmis.base.vectors import Array
from dmis.variance.curves import HALF, share_variance


@dataclass(frozen=True, eq=False)
class Pooled:
    """Curves averaged over patches, in any shape ``(...)``.

    Attributes
    ----------
    curve
        Variance of a camera sample as far as it depends on w, at the weights of `GRID`, ``(G, ...)``.
    square, cross
        Means over pixels of its square and of its product with itself at w = 1/2, for standard errors.
    pattern
        Variance of D over the pixel, which counts if light samples are unevenly divided, ``(G, ...)``.
    position
        The rest of it: that of the radiance over the pixel.
    pixels
        How many pixels were averaged.
    half
        Where in the grid the weights are that others are compared with: w = 1/2.
    """

    curve: Array
    square: Array
    cross: Array
    pattern: Array
    position: Array
    pixels: Array
    half: int = HALF

    @property
    def variance(self) -> Array:
        """Variance of a camera sample at each weight, ``(G, ...)``.

        An estimate: where the pilot is small it may be negative.
        """
        return self.curve + np.maximum(self.position, 0)

    def rows(self, block: slice) -> Pooled:
        """Those of some rows of patches, as views."""
        return replace(self, **{name: a[..., block, :] for name, a in vars(self).items() if np.ndim(a) > 1})

    def split(self, times: float, shading_samples: int) -> Pooled:
        """The curves of camera samples with that many times the `shading_samples` that these have.

        In standard errors the part that comes from rounding counts as known.
        """
        change = share_variance(shading_samples * times) - share_variance(shading_samples) / times
        more = np.reshape(change, (-1,) + (1,) * self.position.ndim) * self.pattern
        curve = self.curve / times
        square = self.square / times**2 + (2 * curve + more) * more
        cross = self.cross / times**2 + more * (curve[HALF] + more[HALF]) + curve * more[HALF]
        return replace(self, curve=curve + more, square=square, cross=cross)

    def gain_error(self, cost: Array) -> Array:
        """Standard error of ``curve cost - curve(1/2) cost(1/2)``, ``(G, ...)``, for costs ``(G,)``."""
        c = np.reshape(cost, (-1,) + (1,) * self.position.ndim)
        half = c[self.half]
        second = c * c * self.square - 2 * c * half * self.cross + half * half * self.square[self.half]
        mean = c * self.curve - half * self.curve[self.half]
        return np.sqrt(np.maximum(second - mean * mean, 0) / np.maximum(self.pixels - 1, 1))


def weighed(variance: Array, cost: Array, price: float | None) -> Array:
    """What is minimised patch by patch, from `variance` ``(G, ...)`` and `cost` ``(G,)`` of a camera sample.

    The error of an image times its time is ``sum(V / n) sum(n C)`` over patches. With the same number n of samples in
    all of them that is least where each minimises ``V + price C``, the price being ``sum V / sum C``: dark patches
    had better be cheap. With numbers in proportion to ``sqrt(V / C)``, `price` None, it is ``(sum sqrt(V C))^2``, and
    each minimises V C.
    """
    c = np.reshape(cost, (-1,) + (1,) * (variance.ndim - 1))
    return variance * c if price is None else variance + np.asarray(price * c, variance.dtype)


def least(curves: Pooled, cost: Array, guard: float, allowed: np.ndarray, price: float | None = None) -> np.ndarray:
    """Where variance and cost together are least (`weighed`): indices into the grid.

    w = 1/2 is left only for a gain of more than `guard` standard errors, in variance alone too: that something is
    cheaper is always sure, and would have the last word where the pilot knows nothing. And only for weights that are
    `allowed` ``(G,)``.
    """
    objective = weighed(curves.variance, cost, price)
    error = curves.gain_error(np.ones_like(cost))
    sure = curves.variance - curves.variance[curves.half] < -guard * error
    sure &= objective - objective[curves.half] < -guard * (curves.gain_error(cost) if price is None else error)
    sure &= np.reshape(allowed, (-1,) + (1,) * curves.position.ndim)
    sure[curves.half] = True
    return np.where(sure, objective, np.inf).argmin(axis=0)


def allowed(curve: Array) -> np.ndarray:
    """Which weights of the grid may be used, ``(G,)`` bool, by the curve of the whole image ``(G,)``.

    At its ends one technique is left out. Where that fails it is for rare samples that would count a lot, and that
    the pilot of a patch seldom has; the image's has some. So an end may be used if it is as good for the image.
    """
    out = np.ones(len(curve), bool)
    out[0], out[-1] = curve[0] <= curve[1], curve[-1] <= curve[-2]
    return out
