"""Directions of checks: uniform numbers, unit vectors, angles about an axis, and a quadrature over the sphere."""

from __future__ import annotations

from typing import Any

import numpy as np

from dmis.base.vectors import Array, frame


def uniforms(count: int, seed: int = 1, numbers: int = 2) -> Array:
    """Return random numbers in [0, 1), ``(numbers, count)`` float32."""
    return np.random.default_rng(seed).random((numbers, count), dtype=np.float32)


def polar(degrees: float, azimuth: float = 25.0) -> Array:
    """Return the unit vector at `degrees` from +z, ``(3,)``; the default azimuth is no symmetry of any frame."""
    theta, phi = np.radians(degrees), np.radians(azimuth)
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def columns(v: Any, count: int = 1) -> Array:
    """Return the vector `v` repeated, C-contiguous ``(3, count)`` float32."""
    return np.ascontiguousarray(np.repeat(np.asarray(v, np.float32).reshape(3, 1), count, axis=1))


def unit(*v: float) -> Array:
    """Return a unit vector along `v`, ``(3,)`` float64."""
    a = np.array(v, float)
    return a / np.linalg.norm(a)


def angles(w: Array, axis: Array) -> tuple[Array, Array]:
    """Return the angle from `axis` ``(3,)`` and the azimuth about it in [0, 2 pi) of directions ``(3, N)``, float64."""
    s, t = frame(axis)
    x, y, z = s @ w.astype(float), t @ w.astype(float), axis @ w.astype(float)
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x) % (2 * np.pi)


def directions(theta: Array, phi: Array, axis: Array) -> Array:
    """Return the directions ``(3, N)`` float32 of angles from `axis` ``(3,)`` and azimuths about it, ``(N,)``."""
    s, t = frame(axis)
    sides = np.outer(s, np.sin(theta) * np.cos(phi)) + np.outer(t, np.sin(theta) * np.sin(phi))
    return (sides + np.outer(axis, np.cos(theta))).astype(np.float32)


def sphere_rule(
    axis: Array | tuple[float, float, float] = (0.0, 0.0, 1.0), rings: int = 512, sectors: int = 256, power: float = 1.0
) -> tuple[Array, Array]:
    """Return the midpoint rule over the sphere; ``power > 1`` puts more rings near `axis`, where a narrow lobe lies.

    Directions ``(3, M)`` float32 and weights ``(M,)``, M = rings * sectors.
    """
    edges = np.pi * np.linspace(0, 1, rings + 1) ** power
    middle = (edges[1:] + edges[:-1]) / 2
    # cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2), without cancellation in narrow rings
    ring = 2 * np.sin(middle) * np.sin(np.diff(edges) / 2) * (2 * np.pi / sectors)
    phi = (np.arange(sectors) + 0.5) * (2 * np.pi / sectors)
    w = directions(np.repeat(middle, sectors), np.tile(phi, rings), np.asarray(axis, float))
    return w, np.repeat(ring, sectors)
