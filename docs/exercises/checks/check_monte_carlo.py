"""Checks of exercises 4 to 6, of tutorial 1: standard errors, the variance of a lamp, merged moments."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import numpy as np

from dmis.testing.outcome import Outcome
from grading import at_most, between, call, compare, exercise, exponent, seeded, z_test


@exercise(4)
def mean_and_error(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 4: a mean and its standard error."""
    samples = np.array([[1.0, 2], [3, 2], [5, 2], [3, 2]])
    mean, error = call(module, "mean_and_error", samples, shapes=[(2,), (2,)])
    yield compare("mean", mean, np.array([3.0, 2]), 1e-6)
    expected = np.array([np.sqrt(8 / 3 / 4), 0])
    advice = "Divide by n - 1 for the variance, by n for that of the mean"
    yield compare("standard error", error, expected, 1e-6, advice)
    pairs = np.random.default_rng(seeded(1)).normal(0, 3, (2, 100_000))
    _, error = call(module, "mean_and_error", pairs, shapes=[(100_000,)] * 2)
    yield z_test("squared errors from two samples are unbiased", error**2, 4.5)
    many = np.random.default_rng(seeded(2)).exponential(1, (200, 20_000))
    mean, error = call(module, "mean_and_error", many, shapes=[(20_000,)] * 2)
    inside = np.abs(mean - 1) < 1.96 * error
    yield at_most("95 % intervals hold the truth", float(abs(inside.mean() - 0.95)), 0.01, "the distance from 95 %")


@exercise(5)
def lamp_variance(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 5: the variance of one sample of the lamp's integral."""
    e = exponent(5)  # X = 2 pi u^e
    for degrees in (90, round(between(25, 10, 80)), 1):
        c = np.cos(np.radians(degrees))
        first, second = (1 - c ** (e + 1)) / (e + 1), (1 - c ** (2 * e + 1)) / (2 * e + 1)
        expected = 4 * np.pi**2 * (second - first**2)
        (variance,) = call(module, "lamp_variance", np.radians(degrees), shapes=[()])
        yield compare(f"half angle of {degrees}°", variance, expected, 1e-4, "It is the second moment less I²")
    u = np.random.default_rng(seeded(3)).random((50, 20_000))
    half_angle = np.radians(40)
    samples = 2 * np.pi * np.where(u > np.cos(half_angle), u**e, 0)
    (variance,) = call(module, "lamp_variance", half_angle, shapes=[()])
    yield z_test("agrees with 20,000 sample variances", samples.var(axis=0, ddof=1), float(variance))


@exercise(6)
def merge(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 6: moments of two parts, merged."""
    rng = np.random.default_rng(seeded(4))
    yield from _merged(module, rng.normal(2, 1, (30, 50)), 7, "30 samples in two parts")
    far = rng.normal(0, 1, (30, 50)) + 1e8
    yield from _merged(module, far, 11, "the same around 100,000,000", "Squares of large numbers cancel; differ first")
    samples = rng.normal(size=(9, 4))
    parts = [_moments(samples[k : k + 3]) for k in (0, 3, 6)]
    left = _call(module, _call(module, parts[0], parts[1]), parts[2])
    right = _call(module, parts[0], _call(module, parts[1], parts[2]))
    yield compare("any grouping gives the same", left[2], right[2], 1e-9)


def _merged(module: ModuleType, samples: np.ndarray, k: int, name: str, advice: str = "") -> Iterator[Outcome]:
    n, mean, m2 = _call(module, _moments(samples[:k]), _moments(samples[k:]))
    yield compare(f"{name}: number", np.array(n), float(len(samples)), 1e-12)
    yield compare(f"{name}: mean", mean, samples.mean(axis=0), 1e-12)
    yield compare(f"{name}: squared deviations", m2, _moments(samples)[2], 1e-5, advice)


def _moments(samples: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
    mean = samples.mean(axis=0)
    return len(samples), mean, ((samples - mean) ** 2).sum(axis=0)


def _call(module: ModuleType, a: tuple, b: tuple) -> tuple[float, np.ndarray, np.ndarray]:
    shape = a[1].shape
    n, mean, m2 = call(module, "merge", a, b, shapes=[(), shape, shape])
    return float(n), mean, m2
