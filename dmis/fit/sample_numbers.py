"""Whole numbers of camera samples of each pixel, from the proportions that a rule fitted, and parts for each light."""

from __future__ import annotations

import math

import numpy as np

from dmis.base.vectors import TINY, Array
from dmis.estimator.patterns import MOST_HALVINGS

LEAST_SPP = 16
"""Budget of `dmis.fit.auto` from which on there is a first round."""
FIRST_ROUNDS = ((32, 4), (64, 8), (256, 16), (1024, 32), (math.inf, 64))
"""Budgets below which a first round is so large, in camera samples."""

LEVELS = np.array(sorted({round(2 ** (k / 2)) for k in range(33)}))
"""Numbers of camera samples that a pixel may have where they differ, a factor of about 1.4 apart."""

MOST_ADAPTIVE = 2**16
"""Largest number of camera samples of one pixel, with rules that divide them between pixels."""


def whole_samples(share: Array, spp: int, rng: np.random.Generator) -> np.ndarray:
    """Return whole numbers of camera samples in proportion to `share` ``(H, W)``, `spp` on average, at least 2, int32.

    Shares are positive and finite.

    Numbers are from `LEVELS`, so that pixels can be rendered together; systematic rounding with a random offset
    keeps their mean. A ValueError if there are more samples than `LEVELS` has.
    """
    if spp > LEVELS[-1]:
        raise ValueError(f"camera samples must be at most {LEVELS[-1]} per pixel where a rule divides them; got {spp}")
    least = min(2, spp)
    most = LEVELS[-1]
    values, pixels = np.unique(share, return_counts=True)
    low_scale = 0.0
    high_scale = most / values[0]
    # bisection for the scale at which the clipped samples have the mean spp; it ends when all pixels are at the least,
    # or when no float is between the two scales
    while high_scale * values[-1] > least and low_scale < (scale := (low_scale + high_scale) / 2) < high_scale:
        enough = np.clip(values * scale, least, most) @ pixels >= spp * share.size
        low_scale, high_scale = (low_scale, scale) if enough else (scale, high_scale)
    samples = np.empty(share.shape, np.int32)
    offset = rng.random()
    for row, row_samples in zip(share, samples, strict=True):
        target = np.clip(row.astype(float) * high_scale, least, most)
        low = np.clip(np.searchsorted(LEVELS, target, "right") - 1, 0, len(LEVELS) - 2)
        steps = np.cumsum(np.append(offset, (target - LEVELS[low]) / (LEVELS[low + 1] - LEVELS[low])))
        row_samples[:] = LEVELS[np.minimum(low + np.diff(np.floor(steps).astype(int)), len(LEVELS) - 1)]
        offset = steps[-1]
    return samples


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
    """Return `samples` with some doubled, nearest to it first, so that what is left of the `budget` is used.

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
