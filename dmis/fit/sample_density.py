"""Numbers of camera samples of pixels: in proportion, from the first round of `dmis.fit.auto`, and made whole.

The squared error of n low-discrepancy points falls as ``V n^-a``, with a = 1.4 or so, and a camera sample costs C. The
error of the image is the sum of ``V n^-a`` over its pixels, and its cost the sum of ``n C``. It is least where another
second lowers the error of every pixel by as much, ``a V n^(-a - 1) / C`` being the same everywhere:

    n ~ (V / C)^(1 / (1 + a)).

So a pixel of 32 times the variance gets four times the samples, not 32 times: its error falls fast with the first of
them, and slowly later.

**V** is measured at each pixel: the spread of four sub-blocks of its samples (`dmis.variance.moments.SubBlocks`),
averaged over its neighbours. **Spikes**, such as the highlight that one sample in a hundred finds, are mostly not among
the few samples of a pixel, and their V is then far too small; so a part of the variance of independent points, which a
whole patch tells, is added.

**Weight.** Errors are relative: the error is the sum over pixels of V q n^-a, where q = 1 / (I^2 + e) and I is the
radiance of the pixel whose V it is, or with ``error=absolute`` q = 1. Neighbours are averaged as V q, because where one
of them is bright and another is black, a mean V over a mean I^2 has the noise of the first and the weight of the
second.

**Judge.** V of a few samples is uncertain: where it is large it was partly luck, and its pixel needs fewer samples than
V says. So numbers follow V^t with a confidence t, the one that predicts the least error in pixels of another colour,
whose own V q judges. If the gain that it predicts is less than the price of uneven numbers, all pixels have the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dmis.base.patches import COLOURS, PATCH, by_colour, other_colours, patch_spread, patch_sum, row_blocks
from dmis.base.vectors import TINY, Array
from dmis.estimator.cost import relative_costs
from dmis.estimator.records import PIXEL_SUMS, Record, Wants
from dmis.filter import gaussian
from dmis.fit.pooling import pool
from dmis.variance.moments import Film

LEAST_SPP = 16
"""Budget of `dmis.fit.auto` from which on there is a first round."""
FIRST_ROUNDS = ((32, 4), (64, 8), (256, 16), (1024, 32), (math.inf, 64))
"""Budgets below which a first round is so large, in camera samples."""
MOST_ADAPTIVE = 2**16
"""Largest number of camera samples of one pixel, with rules that divide them between pixels."""
EXPONENT = 1.4
"""a of low-discrepancy points; of independent ones it is 1."""
CONFIDENCES = {"absolute": (1.0, 0.75, 0.5, 0.25), "relative": (0.75, 0.5, 0.25)}
"""Powers of the variance which numbers of samples may follow."""
PRICE, PATH_PRICE = 0.85, 0.75
"""Predicted errors over that of equal numbers from which on uneven numbers do not pay, in direct lighting and by paths.

By paths uneven numbers take 1.14 to 1.33 times the CPU seconds of equal ones, whatever counted rays say, because rays
that meet small triangles take longer: relMSE times CPU is .99 on tt and 1.11 on both killeroos (64 samples per pixel,
``python benchmarks/vary.py dmis.fit.sample_density.PATH_PRICE 0 1 --rule auto``).
"""
SPIKES = 0.1
"""Share of the variance of independent points that is added to that of a pixel."""
UNSEEN = 0.02
"""Cost of a camera sample that meets nothing, over the mean."""
DARK = 0.1
"""e in relative errors, over the squared mean radiance of the image: near the .01 of relMSE where that mean is .3."""


def variance_of_mean(first: Film) -> Array:
    """Return the variance of the mean of each pixel's samples of the first round, ``(H, W)`` float32."""
    n_1 = int(np.max(first.n))
    variance = np.einsum("yxc,yxc->yx", first.root, first.root, dtype=np.float64)
    variance /= 3 * n_1 * max(n_1 - 1, 1)
    return variance.astype(np.float32)


class FirstRound:
    """Statistic of a first round: rays and squared samples of pixels, which the film gathers, and no records."""

    wants = Wants(records=False, pixel_sums=True, sums="colours")

    def __init__(self, pixels: int, shading_samples: int) -> None:
        pass

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Do nothing."""

    def sums(self) -> dict[str, Array]:
        """Return none: the film adds them."""
        return {}


def sample_costs(first: Film, shading_samples: Array | int, lights: int, colour: int) -> Array:
    """Return the cost of a camera sample of each pixel over the mean, ``(H, W)``, from the rays of other colours.

    `shading_samples` are those of each camera sample, one number or ``(rows, columns)`` of patches.
    """
    shape = first.mean.shape[:2]
    closest, occlusion = (first.sums[name][other_colours(colour)].sum(axis=0) for name in PIXEL_SUMS[:2])
    others = np.ones(shape)
    others[COLOURS[colour]] = 0
    cost = relative_costs(closest, occlusion, shading_samples, lights) / np.maximum(patch_sum(others, PATCH), 1)
    mean = max(float(cost.mean()), float(TINY))
    return patch_spread(cost / mean + UNSEEN, PATCH, shape)


def density_of_colour(
    first: Film,
    variance: Array,
    independent: Array,
    cost: Array,
    colour: int,
    error: str,
    exponent: float,
    path: bool = False,
) -> tuple[Array, float, float]:
    """Return numbers of camera samples of the pixels of one colour, in proportion, from the samples of the others.

    And t, 0 where all pixels have the same number, and the predicted error over that of equal numbers at equal cost.

    `variance` is `variance_of_mean`, `independent` is `sample_variance`, and `cost` that of a camera sample of each
    pixel, ``(H, W)``; for `error` and `exponent`, a, see `dmis.fit.auto.Auto`. On a `path` spikes do not judge: with
    them a gain is predicted on killeroo-gold that renders with other seeds do not have.
    """
    n_1 = int(np.max(first.n))
    weight = error_weight(first, colour, error)
    weighted = variance * weight
    # the opposite colour in 2x2 neighbours judges: the other two colours predict V of its pixels
    opposite = len(COLOURS) - 1 - colour
    judge = COLOURS[opposite]
    others = other_colours(colour)
    predicting = [k for k in others if k != opposite]
    predicted = neighbour_variance(weighted, spikes_of(independent, weight, predicting), colour, opposite)[judge]
    measured = weighted[judge]
    if not path:
        spikes = spikes_of(independent, weight, [opposite])
        measured = measured + patch_spread(spikes, PATCH, weight.shape, judge)
    t, gain = confidence(
        predicted, measured, cost[judge], n_1, first.budget, exponent, CONFIDENCES[error], PATH_PRICE if path else PRICE
    )
    v = neighbour_variance(weighted, spikes_of(independent, weight, others), colour)[COLOURS[colour]]
    # n ~ (V^t / C)^(1 / (1 + a))
    return np.asarray((v**t / cost[COLOURS[colour]]) ** (1 / (1 + exponent))), t, gain


def error_weight(first: Film, colour: int, error: str) -> Array:
    """Return the weight q of each pixel, ``(H, W)``.

    I is the mean of the channels, and e is `DARK` times the square of its mean over the pixels of other colours, so
    that an image that is ten times brighter has the same numbers of samples.
    """
    if error == "absolute":
        return np.broadcast_to(np.float32(1), first.mean.shape[:2])
    radiance = first.mean.mean(axis=2)
    others = np.ones(radiance.shape, np.float32)
    others[COLOURS[colour]] = 0
    count = max(float(others.sum()), 1.0)
    # q = 1 / (I^2 + e)
    e = DARK * (float(np.vdot(others, radiance)) / count) ** 2
    return np.asarray(1 / (radiance**2 + np.float32(max(e, float(TINY)))))


def sample_variance(first: Film) -> Array:
    """Return V of a pixel's mean if its samples were independent, and the pixels in it, ``(2, 4, rows, columns)``.

    Sums over the pixels of each colour in patches, filtered: a neighbouring patch may have found the spikes that this
    one has not met yet.
    """
    n_1 = int(np.max(first.n))
    shape = first.mean.shape[:2]
    squared_means = patch_sum(by_colour(np.square(first.mean).mean(axis=2)), PATCH)
    variance = np.maximum(first.sums["squares"] / n_1 - squared_means, 0) / max(n_1 - 1, 1)
    count = patch_sum(by_colour(np.ones(shape)), PATCH)
    means, _ = pool({"variance": variance, "count": count}, shape, PATCH, 1.0, 2, first.features or None)
    return np.array([means["variance"], means["count"]])


def spikes_of(sums: Array, weight: Array, colours: Sequence[int]) -> Array:
    """Return the share `SPIKES` of V q in patches, from pixels of some colours; `sums` are `sample_variance`."""
    variance, count = sums[:, list(colours)].sum(axis=1)
    chosen = np.zeros(weight.shape, np.float32)
    for colour in colours:
        chosen[COLOURS[colour]] = 1
    mean_weight = patch_sum(weight * chosen, PATCH) / np.maximum(patch_sum(chosen, PATCH), 1)
    return np.asarray(SPIKES * variance / np.maximum(count, 1e-9) * mean_weight)


def neighbour_variance(variance: Array, spikes: Array, *excluded: int) -> Array:
    """Return V around each pixel, from neighbours of other colours than those `excluded`, ``(H, W)``.

    `variance` is that of each pixel's mean; `spikes`, ``(rows, columns)``, is added to all pixels of a patch.
    """
    others = np.ones(variance.shape, np.float32)
    for colour in excluded:
        others[COLOURS[colour]] = 0
    if not others.any():
        return np.ones(variance.shape)
    v = patch_spread(spikes, PATCH, variance.shape).astype(float)
    for rows in row_blocks(len(v), 64):
        near = slice(max(rows.start - 2, 0), rows.stop + 2)
        smooth = gaussian(np.where(others[near] > 0, variance[near], np.nan), 1.0, 2)
        v[rows] += np.maximum(smooth[rows.start - near.start :][: rows.stop - rows.start], 0)
    return v


def confidence(
    predicted: Array,
    measured: Array,
    cost: Array,
    n_1: int,
    budget: int,
    exponent: float,
    powers: Sequence[float],
    price: float,
) -> tuple[float, float]:
    """Return the power t of V that gives the judging pixels the least error, and that error.

    It is over that of equal numbers at the same cost. t, one of the `powers`, is 0 if it is not below the `price`.
    `predicted` is V q of these pixels from their neighbours, which numbers from `n_1` on, on average `budget`, would
    follow. `measured` is each pixel's own.
    """
    if not measured.any() or not predicted.any():
        return 0.0, 1.0
    of_power: dict[float, float] = {}
    of_variance, of_cost = (np.log(x) / (1 + exponent) for x in (np.maximum(predicted / predicted.max(), TINY), cost))
    for t in powers:
        # n ~ (V^t / C)^(1 / (1 + a))
        number = np.exp(t * of_variance - of_cost)
        for _ in range(4):  # at least n_1, for the same cost
            number = np.maximum(number * (budget * cost.sum() / np.vdot(number, cost)), n_1)
        # sum_p v_p n_p^-a
        of_power[t] = float(np.vdot(measured, (number / budget) ** -exponent) / measured.sum())
    t = min(of_power, key=of_power.__getitem__)
    return (t if of_power[t] < price else 0.0), of_power[t]


def powers_of_two(density: Array, cost: Array, least: Array, budget: float, chance: Array) -> np.ndarray:
    """Return numbers of camera samples in proportion to a `density` on average, from `least` on, ``(H, W)`` int32.

    They are powers of two, which cost the `budget` or a little less. `cost`, in the same units, is that of a camera
    sample of each pixel, and `chance` are uniform random numbers for the rounding, ``(H, W)`` each.
    """
    # t is rounded up to 2^(k + 1) with probability t / 2^k - 1, if to a power of two up to 2 t / (1 + chance)
    x = 2 * density / (1 + chance) / max(density.max(), 1e-300)
    low, high = 0.0, 60.0  # binary logarithm of the scale
    for _ in range(24):
        middle = (low + high) / 2
        fits = (_power_of_two(x * 2.0**middle, least) * cost).sum() <= budget
        low, high = (middle, high) if fits else (low, middle)
    return _spend_rest(_power_of_two(x * 2.0**low, least), x * 2.0**low, cost, budget).astype(np.int32)


def _spend_rest(samples: Array, target: Array, cost: Array, budget: float) -> Array:
    """Return `samples` of which some are doubled until the `budget` is spent, those nearest to their `target` first.

    Scaling all pixels together stops as soon as one of them is too expensive to be doubled, and a few expensive pixels
    may leave much of the budget. Pixels with far more samples than their `target`, such as black ones, stay as they
    are.
    """
    n = samples.reshape(-1)
    step = (samples * cost).reshape(-1)
    rest = budget - step.sum()
    for least_nearness in (1, 1 / 2, 1 / 4):
        nearness = target.reshape(-1) / n
        order = np.flatnonzero((nearness >= least_nearness) & (2 * n <= MOST_ADAPTIVE))
        order = order[np.argsort(-nearness[order], kind="stable")]
        while len(order := order[step[order] <= rest]):
            k = max(1, np.count_nonzero(np.cumsum(step[order]) <= rest))
            doubled = order[:k]
            order = order[k:]
            rest -= step[doubled].sum()
            n[doubled] *= 2
            step[doubled] *= 2
    return n.reshape(samples.shape)


def _power_of_two(x: Array, least: Array) -> np.ndarray:
    """Return the largest powers of two up to `x`, from `least` to `MOST_ADAPTIVE`."""
    powers = np.ldexp(1.0, np.frexp(np.minimum(x, MOST_ADAPTIVE))[1] - 1)
    return np.maximum(powers, least)
