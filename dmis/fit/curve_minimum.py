"""Minimum of variance curves: V(w) of patches at every share w, and the share where variance and cost are least."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmis.base.patches import row_blocks
from dmis.base.vectors import Array
from dmis.variance.curves import HALF


@dataclass(frozen=True, eq=False)
class PatchCurves:
    """Variance curves V(w), averaged over the pixels of each patch, in any shape ``(...)``.

    Attributes
    ----------
    curve
        Part of the variance of a camera sample that depends on w, at the G shares of the grid, ``(G, ...)``.
    gain_square
        Means over pixels of the square of its difference from the baseline point, for standard errors.
    position
        Var_y(I), the part of the variance that does not depend on w.
    pixels
        Number of pixels in each mean.
    baseline
        Index of the baseline point, which rules leave only for a significant gain: of w = 1/2.
    pattern
        Var_y(D), the variance that uneven numbers of light samples add, ``(G, ...)``; None if it was not gathered.
    """

    curve: Array
    gain_square: Array
    position: Array
    pixels: Array
    baseline: int = HALF
    pattern: Array | None = None

    @property
    def variance(self) -> Array:
        """Variance of a camera sample at each share, ``(G, ...)``.

        An estimate: where the pilot is small it may be negative.
        """
        return self.curve + np.maximum(self.position, 0)

    def rows(self, block: slice) -> PatchCurves:
        """Return the curves of some rows of patches, as views."""
        return replace(self, **{name: a[..., block, :] for name, a in vars(self).items() if np.ndim(a) > 1})

    def gain_error(self) -> Array:
        """Return the standard error of ``curve - curve(1/2)``, ``(G, ...)``."""
        mean = self.curve - self.curve[self.baseline]
        return np.sqrt(np.maximum(self.gain_square - mean * mean, 0) / np.maximum(self.pixels - 1, 1))


def guarded_argmin(curves: PatchCurves, cost: Array, guard: float, allowed: np.ndarray, price: float) -> np.ndarray:
    """Return the index into the grid at which ``V + price C`` is least, ``(rows, columns)``.

    The error of an image times its time is ``sum(V / n) sum(n C)`` over patches. With the same number n of samples in
    all of them that is least where each minimises ``V + price C``, the price being ``sum V / sum C``: dark patches
    had better be cheap.

    Parameters
    ----------
    curves
        Variance V of each patch at the G shares of the grid.
    cost
        Cost C of a camera sample at each share, ``(G,)``.
    guard
        Leave the baseline point only for a gain of more than this many standard errors, in variance alone too: a lower
        cost is always certain, and would decide alone where the pilot has no information.
    allowed
        Shares that may be used, ``(G,)`` bool, see `allowed_weights`.
    price
        Variance that a unit of cost is worth.
    """
    index = np.empty(curves.position.shape, np.intp)
    for rows in row_blocks(len(index)):  # curves are large, and intermediate results are larger
        block = curves.rows(rows)
        objective = block.variance + np.asarray(price * cost[:, None, None], block.variance.dtype)
        error = block.gain_error()
        significant = block.variance - block.variance[curves.baseline] < -guard * error
        significant &= objective - objective[curves.baseline] < -guard * error
        significant &= allowed[:, None, None]
        significant[curves.baseline] = True
        index[rows] = np.where(significant, objective, np.inf).argmin(axis=0)
    return index


def allowed_weights(curve: Array) -> np.ndarray:
    """Return which shares of the grid may be used, ``(G,)`` bool, by the curve of the whole image ``(G,)``.

    At the ends of the grid one technique is left out. Where that fails it fails by rare samples of large value, which
    the pilot of a patch seldom has; that of the image has some. So an end may be used if it is as good for the image
    as its neighbour.
    """
    allowed = np.ones(len(curve), bool)
    allowed[0] = curve[0] <= curve[1]
    allowed[-1] = curve[-1] <= curve[-2]
    return allowed
