"""Choice of the pattern of light and BRDF samples of each patch, from the pilot of `dmis.fit.auto`.

A pattern ``n_l : n_b`` is better than another if it has less error in the same time. A camera sample of pattern k has
the variance V_k and costs C_k, so a time c pays for ``n = c / C_k`` of them, and as the squared error of n
low-discrepancy points falls as ``V n^-a``, the best pattern is that of the least

    V_k C_k^a.

A light sample less, for example, makes C smaller and V larger; which of them matters more is another question in a
penumbra than on a glossy ball. Each patch of 4x4 pixels answers it by its variance curve, which the samples of the
pilot give for all shares w of light samples at once (`dmis.variance.curves`). With independent points

    V = P + A(w) / S,

P being the variance over the positions in the pixel, and A(w) that of one shading sample, of which a pattern has S.
A curve is uncertain, and the least of many uncertain values is too small; so w = 1/2 is left only for a gain of several
standard errors.

**Paths** have one pattern for the whole image, and equal numbers n of camera samples. Then time is in proportion to C,
and the best pattern is that of the least V C.

**Judge.** Whether the choice for paths pays is asked of samples that did not make it: half of the pixels choose, and
the curves of the other half say what error the choice has. In direct lighting the guard of each patch is enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmis.base.patches import PATCH, patch_spread, patch_sum, row_blocks
from dmis.base.vectors import TINY, Array
from dmis.estimator.cost import pattern_costs
from dmis.estimator.patterns import EQUAL, FIRST, MOST_HALVINGS, PATTERNS, SAMPLES_OF, SHARE_OF, PatternMap
from dmis.filter import gaussian
from dmis.fit.pooling import PatchCurves, allowed_weights, pool
from dmis.fit.sample_density import CONFIDENCES, DARK, confidence
from dmis.variance.moments import Film

HALF = int(SHARE_OF[FIRST])
"""Index of w = 1/2, the share of the pilot, in `dmis.estimator.patterns.SHARES`."""

PATTERN_PRICE = 0.95
"""Predicted error over that of the pattern 1:1 from which on other patterns do not pay."""
MOST_PATTERNS = 4
"""Largest number of patterns in an image of direct lighting."""
LEAST_GAIN = 0.002
"""Part of the error to the power 1 / (1 + a) that one more pattern must save."""
LOOKS = ((0, 0), (1, 2), (2, 1), (3, 3))
"""The pixels of a patch that the pilot looks at, one of each colour."""
HALVES: tuple[tuple[int, ...], ...] = ((0, 3), (1, 2))
"""Colours of the pixels that choose for the judgement by the other half."""
ALL: tuple[int, ...] = (0, 1, 2, 3)
"""Colours whose pixels choose the pattern of an image of paths."""


@dataclass(frozen=True, eq=False)
class PatternChoice:
    """Pattern of each patch, ``(rows, columns)``.

    Attributes
    ----------
    pattern
        Index in `dmis.estimator.patterns.PATTERNS`.
    cost
        C, in units of a camera sample of the pattern 1:1.
    halvings
        Halvings of each light, ``(L + 1, rows, columns)`` or ``(0, rows, columns)``.
    halved_variance
        V over that without halvings.
    """

    pattern: np.ndarray
    cost: Array
    halvings: np.ndarray
    halved_variance: Array

    def of_pixels(self, shape: tuple[int, int], shading_samples: int) -> PatternMap:
        """Return the patterns of the pixels of an image, where the pattern 1:1 has so many `shading_samples`."""
        scale = shading_samples // int(SAMPLES_OF[EQUAL])
        sizes = tuple((n_l * scale, n_b * scale) for n_l, n_b in PATTERNS)
        halvings = patch_spread(self.halvings, PATCH, shape) if len(self.halvings) else None
        return PatternMap(sizes, patch_spread(self.pattern, PATCH, shape), halvings)


def looks_at(shape: tuple[int, int], every: int = 1) -> np.ndarray:
    """Return 1 at the pixels of an image that the pilot looks at, 0 elsewhere, ``(H, W)`` int32.

    They are in one of `every` patches of a row, the next ones in the next row.
    """
    mask = np.zeros(shape, np.int32)
    for y, x in LOOKS:
        mask[y::PATCH, x::PATCH] = 1
    rows, columns = np.indices(shape) // PATCH
    return np.where((rows + columns) % every == 0, mask, 0)


def decide_patterns(pilot: Film, error: str, guard: float, exponent: float) -> tuple[PatternChoice | None, float]:
    """Return the patterns of patches from a pilot, None if they do not pay, and their predicted error.

    They are `MOST_PATTERNS` at most, with the halvings of each light that suit them. The error is that over the error
    of the pattern 1:1 at equal cost. For the options see `dmis.fit.auto.Auto`.
    """
    weight = _patch_weight(pilot, error)
    curves, lights = curves_of_patches(pilot)
    cost, light_costs = pattern_costs(pilot.rays, pilot.shading_samples, pilot.techniques, max(len(lights) - 1, 1))
    allowed = allowed_weights(curves.curve.sum(axis=(1, 2)))
    # some rows at a time, because there are many patterns
    blocks = row_blocks(len(curves.position), 4)
    errors = np.concatenate(
        [pattern_errors(curves.rows(rows), cost, allowed, guard, exponent) for rows in blocks], axis=1
    )
    pattern = best_of_few(errors, weight, exponent)
    of_pattern = cost[pattern]
    choice = PatternChoice(pattern, of_pattern, np.empty(lights.shape, np.uint8), np.ones(pattern.shape))
    if len(lights):
        lit = light_costs[:, pattern]
        halvings, variance_ratio, cost_ratio = light_halvings(lights, lit, of_pattern - lit.sum(axis=0), exponent)
        choice = PatternChoice(pattern, of_pattern * cost_ratio, halvings, variance_ratio)
    predicted = predicted_error(choice, curves, weight, exponent)
    return (choice if predicted < PATTERN_PRICE else None), predicted


def decide_one_pattern(pilot: Film, error: str) -> tuple[PatternChoice | None, float]:
    """Return one pattern for all patches, None if 1:1 is as good, and its predicted error times its cost.

    It has at most two shading samples, and one technique alone needs to be safe (`allowed_weights`). It is for paths,
    where samples of several patterns are batches of their own, small at the later surfaces. All pixels keep their
    numbers of camera samples, powers of two: of a pattern that costs an eighth less, an eighth of the pixels could have
    twice as many, which lowers the error by less than the time. So what is least is V C.
    """
    weight = _patch_weight(pilot, error)
    cost = pattern_costs(pilot.rays, pilot.shading_samples, pilot.techniques)[0]
    errors, best = {}, {}
    for colours in (*HALVES, ALL):
        curves = curves_of_image(pilot, colours, weight)
        errors[colours] = one_pattern_errors(curves, cost)
        allowed = allowed_weights(curves.curve.sum(axis=(1, 2)))[SHARE_OF] & (SAMPLES_OF <= SAMPLES_OF[EQUAL])
        best[colours] = int(np.where(allowed, errors[colours], np.inf).argmin())
    predicted = float(np.mean([errors[judge][best[chooser]] for chooser, judge in (HALVES, HALVES[::-1])]))
    if not predicted < PATTERN_PRICE:
        return None, predicted
    none = np.empty((0, *weight.shape), np.uint8)
    of_patches = np.full(weight.shape, best[ALL], np.uint8)
    return PatternChoice(of_patches, np.full(weight.shape, cost[best[ALL]]), none, np.ones(weight.shape)), predicted


def _patch_weight(pilot: Film, error: str) -> Array:
    """Return the weight of patches in the error, by the pixels that the pilot looks at; 0 where it has none."""
    shape = pilot.mean.shape[:2]
    pixels = patch_sum(np.broadcast_to(pilot.n, (*shape, 1))[..., 0] > 0, PATCH)
    seen = pixels > 0
    if error == "absolute":
        return seen.astype(np.float64)
    radiance = patch_sum(pilot.mean.mean(axis=2), PATCH) / np.maximum(pixels, 1)
    # q = 1 / (I^2 + e)
    dark = max(DARK * float(radiance[seen].mean()) ** 2, float(TINY))
    return np.where(seen, 1 / (radiance**2 + dark), 0)


def curves_of_patches(pilot: Film) -> tuple[PatchCurves, Array]:
    """Return the curves of patches at `SHARES`, for two shading samples, filtered among neighbours that look alike.

    And the variance of what is reflected of each light, and of the rest, ``(L + 1, rows, columns)``; ``(0, ...)`` if it
    was not gathered.
    """
    shape = pilot.mean.shape[:2]
    pixels = np.broadcast_to(pilot.n, (*shape, 1))[..., 0] > 0
    number = {"pixels": np.maximum(patch_sum(pixels.astype(float), PATCH), 1e-9)}
    sums = ((name, a.sum(axis=0)) for name, a in pilot.sums.items())
    # no name keeps the sums: `pool` frees them
    means, effective_number = pool({**dict(sums), **number}, shape, PATCH, 1.0, 2, pilot.features or None)
    lights = means.pop("lights", np.empty((0, *effective_number.shape)))
    return PatchCurves(**means, pixels=effective_number, baseline=HALF), lights


def pattern_errors(curves: PatchCurves, cost: Array, allowed: np.ndarray, guard: float, exponent: float) -> Array:
    """Return V C^a of each pattern in each patch, ``(patterns, rows, columns)`` float32.

    Infinite for another share than 1/2 unless its gain is certain and it is `allowed` ``(G,)``.
    """
    # V_k C_k^a
    error = pattern_variances(curves) * cost[:, None, None] ** exponent
    certain = curves.curve - curves.curve[HALF] < -guard * curves.gain_error()
    certain &= allowed[:, None, None]
    certain[HALF] = True
    return np.where(certain[SHARE_OF], error, np.inf).astype(np.float32)


def light_halvings(variance: Array, cost: Array, camera: Array, exponent: float) -> tuple[np.ndarray, Array, Array]:
    """Return the best halvings of each light (`dmis.estimator.patterns`), and their effect on variance and cost.

    If a share f_k of the camera samples samples light k, error and cost are in proportion to::

        sum V_k f_k^-a,    C + sum C_k f_k

    and error times cost^a is least where ``f_k^(1 + a) = V_k / C_k / (sum V_j f_j^-a / (C + sum C_j f_j))``.

    V_k and C_k are `variance` and `cost` of a camera sample, ``(K, ...)``, C the cost of the `camera` sample without
    lights, and a the `exponent`, see `dmis.fit.sample_density`. The last place is that of delta lights; a lamp that is
    the only one besides is not halved, because its rare highlights would be missed.

    Returns
    -------
    halvings
        ``-log2 f_k``, rounded, from 0 to `MOST_HALVINGS`, ``(K, ...)`` uint8.
    variance_ratio, cost_ratio
        Variance and cost over those without halvings, ``(...)``.
    """
    part = np.ones(variance.shape)
    for _ in range(3):
        price = (variance * part**-exponent).sum(axis=0) / (camera + (cost * part).sum(axis=0))
        wanted = variance / np.maximum(cost * price, TINY)
        halvings = np.rint(np.clip(-np.log2(np.maximum(wanted, TINY)) / (1 + exponent), 0, MOST_HALVINGS))
        halvings[cost <= 0] = 0
        if len(halvings) == 2:
            halvings[0] = 0
        part = 2.0**-halvings
    total = np.maximum(variance.sum(axis=0), TINY)
    cost_ratio = (camera + (cost * part).sum(axis=0)) / (camera + cost.sum(axis=0))
    return halvings.astype(np.uint8), np.maximum((variance * part**-exponent).sum(axis=0), TINY) / total, cost_ratio


def best_of_few(errors: Array, weight: Array, exponent: float) -> np.ndarray:
    """Return the best pattern of each patch, where the image may have `MOST_PATTERNS` different ones.

    Pixels of different patterns are rendered in different batches, and small batches are slow. The set of patterns
    begins with 1:1. Each step adds the one that lowers the error of the image most (`predicted_error`), until the gain
    is below `LEAST_GAIN`.
    """
    # with the best numbers of samples the error is the sum over patches of (V q C^a)^(1 / (1 + a)), to the 1 + a
    parts = (errors * weight) ** (1 / (1 + exponent))
    chosen, least = [EQUAL], parts[EQUAL]
    while len(chosen) < MOST_PATTERNS:
        sums = [np.minimum(least, part).sum(dtype=np.float64) for part in parts]
        best = int(np.argmin(sums))
        if sums[best] >= (1 - LEAST_GAIN) * least.sum(dtype=np.float64):
            break
        chosen.append(best)
        least = np.minimum(least, parts[best])
    return np.asarray(chosen, np.uint8)[errors[chosen].argmin(axis=0)]


def error_of_numbers(pilot: Film, error: str, exponent: float, n_1: int) -> float:
    """Return the predicted error of uneven numbers of camera samples over that of equal ones, at equal cost.

    Numbers from `n_1` on follow the variance of patches that half of the pixels see; the other half judges.
    """
    weight = _patch_weight(pilot, error)
    seen = weight > 0
    of_halves = []
    for colours in HALVES:
        sums = {name: sum(pilot.sums[name][k] for k in colours) for name in ("position", "curve")}
        of_halves.append(np.maximum(sums["position"] + sums["curve"][HALF], 0) * weight)
    errors = [
        confidence(
            gaussian(v, 1.0, 2, seen)[seen] + TINY,
            judge[seen],
            np.ones(np.count_nonzero(seen)),
            n_1,
            pilot.budget,
            exponent,
            CONFIDENCES[error],
            1.0,
        )[1]
        for v, judge in (of_halves, of_halves[::-1])
    ]
    return float(np.mean(errors))


def curves_of_image(pilot: Film, colours: Sequence[int], weight: Array) -> PatchCurves:
    """Return the curves of the image as those of one patch, from the samples of some colours.

    `weight` is that of each patch in the error.
    """
    sums = {name: sum(a[k] for k in colours) for name, a in pilot.sums.items()}
    means = {name: (a * weight).sum(axis=(-2, -1), keepdims=True) / weight.sum() for name, a in sums.items()}
    return PatchCurves(**means, pixels=np.ones((1, 1)), baseline=HALF)


def one_pattern_errors(curves: PatchCurves, cost: Array) -> Array:
    """Return V C of each pattern over that of 1:1, ``(patterns,)``, from the curves of an image."""
    error = pattern_variances(curves)[:, 0, 0] * cost
    return np.asarray(error / error[EQUAL]) if error[EQUAL] > 0 else np.ones(len(error))


def pattern_variances(curves: PatchCurves) -> Array:
    """Return V of a camera sample with each pattern, ``(patterns, rows, columns)``."""
    # V = P + A(w) / S,  A(w) / 2 being the curve
    shading = curves.curve[SHARE_OF] * (2 / SAMPLES_OF[:, None, None])
    return np.maximum(np.maximum(curves.position, 0) + shading, 0)


def predicted_error(choice: PatternChoice, curves: PatchCurves, weight: Array, exponent: float) -> float:
    """Return the error of a choice over that of the pattern 1:1 at the same cost.

    It is that with the best numbers n_p of samples of patches, in proportion to (V_p q_p / C_p)^(1 / (1 + a))::

        sum V_p q_p n_p^-a ~ (sum (V_p q_p C_p^a)^(1 / (1 + a)))^(1 + a)

    `weight` is q.
    """
    variance = pattern_variances(curves)
    chosen = np.take_along_axis(variance, choice.pattern[None].astype(int), axis=0)[0] * choice.halved_variance
    power = 1 / (1 + exponent)
    of_choice = ((chosen * weight * choice.cost**exponent) ** power).sum()
    equal = ((variance[EQUAL] * weight) ** power).sum()
    return float((of_choice / equal) ** (1 + exponent)) if equal > 0 else 1.0
