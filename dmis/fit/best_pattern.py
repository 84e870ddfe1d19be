"""Choice of the pattern of light and BRDF samples of each patch, from the first round of `dmis.fit.auto`.

A pattern ``n_l : n_b`` is better than another if it has less error in the same time. A camera sample of pattern k has
the variance V_k and costs C_k, so a time c pays for ``n = c / C_k`` of them, and as the squared error of n
low-discrepancy points falls as ``V n^-a``, the best pattern is that of the least

    V_k C_k^a.

A light sample less, for example, makes C smaller and V larger; which of them matters more is another question in a
penumbra than on a glossy ball. Each patch of 4x4 pixels answers it by its variance curve, which the samples of the
first round give for all shares w of light samples at once (`dmis.variance.pattern_curves`). With independent points

    V = P + A(w) / S,

P being the variance over the positions in the pixel, and A(w) that of one shading sample, of which a pattern has S.

A pixel that has n_1 camera samples from the first round, of the pattern 2:2, may **restart** its sequence with the new
pattern: the first round is then lost, and the m new samples have the error ``V m^-a``. Or it may **continue**: the
positions of all n = n_1 + m camera samples stay stratified, but the light and BRDF samples of the m later ones do not
fill the gaps of the n_1 first ones. The mean consists of two parts, weighted by m / n and n_1 / n, whose error is

    P n^-a + (m / n)^2 A(w) / S m^-a + (n_1 / n)^2 A(1/2) / 4 n_1^-a.

(A technique with one sample has points n_1 to 2 n_1 - 1 of its sequence twice then, which the formula leaves out.)
Of all patterns, continued or restarted, the one of the least error is chosen. A curve is uncertain, and the least of
many uncertain values is too small; so w = 1/2 is left only for a gain of several standard errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmis.base.patches import COLOURS, PATCH, other_colours, patch_sum, row_blocks
from dmis.base.vectors import Array
from dmis.estimator.patterns import FIRST, SAMPLES_OF, SHARE_OF
from dmis.fit.curve_minimum import PatchCurves, allowed_weights
from dmis.fit.pooling import pool
from dmis.fit.round import Pilot
from dmis.fit.sample_numbers import light_halvings

HALF = int(SHARE_OF[FIRST])
"""Index of w = 1/2, the share of the first round, in `dmis.estimator.patterns.SHARES`."""


@dataclass(frozen=True, eq=False)
class PatternChoice:
    """Pattern of each patch for its pixels of one colour, ``(rows, columns)`` each.

    Attributes
    ----------
    pattern
        Index in `dmis.estimator.patterns.PATTERNS`.
    restarts
        Whether the sequence restarts, so that the first round is not in the image.
    variance_ratio
        V over that of the first round's pattern.
    cost
        C, in units of a camera sample of the pattern 1:1.
    halvings
        Halvings of each light, ``(L + 1, rows, columns)`` or ``(0, rows, columns)``.
    """

    pattern: np.ndarray
    restarts: np.ndarray
    variance_ratio: Array
    cost: Array
    halvings: np.ndarray


def curves_of_patches(first: Pilot, colour: int, filter_: str) -> tuple[PatchCurves, Array]:
    """Return the curves of patches at `SHARES`, for two shading samples, from the samples of the other colours.

    And the variance of what is reflected of each light, and of the rest, ``(L + 1, rows, columns)``; ``(0, ...)`` if it
    was not gathered.
    """
    shape = first.moments.mean.shape[:2]
    pixels = np.ones(shape, np.uint8)
    pixels[COLOURS[colour]] = 0
    number = {"pixels": np.maximum(patch_sum(pixels, PATCH), 1e-9)}
    sums = ((name, sum(a[k] for k in other_colours(colour))) for name, a in first.sums.items() if name != "halves")
    sigma = None if filter_ == "none" else 1.0
    features = first.features if filter_ == "joint" else None
    # no name keeps the sums: `pool` frees them
    means, effective_number = pool({**dict(sums), **number}, shape, PATCH, sigma, 2, features)
    lights = means.pop("lights", np.empty((0, *effective_number.shape)))
    return PatchCurves(**means, pixels=effective_number, baseline=HALF), lights


def choose_patterns(
    curves: PatchCurves,
    lights: Array,
    costs: tuple[Array, Array],
    first_share: Array,
    weights: bool,
    guard: float,
    exponent: float,
) -> PatternChoice:
    """Return the best pattern of each patch, and the halvings of each light that suit it.

    `curves` and `lights` are `curves_of_patches`, `costs` is `dmis.estimator.cost.pattern_costs`, and `first_share` the
    first round's part of the cost of each patch. For the options see `dmis.fit.auto.Auto`.
    """
    cost, light_costs = costs
    allowed = allowed_weights(curves.curve.sum(axis=(1, 2))) & weights
    # some rows at a time, because there are many patterns
    blocks = [
        best_patterns(curves.rows(rows), cost, first_share[rows], allowed, guard, exponent)
        for rows in row_blocks(len(first_share), 4)
    ]
    pattern, restarts, ratio = (np.concatenate(maps) for maps in zip(*blocks, strict=True))
    choice = PatternChoice(pattern, restarts, ratio, cost[pattern], np.empty(lights.shape, np.uint8))
    if not len(lights):
        return choice
    lit = light_costs[:, pattern]
    halvings, variance_ratio, cost_ratio = light_halvings(lights, lit, choice.cost - lit.sum(axis=0), exponent)
    return PatternChoice(pattern, restarts, ratio * variance_ratio, choice.cost * cost_ratio, halvings)


def best_patterns(
    curves: PatchCurves, cost: Array, first_share: Array, allowed: np.ndarray, guard: float, exponent: float
) -> tuple[np.ndarray, np.ndarray, Array]:
    """Return the best pattern of each patch, whether its pixels restart, and V over the first round's.

    `allowed` ``(G,)`` says which shares may be used; for the others see `choose_patterns`.
    """
    # V = P + A(w) / S,  A(w) / 2 being the curve
    position = np.maximum(curves.position, 0)
    shading = curves.curve[SHARE_OF] * (2 / SAMPLES_OF[:, None, None])
    variance = np.maximum(position + shading, 0)
    # n_1 camera samples of the first round and m later ones, for a total cost of 1
    n_1 = first_share / cost[FIRST]
    m = np.maximum(1 - first_share, 1e-3) / cost[:, None, None]
    n = n_1 + m
    # P n^-a + (m / n)^2 A(w) / S m^-a + (n_1 / n)^2 A(1/2) / 4 n_1^-a
    shading_error = (m ** (2 - exponent) * shading + n_1 ** (2 - exponent) * shading[FIRST]) / n**2
    error_continued = np.maximum(position * n**-exponent + shading_error, 0)
    # the same pattern goes on with one even sequence,  V (1 / C)^-a
    error_continued[FIRST] = variance[FIRST] * cost[FIRST] ** exponent
    # V m^-a
    error_restarted = variance * m**-exponent
    restarts = error_restarted < error_continued
    error = np.where(restarts, error_restarted, error_continued)
    # another share than 1/2 only where the gain is certain
    certain = curves.curve - curves.curve[HALF] < -guard * curves.gain_error()
    certain &= allowed[:, None, None]
    certain[HALF] = True
    error = np.where(certain[SHARE_OF], error, np.inf)
    best = np.where(error[FIRST] <= error.min(axis=0), FIRST, error.argmin(axis=0))[None]
    error, restarts, n, m = (np.take_along_axis(values, best, axis=0)[0] for values in (error, restarts, n, m))
    # the V of one sequence of as many samples with the same error
    variance_of_best = error * np.where(restarts, m, n) ** exponent
    lit = variance[FIRST] > 0
    ratio = np.divide(variance_of_best, variance[FIRST], out=np.ones_like(variance_of_best), where=lit)
    return best[0].astype(np.uint8), restarts, ratio
