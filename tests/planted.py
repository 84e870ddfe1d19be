"""Pilots with a planted answer: an integral in one dimension, and variance curves that are given."""

import itertools

import numpy as np
from helpers import Z_LIMIT

from dmis.base.patches import PATCH, patch_sum
from dmis.base.vectors import Array
from dmis.estimator.mis import combiner_by_name
from dmis.estimator.records import Record
from dmis.variance.curves import GRID, HALF, Curves, with_gain_square
from dmis.variance.moments import Film, Moments

Keys = tuple[tuple[int, ...], ...]
COLOUR = np.array([[0.3], [0.6], [2.1]], np.float32)  # of a sample, whose mean over channels counts
A = 0.25  # p_l = 2 x, p_b = 2 (1 - x) on [0, 1], f = A + (1 + 2 y) x at the point y, uniform in [0, 1]


def f(x: Array, y: Array) -> Array:
    return A + (1 + 2 * y) * x


def exact(w: float, s: int, combiner: str = "balance") -> tuple[float, float]:
    """By quadrature: the variance of a camera sample with s shading samples, and that of I(y)."""
    x = ((np.arange(20_000) + 0.5) / 20_000)[:, None]
    y = (np.arange(50) + 0.5) / 50
    densities = 2 * x, 2 * (1 - x)
    effective = w * densities[0], (1 - w) * densities[1]
    estimates = [f(x, y) * combiner_by_name(combiner).heuristic(effective, k) for k in (0, 1)]
    light, brdf = (np.mean(p * c, axis=0) for p, c in zip(densities, estimates, strict=True))
    second_l, second_b = (np.mean(p * c**2, axis=0) for p, c in zip(densities, estimates, strict=True))
    np.testing.assert_allclose(w * light + (1 - w) * brdf, np.mean(f(x, y), axis=0))  # whatever the combiner
    total = 0.0
    for n, share in ((int(w * s), 1 - w * s % 1), (int(w * s) + 1, w * s % 1)):  # light samples of a camera sample
        if share:
            mean = (n * light + (s - n) * brdf) / s
            at_y = n * (second_l - light**2) + (s - n) * (second_b - brdf**2)
            total += share * float(mean.var() + at_y.mean() / s**2)
    return total, float((w * light + (1 - w) * brdf).var())


def pilot(pixels: int, count: int, seed: int, keys: Keys = ((0,),), s: int = 2, combiner: str = "balance") -> Curves:
    """A 1-D pilot: s samples of each technique for each camera sample, at w = 1/2, from equal lights of these keys."""
    rng = np.random.default_rng(seed)
    curves = Curves(pixels, 2 * s, combiner=combiner)
    n = pixels * count
    records, radiance, y = [], np.zeros(n), rng.random(n)
    for key, side, turn in itertools.product(keys, (0, 1), range(s)):
        x = np.sqrt(rng.random(n))
        x = x if side == 0 else 1 - x
        pdf = np.stack([2 * x, 2 * (1 - x)])
        value = f(x, y) / pdf.mean(axis=0)
        radiance += value / (2 * s)
        value = COLOUR * value.astype(np.float32)
        records.append(Record(side, key, turn, None, value, pdf.astype(np.float32)))
    curves.add(records, COLOUR * radiance.astype(np.float32), count)
    return curves


def unbiased(values: Array, expected: float) -> bool:
    """A z-test of the mean."""
    return abs(values.mean() - expected) < Z_LIMIT * values.std(ddof=1) / np.sqrt(len(values))


PLAIN = {"filter": "none", "cost": False, "guard": 0.0}


def pilot_of_curves(curve: Array, noise: float = 0.0, shape: tuple[int, int] = (32, 32)) -> dict[float, Film]:
    """A pilot whose pixels have the curves given per patch of 4 pixels ``(G, rows, columns)``, with a spread.

    Their second moments are the curves.
    """
    pixels = patch_sum(np.ones(shape), PATCH)
    curve = np.broadcast_to(curve, (len(GRID), *pixels.shape)).astype(float)
    sums = with_gain_square(curve, curve, HALF)
    sums["gain_square"] = sums["gain_square"] + noise**2
    sums |= {"pattern": np.zeros(curve.shape), "position": np.zeros(pixels.shape)}
    moments = Moments(6, np.ones((*shape, 3)), np.ones((*shape, 3)))
    return {0.5: Film.of(moments, rays={"camera": 100}, sums={name: a * pixels for name, a in sums.items()})}
