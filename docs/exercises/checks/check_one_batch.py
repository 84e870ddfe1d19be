"""Checks of exercises 1 to 3, of tutorial 0: mirror directions, the density of a light, direct light."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import ModuleType

import numpy as np

from dmis.base.vectors import Array, dot, normalise
from dmis.light.area import QuadLight
from dmis.testing.outcome import Outcome
from dmis.testing.sphere import columns, uniforms
from grading import between, call, compare, exercise, likely_mistake, seeded, z_test

_LIGHT = QuadLight((-1.0, -0.5, 2.0), (0.0, 1.0, 0.0), (2.0, 0.0, 0.0), (3.0, 2.0, 1.0))
"""A rectangle of 2 by 1 at the height 2 that shines down."""
_BRIGHT = replace(_LIGHT, radiance=(3e4, 2e4, 1e4))


@exercise(1)
def mirror(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 1: mirror directions of a batch."""
    rng = np.random.default_rng(seeded(1))
    n, wo = (normalise(rng.normal(size=(3, 1000)).astype(np.float32)) for _ in range(2))
    (wi,) = call(module, "mirror", wo, n, shapes=[wo.shape])
    yield compare("directions are unit vectors", (wi * wi).sum(axis=0), 1.0, 1e-4)
    yield compare("wi and wo have the same angle to n", (n * wi).sum(axis=0), dot(n, wo), 1e-4)
    across = np.cross(wo, wi, axis=0)
    yield compare("n, wo and wi lie in one plane", (across * n).sum(axis=0), 0.0, 1e-4)
    expected = 2 * dot(n, wo) * n - wo
    yield compare("wi is wo mirrored at n", wi, expected, 1e-4, "Keep the part along n, and reverse the part across n")


@exercise(2)
def light_density(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 2: the density of a point on a light, per solid angle."""
    normal = np.array([0, 0, -1], np.float32)
    p = np.array([[0, 0, 1.5, 0], [0, 0, 0, 0], [0, 1, 0, 3]], np.float32)
    x = np.repeat(np.array([[0], [0], [2]], np.float32), 4, axis=1)
    (density,) = call(module, "light_density", p, x, normal, 2.0, shapes=[(4,)])
    yield compare("straight below: r² / A", density[:2], np.array([2.0, 0.5]), 1e-4)
    yield compare("from the side: r² / (A cos)", density[2], 6.25 / (2 * 0.8), 1e-4, "Divide by the light's cosine")
    yield compare("behind the light: 0", density[3], 0.0, 1e-6, "The light shines on one side only")

    # the mean of 1 / p over samples of p is the solid angle of the light: here of half sides a, b at the height h
    u = np.random.default_rng(seeded(2)).random((2, 100_000), dtype=np.float32)
    points = np.stack([2 * u[0] - 1, u[1] - 0.5, np.full_like(u[0], 2)])
    (density,) = call(module, "light_density", np.zeros_like(points), points, normal, 2.0, shapes=[(u.shape[1],)])
    solid_angle = 4 * np.arctan(1 * 0.5 / (2 * np.sqrt(1 + 0.25 + 4)))
    yield z_test("1 / density adds up to the solid angle", 1 / np.maximum(density, 1e-9), solid_angle)


@exercise(3)
def direct_light(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 3: one light sample of the radiance that a matte point reflects."""
    n = 50_000
    albedo = np.array([[between(0.8, 0.3, 0.9)], [0.5], [0.2]], np.float32)
    for name, p, normal in (
        ("below the light", (0.2, 0.1, 0.0), (0.0, 0.0, 1.0)),
        ("where a part of the light is below the horizon", (0.0, 0.0, 0.0), (0.95, 0.0, 0.312)),
        ("behind the light", (0.3, 0.2, 3.0), (0.0, 0.0, -1.0)),
        ("beside and behind the light", (2.5, 0.4, 2.2), (-1.0, 0.0, 0.0)),
    ):
        points, normals = columns(p, n), columns(normalise(np.array(normal)), n)
        arguments = points, normals, albedo, _LIGHT, uniforms(n, seeded(3))
        (radiance,) = call(module, "direct_light", *arguments, shapes=[(3, n)])
        advice = likely_mistake(radiance, _mistakes(*arguments), "Look at sample.pdf, sample.emits and the cosine")
        if p[2] > 2:
            yield compare(f"{name}: no light", radiance, 0.0, 1e-6, advice)
            continue
        exact = _reflected(np.array(p), normals[:, 0].astype(float)) * albedo[:, 0] * np.array([3.0, 2.0, 1.0])
        for channel, colour in enumerate(("red", "green", "blue")):
            yield z_test(f"{name}, {colour}", radiance[channel], float(exact[channel]), advice)
        bright = call(module, "direct_light", *arguments[:3], _BRIGHT, arguments[4], shapes=[(3, n)])[0]
        advice = "The estimate is linear in the radiance: limiting large values makes the image too dark"
        yield compare(f"{name}: 10,000 times the light", bright, radiance * 10_000, 1e-3, advice)
        if (radiance < 0).any():
            advice = "Light from below the surface counts 0: there the cosine is negative"
            yield Outcome(name, False, f"radiance is never negative; got {radiance.min():.3g}. {advice}")


def _mistakes(p: Array, n: Array, albedo: Array, light: QuadLight, u: Array) -> list[tuple[str, Array]]:
    """Return advice on what may be missing, and what the estimates are without it."""
    sample = light.sample(p, u)
    cos, pdf = dot(n, sample.wi), np.maximum(sample.pdf, 1e-12)
    radiance = albedo / np.pi * sample.radiance
    emitted, lit = radiance * sample.emits, np.maximum(cos, 0)
    density = "The density is missing: divide by sample.pdf"
    one_side = "The light shines on one side: count 0 where sample.emits is False"
    below = "Light from below the surface counts 0: there the cosine is negative"
    return [
        (density, radiance * cos),
        (density, emitted * lit),
        (below, emitted * cos / pdf),
        (below, emitted * np.abs(cos) / pdf),
        (one_side, radiance * lit / pdf),
        (one_side, radiance * cos / pdf),
        ("The cosine between n and sample.wi is missing", emitted / pdf),
        ("The BRDF of a matte surface is albedo / pi", emitted * np.pi * lit / pdf),
    ]


def _reflected(p: Array, n: Array, side: int = 600) -> float:
    """Return the integral over the light of cos / pi per solid angle, by the midpoint rule."""
    line = (np.arange(side) + 0.5) / side
    x, y = np.meshgrid(2 * line - 1, line - 0.5)
    to = np.stack([x - p[0], y - p[1], np.full_like(x, 2 - p[2])])
    r2 = (to * to).sum(axis=0)
    r = np.sqrt(r2)
    cos_i = np.maximum(np.tensordot(n, to, 1) / r, 0)
    return float((cos_i / np.pi * (to[2] / r) / r2).mean() * 2.0)
