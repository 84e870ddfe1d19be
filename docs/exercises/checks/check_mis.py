"""Checks of exercises 10 to 12, of tutorial 3: the balance heuristic, its estimator, its variance."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import numpy as np

from dmis.base.vectors import Array
from dmis.testing.outcome import Outcome
from grading import at_most, between, call, compare, exercise, seeded, z_test

_SIGMA = 0.1, 0.5
"""Standard deviations of the two densities."""


def densities(x: Array) -> tuple[Array, Array]:
    """Return a narrow and a wide normal density at `x`, both around 0."""
    p_l, p_b = (np.exp(-0.5 * (x / s) ** 2) / (s * np.sqrt(2 * np.pi)) for s in _SIGMA)
    return p_l, p_b


def integrand(x: Array) -> Array:
    """Return a function with a peak that is narrow and a tail that is wide."""
    return np.exp(-30 * x * x) + 0.3 * np.exp(-3 * (x - 0.3) ** 2)


def exact_variance(w: float, x: Array) -> float:
    """Return the variance of a sample of the balance heuristic with fixed numbers, from points `x` in even steps."""
    p_l, p_b = densities(x)
    f, dx = integrand(x), x[1] - x[0]
    p_w = w * p_l + (1 - w) * p_b
    m_2, m_l, m_b = ((g / p_w).sum() * dx for g in (f * f, p_l * f, p_b * f))
    return float(m_2 - w * m_l**2 - (1 - w) * m_b**2)


@exercise(10)
def balance_weight(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 10: the MIS weight of a light sample."""
    rng = np.random.default_rng(seeded(1))
    p_l, p_b = rng.exponential(1, (2, 1000))
    for w in (0.5, round(between(0.9, 0.6, 0.95), 2)):
        (weight,) = call(module, "balance_weight", p_l, p_b, w, shapes=[p_l.shape])
        yield compare(f"w = {w}", weight, w * p_l / (w * p_l + (1 - w) * p_b), 1e-6, "A technique counts by its share")
        (other,) = call(module, "balance_weight", p_b, p_l, 1 - w, shapes=[p_l.shape])
        yield compare(f"w = {w}: both weights sum to 1", weight + other, 1.0, 1e-6)
    ends = np.array([0.0, 2.0, 0.0]), np.array([3.0, 0.0, 0.0])
    (weight,) = call(module, "balance_weight", *ends, 0.5, shapes=[(3,)])
    yield compare("densities of 0: weights 0, 1, 0", weight, np.array([0.0, 1, 0]), 1e-6)


@exercise(11)
def estimate(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 11: the estimate of samples of both techniques."""
    rng = np.random.default_rng(seeded(2))
    x = np.linspace(-4, 4, 20_001)
    exact, n = float(integrand(x).sum() * (x[1] - x[0])), 40_000
    for n_l, n_b in ((1, 1), (3, 1), (1, 4)):
        light, brdf = (rng.normal(0, s, (k, n)) for s, k in zip(_SIGMA, (n_l, n_b), strict=True))
        arguments = [a for x_i in (light, brdf) for a in (integrand(x_i), *densities(x_i))]
        (values,) = call(module, "estimate", *arguments, shapes=[(n,)])
        name, total = f"{n_l} light, {n_b} BRDF samples", n_l + n_b
        yield z_test(f"{name}: mean", values, exact)
        expected = exact_variance(n_l / total, x) / total
        advice = "Weigh each sample by both densities, times their numbers"
        yield at_most(f"{name}: noise", float(values.var()), 1.05 * expected, "the variance", advice)
        right = sum((f / (n_l * p_l + n_b * p_b)).sum(axis=0) for f, p_l, p_b in (arguments[:3], arguments[3:]))
        advice = "A sample counts f / (n_l p_l + n_b p_b), whichever technique drew it"
        yield compare(f"{name}: values", values, np.asarray(right), 1e-5, advice)


@exercise(12)
def variance_curve(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 12: the variance as a function of the share."""
    x = np.linspace(-3, 3, 3001)
    w = np.array([0.05, 0.25, 0.5, 0.75, 0.95])
    dx = float(x[1] - x[0])
    (curve,) = call(module, "variance_curve", integrand(x), *densities(x), dx, w, shapes=[w.shape])
    expected = np.array([exact_variance(float(share), x) for share in w])
    advice = "Fixed numbers: the means of the two groups are subtracted, not I²"
    yield compare("V(w) of fixed numbers of samples", curve, expected, 1e-4, advice)
    rng = np.random.default_rng(seeded(3))
    light, brdf = (rng.normal(0, s, (k, 100_000)) for s, k in zip(_SIGMA, (3, 1), strict=True))
    values = np.zeros(light.shape[1])
    for samples in (light, brdf):
        p_l, p_b = densities(samples)
        values += (integrand(samples) / (0.75 * p_l + 0.25 * p_b)).sum(axis=0) / 4
    squares = (values - values.mean()) ** 2 * 4
    yield z_test("3 light samples and 1 BRDF sample, simulated", squares, float(curve[3]))
