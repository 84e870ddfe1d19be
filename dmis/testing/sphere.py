"""Directions of checks: angles about an axis, and quadrature over the sphere."""

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


def sphere_nodes(axis: Array, theta: Array, phi: Array, per_cell: int) -> tuple[Array, Array]:
    """Return midpoint nodes of the cells between the edges `theta` and `phi` about `axis`, and their solid angles.

    Directions ``(3, M)`` float32 and weights ``(M,)``, M = cells * per_cell**2, the nodes of a cell in a row. Weights
    are exact differences of cosines, so that they add up to the sphere's solid angle.
    """
    fine = [np.interp(np.arange((len(e) - 1) * per_cell + 1) / per_cell, np.arange(len(e)), e) for e in (theta, phi)]
    mid = [(e[1:] + e[:-1]) / 2 for e in fine]
    # cos a - cos b without cancellation for narrow rings
    ring = 2 * np.sin(mid[0]) * np.sin(np.diff(fine[0]) / 2)
    shape = (len(theta) - 1, per_cell, len(phi) - 1, per_cell)
    weights = np.outer(ring, np.diff(fine[1])).reshape(shape).swapaxes(1, 2).reshape(-1)
    x, y = frame(axis)
    around = np.outer(x, np.cos(mid[1])) + np.outer(y, np.sin(mid[1]))
    w = np.sin(mid[0])[:, None] * around[:, None] + np.outer(axis, np.cos(mid[0]))[..., None]
    return w.astype(np.float32).reshape(3, *shape).swapaxes(2, 3).reshape(3, -1), weights


def sphere_rule(
    axis: Array | tuple[float, float, float] = (0.0, 0.0, 1.0), rings: int = 512, sectors: int = 256, power: float = 1.0
) -> tuple[Array, Array]:
    """Return the midpoint rule over the sphere; ``power > 1`` puts more rings near `axis`, where a narrow lobe lies.

    Directions ``(3, M)`` float32 and weights ``(M,)``, M = rings * sectors.
    """
    theta = np.pi * np.linspace(0, 1, rings + 1) ** power
    return sphere_nodes(np.asarray(axis, float), theta, np.linspace(0, 2 * np.pi, sectors + 1), 1)
