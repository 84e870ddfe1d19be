"""Checks of exercises 13 to 15, of tutorial 4: the parabola, whole samples, the pilot in the image."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import numpy as np

from dmis.fit.thesis import parabola_minimum
from dmis.testing.outcome import Outcome
from grading import at_most, between, call, compare, exercise, seeded, z_test


@exercise(13)
def best_share(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 13: the minimum of a parabola through three variances."""
    cases = {
        "a minimum inside": (5.0, 1.0, 2.0, 0.65),
        "a minimum outside of [0, 1]: the nearer end": (1.0, 3.0, 5.1, 0.0),
        "no minimum: the best of the three": (1.0, 5.0, 2.0, 0.0),
        "no minimum, falling: the best of the three": (5.0, 4.0, 1.0, 1.0),
        "no signal: 1/2": (0.0, 0.0, 0.0, 0.5),
    }
    y = np.array([case[:3] for case in cases.values()]).T
    (share,) = call(module, "best_share", *y, shapes=[(len(cases),)])
    for k, (name, case) in enumerate(cases.items()):
        yield compare(name, share[k], case[3], 1e-6)
    y = np.random.default_rng(seeded(1)).exponential(1, (3, 40, 30))
    (share,) = call(module, "best_share", *y, shapes=[(40, 30)])
    expected, _ = parabola_minimum(np.array([0, 0.5, 1]), y)
    yield compare("1,200 patches of noise, as the rule thesis", share, expected, 1e-5)


@exercise(14)
def light_slots(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 14: shares rounded to whole samples."""
    rng = np.random.default_rng(seeded(2))
    n, slots = 50_000, 10
    for share in (0.0, round(between(0.23, 0.1, 0.4), 2), 0.5, round(between(0.87, 0.6, 0.95), 2), 1.0):
        w = np.full(n, share)
        (light,) = call(module, "light_slots", w, slots, rng.random(n), shapes=[(slots, n)])
        yield compare(f"w = {share}: each slot is 0 or 1", np.abs(light - 0.5), 0.5, 1e-9)
        count = light.sum(axis=0)
        off = float(np.abs(count - share * slots).max())
        yield at_most(f"w = {share}: numbers", off, 1 - 1e-9, "the largest |n - w S|", "Lots differ by much more")
        yield z_test(f"w = {share}: the mean number is w S", count, share * slots)
        if 0 < share < 1:
            worst = np.abs(light.mean(axis=1) - share).max() / np.sqrt(share * (1 - share) / n)
            yield at_most(f"w = {share}: every slot alike", float(worst), 4.0, "the largest z of a slot's share")


@exercise(15)
def combine(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 15: the samples of a pilot in the image, without bias."""
    rng = np.random.default_rng(seeded(3))
    n = 100_000
    pilot, final = rng.normal(1, 1, (6, n)), rng.normal(1, 1, (26, n))
    (values,) = call(module, "combine", pilot, final, shapes=[(n,)])
    yield z_test("mean, even noise", values, 1.0)
    yield at_most("the pilot counts", float(values.var()), 1.05 / 32, "the variance", "Samples alike count alike")
    spikes = 50 * (rng.random((32, n)) < 0.02)
    (values,) = call(module, "combine", spikes[:6], spikes[6:], shapes=[(n,)])
    advice = "A pilot that missed the spike looks quiet: its own noise must not decide how it counts"
    yield z_test("mean, one sample in fifty is a spike", values, 1.0, advice)
    # a P + (1 - a) F of the two means, with the same a for all samples
    (share,) = call(module, "combine", np.ones((6, n)), np.zeros((26, n)), shapes=[(n,)])
    fixed = share * spikes[:6].mean(axis=0) + (1 - share) * spikes[6:].mean(axis=0)
    yield compare("weights do not depend on the samples", values, fixed, 1e-6, "Fix them before any sample is seen")
    (values,) = call(module, "combine", np.ones((6, n)), np.ones((26, n)), shapes=[(n,)])
    yield compare("samples of 1 give 1", values, 1.0, 1e-6, "The weights of both passes must sum to 1")
