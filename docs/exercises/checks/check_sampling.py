"""Checks of exercises 7 to 9, of tutorial 2: a density without variance, half vectors, a table of the sky."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import numpy as np

from dmis.base.vectors import Array
from dmis.testing.outcome import Outcome
from dmis.testing.sphere import columns, uniforms
from grading import at_most, between, call, check_directions, chi_square, compare, exercise, exponent, seeded


@exercise(7)
def no_variance(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 7: directions in a lamp's cone in proportion to their cosine."""
    half_angle, e, n = np.radians(between(25, 15, 60)), exponent(7), 100_000
    (wi,) = call(module, "sample", uniforms(n, seeded(1)), half_angle, shapes=[(3, n)])
    yield compare("directions are unit vectors", (wi * wi).sum(axis=0), 1.0, 1e-4)
    cos = np.clip(wi[2], -1, 1)
    inside = cos >= np.cos(half_angle) - 1e-6
    yield at_most("all directions meet the lamp", float(1 - inside.mean()), 0.0, "the share that misses it")
    (density,) = call(module, "pdf", cos, half_angle, shapes=[(n,)])

    # the integral of the density over the lamp, by the midpoint rule in z, and a chi-square test in cells of z and phi
    edges = np.linspace(np.cos(half_angle), 1, 21)
    z = (edges[:-1, None] + np.diff(edges)[:, None] * (np.arange(50) + 0.5) / 50).reshape(-1)
    (p,) = call(module, "pdf", z, half_angle, shapes=[z.shape])
    cells = 2 * np.pi * p.reshape(20, 50).mean(axis=1) * np.diff(edges)
    yield compare("the density integrates to 1", np.array(cells.sum()), 1.0, 1e-3)
    phi = np.arctan2(wi[1], wi[0])
    counts = np.histogram2d(cos.clip(edges[0], 1), phi, [edges, np.linspace(-np.pi, np.pi, 9)])[0]
    yield chi_square("samples follow the density", counts, np.repeat(cells[:, None] / 8, 8, axis=1) * n)
    ratio = cos**e / np.maximum(density, 1e-9)
    spread = float(ratio.std() / ratio.mean())
    yield at_most("the light over the density has no variance", spread, 1e-3, "its relative standard deviation")


@exercise(8)
def half_vectors(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 8: directions mirrored at half vectors, and their density."""
    n, e = 100_000, between(30.0, 10, 60)
    for degrees in (10, 60):
        wo = np.array([np.sin(np.radians(degrees)), 0, np.cos(np.radians(degrees))], np.float32)
        (wi,) = call(module, "sample", columns(wo, n), uniforms(n, seeded(2)), e, shapes=[(3, n)])
        yield compare(f"wo at {degrees}°: directions are unit vectors", (wi * wi).sum(axis=0), 1.0, 1e-4)

        def density(directions: Array, wo: Array = wo) -> Array:
            count = directions.shape[1]
            return call(module, "pdf", columns(wo, count), directions, e, shapes=[(count,)])[0]

        yield from check_directions(f"wo at {degrees}°", wi, density)


@exercise(9)
def sky(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 9: points of a table in proportion to its values."""
    n = 200_000
    table = np.random.default_rng(seeded(3)).random((6, 9)) ** 4
    table[2], table[:, 4] = 0, 0
    table[1, 7] = 20  # the sun
    height, width = table.shape
    points, density = call(module, "sample_table", table, uniforms(n, seeded(4)), shapes=[(2, n), (n,)])
    yield compare("points are in the unit square", points.clip(0, 1), points, 0.0)
    column, row = (np.clip(points[k] * size, 0, size - 1).astype(int) for k, size in enumerate((width, height)))
    counts = np.bincount(row * width + column, minlength=table.size)
    yield chi_square("texels are picked in proportion", counts, table.ravel() / table.sum() * n)
    yield compare("density = value / mean", density, table[row, column] / table.mean(), 1e-4)
    sun = (row == 1) & (column == 7)
    for k, (axis, size) in enumerate((("x", width), ("y", height))):
        inside = np.histogram(points[k][sun] * size % 1, 20, (0, 1))[0]
        yield chi_square(f"points are even within a texel, {axis}", inside, np.full(20, sun.sum() / 20))
    corner = np.nextafter(np.float32(1), np.float32(0)) * np.ones((2, 1), np.float32)
    points, density = call(module, "sample_table", table, corner, shapes=[(2, 1), (1,)])
    at_end = bool((points < 1).all() and density[0] > 0)
    yield Outcome("u just below 1", at_end, f"point {points[:, 0]}, density {density[0]:.3g}; it must be in the table")
