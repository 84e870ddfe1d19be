"""Checks of exercises 22 to 24, of tutorial 7: one of several lamps, mirrors, light that paths find twice."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import numpy as np

from dmis.base.vectors import Array
from dmis.testing.outcome import Outcome
from grading import call, compare, exercise, seeded


@exercise(22)
def one_of_many(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 22: the density of a direction where one of several lamps is picked."""
    rng = np.random.default_rng(seeded(1))
    n, lamps = 2000, 5
    met = rng.integers(-1, lamps, n)
    distance, cos_l = rng.uniform(0.5, 3, n) * (met >= 0), rng.uniform(-1, 1, n) * (met >= 0)
    area, q = rng.uniform(0.1, 2, lamps), rng.dirichlet(np.ones(lamps))
    lit = (met >= 0) & (cos_l > 0)
    alone = np.where(lit, distance**2 / (area[met] * np.where(lit, cos_l, 1)), 0)

    def density(*arguments: Array) -> Array:
        (p_l,) = call(module, "light_density", *arguments, shapes=[(len(arguments[0]),)])
        return p_l

    p_l = density(met, distance, cos_l, area, q)
    advice = "It is that of one lamp alone: the probability q of the lamp is missing"
    advice = advice if np.allclose(p_l, alone) else "It is q d^2 / (A cos), with the lamp that the ray meets"
    yield compare("the lamp's probability is part of the density", p_l[lit], (q[met] * alone)[lit], 1e-5, advice)
    yield compare("no lamp is met", p_l[met < 0], 0.0, 1e-12, "Where met is -1 light sampling draws nothing")
    dark = (met >= 0) & (cos_l <= 0)
    yield compare("a lamp from behind", p_l[dark], 0.0, 1e-12, "Where cos_l is not positive a lamp sends nothing")
    single = density(np.zeros(3, int), np.ones(3), np.array([1, 0.5, 0.25]), np.array([2.0]), np.ones(1))
    yield compare("a single lamp", single, np.array([0.5, 1, 2]), 1e-6)


@exercise(23)
def delta(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 23: what samples add where a surface has a mirror, too."""
    rng = np.random.default_rng(seeded(2))
    n = 4000
    p_l, p_b, f = rng.uniform(0.1, 4, (3, n))
    by_brdf = rng.random(n) < 0.6
    mirrored = by_brdf & (rng.random(n) < 0.4)
    p_b[mirrored] = 0
    p_l[mirrored & (rng.random(n) < 0.5)] = 0  # rays that meet a wall that glows
    nothing = ~mirrored & (rng.random(n) < 0.1)
    for density in (p_l, p_b, f):
        density[nothing] = 0
    (added,) = call(module, "contribution", f, p_l, p_b, by_brdf, mirrored, shapes=[(n,)])
    light, brdf = (~mirrored & ~nothing & drawn for drawn in (~by_brdf, by_brdf))
    advice = "With one sample of each technique it is f / (p_l + p_b), whichever drew the row"
    yield compare("light samples", added[light], f[light] / (p_l + p_b)[light], 1e-5, advice)
    yield compare("BRDF samples", added[brdf], f[brdf] / (p_l + p_b)[brdf], 1e-5, advice)
    advice = "No other technique can draw a mirror's direction: its weight is 1, and there is no density to divide by"
    yield compare("rays that a mirror sent", added[mirrored], f[mirrored], 1e-5, advice)
    yield compare("rows where nothing is drawn", added[nothing], 0.0, 1e-9, "0 / 0 counts 0")


@exercise(24)
def once(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 24: the radiance of paths that find lamps in two ways."""
    rng = np.random.default_rng(seeded(3))
    d, n = 5, 500
    gathered, emitted, factor = rng.uniform(0.1, 2, (3, d, n))
    mirrored = rng.random((d, n)) < 0.5
    gathered[mirrored] = 0
    factor[rng.random((d, n)) < 0.2] = 0

    def of(*arguments: Array) -> Array:
        (total,) = call(module, "radiance", *arguments, shapes=[arguments[0].shape[1:]])
        return total

    def part(name: str, expected: Array, advice: str, **given: Array) -> Outcome:
        arguments = {"gathered": gathered, "emitted": emitted, "factor": factor, "mirrored": mirrored, **given}
        return compare(name, of(*(a.copy() for a in arguments.values())), expected, 1e-5, advice)

    none, ones, matte = np.zeros((d, n)), np.ones((d, n)), np.zeros((d, n), bool)
    before = np.concatenate([ones[:1], np.cumprod(factor, axis=0)[:-1]])  # throughput up to each surface
    shown = np.concatenate([np.ones((1, n), bool), mirrored[:-1]])
    advice = "Multiply by the factors of all steps before a surface, not by its own"
    yield part("gathered light times throughput", (before * gathered).sum(axis=0), advice, emitted=none)
    advice = "What the camera sees counts; after it, on matte surfaces, light that was gathered before is there twice"
    yield part("lamps among matte surfaces", emitted[0], advice, gathered=none, mirrored=matte)
    advice = "A mirror gathers nothing, so what its ray meets must count"
    yield part("lamps in mirrors", (before * emitted).sum(axis=0), advice, gathered=none, mirrored=~matte)
    advice = "It is the step that led to a surface which decides, not the one that leaves it"
    expected = (before * (gathered + shown * emitted)).sum(axis=0)
    yield part("all together", expected, advice)
