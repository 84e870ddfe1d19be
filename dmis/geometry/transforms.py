"""Affine transforms as ``(4, 4)`` float64 matrices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dmis.base.validate import direction, vector
from dmis.base.vectors import Floats


def translate(offset: npt.ArrayLike) -> Floats:
    """Return the matrix of a translation by `offset` (3,)."""
    m = np.eye(4)
    m[:3, 3] = vector("offset", offset)
    return m


def scale(factors: npt.ArrayLike) -> Floats:
    """Return the matrix that scales x, y and z by `factors`, three numbers or one for all."""
    factors = np.asarray(factors, np.float64)
    return np.diag([*vector("factors", np.full(3, factors) if factors.ndim == 0 else factors), 1.0])


def rotate(degrees: float, axis: npt.ArrayLike) -> Floats:
    """Return the matrix of a rotation about `axis` (3,); positive `degrees` turn x to y about z."""
    x, y, z = a = direction("axis", axis)
    sin, cos = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    m = np.eye(4)
    m[:3, :3] = cos * np.eye(3) + (1 - cos) * np.outer(a, a) + sin * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return m


def look_at(eye: npt.ArrayLike, at: npt.ArrayLike, up: npt.ArrayLike) -> Floats:
    """Return the matrix from world to camera, pbrt's ``LookAt``; camera space is x right, y up, z forward: left-handed.

    The columns of its inverse are x = up x z, y = z x x, z = at - eye, all of unit length, and the eye.
    """
    origin = vector("eye", eye)
    z = direction("the line of sight from eye to target", vector("target", at) - origin)
    x = np.cross(direction("up", up), z)
    if np.linalg.norm(x) < 1e-9:
        raise ValueError(f"up must not be parallel to the line of sight {z.tolist()}; got {up!r}")
    x /= np.linalg.norm(x)
    m = np.eye(4)
    m[:3, :3] = x, np.cross(z, x), z
    m[:3, 3] = -m[:3, :3] @ origin
    return m
