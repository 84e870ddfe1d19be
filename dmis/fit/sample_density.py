"""Numbers of camera samples of pixels, in proportion, from the first round of `dmis.fit.auto`.

The squared error of n low-discrepancy points falls as ``V n^-a``, with a = 1.4 or so, and a camera sample costs C. The
error of the image is the sum of ``V n^-a`` over its pixels, and its cost the sum of ``n C``. It is least where another
second lowers the error of every pixel by as much, ``a V n^(-a - 1) / C`` being the same everywhere:

    n ~ (V / C)^(1 / (1 + a)).

So a pixel of 32 times the variance gets four times the samples, not 32 times: its error falls fast with the first of
them, and slowly later.

**V** of the pattern of the first round is measured at each pixel: the spread of four sub-blocks of its samples
(`dmis.variance.moments.SubBlocks`), averaged over its neighbours. **Spikes**, such as the highlight that one sample in
a hundred finds, are mostly not among the few samples of a pixel, and their V is then far too small; so a part of the
variance of independent points, which a whole patch tells, is added.

**Weight.** Errors are relative: the error is the sum over pixels of V q n^-a, where q = 1 / (I^2 + e) and I is the
radiance of the pixel whose V it is, or with ``error=absolute`` q = 1. Neighbours are averaged as V q, because where one
of them is bright and another is black, a mean V over a mean I^2 has the noise of the first and the weight of the
second.

**Confidence.** V of a few samples is uncertain: where it is large it was partly luck, and its pixel needs fewer samples
than V says. So numbers follow V^t with a confidence t from 0, where all are equal, to 1: the one with which they would
have made the error of the first round least, in pixels of another colour.
"""

from __future__ import annotations

import numpy as np

from dmis.base.patches import COLOURS, PATCH, patch_mean, patch_spread, patch_sum, row_blocks
from dmis.base.vectors import TINY, Array
from dmis.filter import gaussian
from dmis.fit.best_pattern import HALF
from dmis.fit.curve_minimum import PatchCurves
from dmis.fit.round import Pilot

EXPONENT = 1.4
"""a of low-discrepancy points; of independent ones it is 1."""
CONFIDENCES = {"absolute": (1.0, 0.75, 0.5, 0.25, 0.0), "relative": (0.75, 0.5, 0.25, 0.0)}
"""Powers of the variance which numbers of samples may follow, by the error that is made least.

At 1 relMSE is larger where dark pixels have rare highlights, as on killeroo-gold, and a little smaller elsewhere.
"""
SPIKES = 0.1
"""Share of the variance of independent points that is added to that of a pixel."""
DARK = 0.1
"""e in relative errors, over the squared mean radiance of the image: near the .01 of relMSE where that mean is .3."""


def sample_density(variance: Array, cost: Array | float, exponent: float) -> Array:
    """Return numbers of camera samples in proportion, in the place of `variance`."""
    # n ~ (V / C)^(1 / (1 + a))
    variance /= cost
    variance **= 1 / (1 + exponent)
    return variance


def variance_of_mean(first: Pilot) -> Array:
    """Return the variance of the mean of each pixel's samples of the first round, ``(H, W)`` float32."""
    n_1 = int(np.max(first.moments.n))
    variance = np.einsum("yxc,yxc->yx", first.moments.root, first.moments.root, dtype=np.float64)
    variance /= 3 * n_1 * max(n_1 - 1, 1)
    return variance.astype(np.float32)


def variance_of_colour(
    first: Pilot, variance: Array, curves: PatchCurves, cost: float, colour: int, error: str, exponent: float
) -> tuple[Array, Array, float]:
    """Return (V q)^t of the pixels of one colour ``(A, B)``, n_1 / n of each patch ``(rows, columns)``, and t.

    V comes from the samples of the other colours. n_1 / n is that of pixels which keep the pattern of the first round.
    `variance` is `variance_of_mean`, `curves` are those of `dmis.fit.best_pattern`, `cost` is C of the first round's
    pattern; for `error` and `exponent`, a, see `dmis.fit.auto.Auto`.
    """
    n_1 = int(np.max(first.moments.n))
    weight, patch_weight = error_weight(first, colour, error)
    if error == "relative":
        variance = variance * weight
    # a part of (A(1/2) / 4 + P) / n_1,  the variance of independent points
    spikes = SPIKES * (np.maximum(curves.curve[HALF] / 2, 0) + np.maximum(curves.position, 0)) / n_1 * patch_weight
    # the opposite colour in 2x2 neighbours judges: the other two colours predict V of its pixels
    opposite = len(COLOURS) - 1 - colour
    judge = COLOURS[opposite]
    measured = patch_spread(first.sums["halves"][opposite], PATCH, variance.shape, judge) * weight[judge]
    predicted = neighbour_variance(variance, spikes, colour, opposite)[judge].copy()
    t = confidence(predicted, measured, n_1, first.budget, exponent, CONFIDENCES[error])
    del measured, predicted, weight  # images
    v = neighbour_variance(variance, spikes, colour)
    v **= t
    v_of_colour = v[COLOURS[colour]].copy()
    # n ~ (V / C)^(1 / (1 + a)), at least n_1, for the whole budget; in the place of v, an image
    n = sample_density(v, cost, exponent)
    mean = n.mean()
    if mean > 0:
        n *= first.budget / cost / mean
    return v_of_colour, n_1 / patch_mean(np.maximum(n, n_1, out=n), PATCH), t


def error_weight(first: Pilot, colour: int, error: str) -> tuple[Array, Array]:
    """Return the weight q of each pixel, ``(H, W)``, and its mean over the pixels of other colours by patch.

    I is the mean of the channels, and e is `DARK` times the square of its mean over these pixels, so that an image that
    is ten times brighter has the same numbers of samples.
    """
    if error == "absolute":
        return np.broadcast_to(np.float32(1), first.moments.mean.shape[:2]), np.ones(1)
    radiance = first.moments.mean.mean(axis=2)
    others = np.ones(radiance.shape, np.float32)
    others[COLOURS[colour]] = 0
    count = max(float(others.sum()), 1.0)
    # q = 1 / (I^2 + e)
    e = DARK * (float(np.vdot(others, radiance)) / count) ** 2
    weight = 1 / (radiance**2 + np.float32(max(e, float(TINY))))
    return weight, patch_sum(weight * others, PATCH) / np.maximum(patch_sum(others, PATCH), 1)


def neighbour_variance(variance: Array, spikes: Array, *excluded: int) -> Array:
    """Return V n^-a of the first round around each pixel, from neighbours of other colours than those `excluded`.

    `variance` is that of each pixel's mean, ``(H, W)``; `spikes`, ``(rows, columns)``, is added to all pixels of a
    patch, see `SPIKES`.
    """
    others = np.ones(variance.shape, bool)
    for colour in excluded:
        others[COLOURS[colour]] = False
    if not others.any():
        return np.ones(variance.shape)
    v = patch_spread(spikes, PATCH, variance.shape)
    for rows in row_blocks(len(v), 64):
        near = slice(max(rows.start - 2, 0), rows.stop + 2)
        smooth = gaussian(np.where(others[near], variance[near], np.nan), 1.0, 2)
        v[rows] += np.maximum(smooth[rows.start - near.start :][: rows.stop - rows.start], 0)
    return v


def confidence(
    predicted: Array, measured: Array, n_1: int, budget: int, exponent: float, powers: tuple[float, ...]
) -> float:
    """Return the power t of V with which numbers of samples give the judging pixels the least error.

    `predicted` is V of these pixels from their neighbours, which numbers from `n_1` on, on average `budget`, would
    follow. `measured` is v from the halves of their own samples, summed over those in a patch. (Four parts of few
    samples overrate pixels with an edge, whose error falls fast, and so would agree with what overrates them as well.)
    Only `predicted` has `SPIKES`. Where nothing has variance the first of the `powers` is returned.
    """
    if not measured.any() or not predicted.any():
        return powers[0]

    def error(t: float) -> float:
        # sum_p v_p n_p^-a,  n_p ~ V_p^(t / (1 + a))
        number = sample_density(predicted**t, 1.0, exponent)
        number = np.maximum(number * (budget / number.mean()), n_1)
        return float(np.vdot(measured, (number / number.mean()) ** -exponent))

    return min(powers, key=error)
