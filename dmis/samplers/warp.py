"""Maps from the unit square to the domains that rendering samples, with the density of each.

Every map is a pure function of uniform numbers, ``u`` of shape ``(2, N)`` in [0, 1). A test can so compare its
Jacobian with 1/pdf, invert it, and run a chi-square test. Formulas: Shirley et al., "Sampling Transformations Zoo",
Ray Tracing Gems, chapter 16, unless a docstring says otherwise.
"""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import TINY, Array, frame

PI = np.float32(np.pi)
TWO_PI = np.float32(2 * np.pi)
INV_PI = np.float32(1 / np.pi)
_MIN_CONE = np.float32(1e-37)  # its reciprocal is still finite in float32


def square_to_disk(u: Array) -> Array:
    """Return uniform points on the unit disk, ``(2, N)``; ``r = sqrt(u0)``, ``phi = 2 pi u1``. Area density 1/pi."""
    r = np.sqrt(u[0])
    phi = TWO_PI * u[1]
    return np.stack([r * np.cos(phi), r * np.sin(phi)])


def square_to_sphere(u: Array) -> Array:
    """Return uniform directions, ``(3, N)``; ``z = 1 - 2 u0``. Solid-angle density 1/(4 pi)."""
    z = 1 - 2 * u[0]
    return _polar(z, 2 * np.sqrt(u[0] * (1 - u[0])), u[1])


def square_to_hemisphere(u: Array) -> Array:
    """Return uniform directions about +z, ``(3, N)``; ``z = u0``. Solid-angle density 1/(2 pi)."""
    return _polar(u[0], np.sqrt(1 - u[0] * u[0]), u[1])


def square_to_cosine(u: Array) -> Array:
    """Return directions about +z with density ``cos/pi``, ``(3, N)``: Malley's method, ``z = sqrt(1 - u0)``."""
    return _polar(np.sqrt(1 - u[0]), np.sqrt(u[0]), u[1])


def square_to_cone(u: Array, one_minus_cos: Array) -> Array:
    """Return uniform directions in the cone about +z whose half angle has ``1 - cos`` as given, ``(3, N)``.

    The complement of the cosine is the argument, because a narrow cone's cosine is 1 in float32.
    """
    h = u[0] * one_minus_cos
    return _polar(1 - h, np.sqrt(h * (2 - h)), u[1])


def cone_pdf(one_minus_cos: Array) -> Array:
    """Return the solid-angle density of `square_to_cone`."""
    return 1 / (TWO_PI * np.maximum(one_minus_cos, _MIN_CONE))


def square_to_triangle(u: Array) -> Array:
    """Return barycentrics ``(2, N)`` of vertices 1 and 2, uniform in area."""
    root = np.sqrt(u[0])
    return np.stack([1 - root, u[1] * root])


def square_to_power(u: Array, exponent: Array) -> Array:
    """Return directions about +z with density ``(e+1)/(2 pi) cos^e``, ``(3, N)``: Blinn's half vectors."""
    log_cos = np.log(np.maximum(1 - u[0], TINY)) / (exponent + 1)
    return _polar(np.exp(log_cos), np.sqrt(-np.expm1(2 * log_cos)), u[1])


def power_pdf(cos: Array, exponent: Array) -> Array:
    """Return the solid-angle density of `square_to_power`."""
    return (exponent + 1) * power(cos, exponent) / TWO_PI


def power(x: Array, exponent: Array) -> Array:
    """Return ``x**exponent`` for x in [0, 1] as ``exp(exponent log x)``: three times as fast as ``np.power``."""
    return np.exp(np.log(np.maximum(x, TINY)) * exponent)


def to_world(w: Array, n: Array) -> Array:
    """Turn directions `w` ``(3, N)`` about +z into directions about the unit normals `n` ``(3, N)`` or ``(3, 1)``."""
    s, t = frame(n)
    return s * w[0] + t * w[1] + n * w[2]


def _polar(z: Array, r: Array, turn: Array) -> Array:
    """Return points ``(3, N)`` at height `z`, distance `r` from the z axis and azimuth `turn` in full turns."""
    phi = TWO_PI * turn
    xyz = np.empty((3, *np.shape(phi)), phi.dtype)
    np.multiply(r, np.cos(phi), out=xyz[0])
    np.multiply(r, np.sin(phi), out=xyz[1])
    xyz[2] = z
    return xyz


ATAN = np.array(
    [1, -0.33333072, 0.1999262, -0.14203645, 0.10640935, -0.07504296, 0.04269153, -0.01606864, 0.00284989], np.float32
)
"""Coefficients of ``atan(x) / x`` in powers of x^2: the minimax fit on [0, 1], whose error is 1.5e-8."""


def atan2(y: Array, x: Array) -> Array:
    """Return angles of the points (x, y) in [-pi, pi], float32, within 3.5e-7; 0 at the origin.

    A polynomial over whole arrays takes a third of the time of `numpy.arctan2`, which calls the C library for each
    number.
    """
    across = np.abs(x)
    up = np.abs(y)
    a = np.minimum(across, up) / np.maximum(np.maximum(across, up), TINY)
    square = a * a
    angle = square * ATAN[-1]
    for coefficient in ATAN[-2:0:-1]:
        angle += coefficient
        angle *= square
    angle += ATAN[0]
    angle *= a
    angle += (PI / 2 - 2 * angle) * (up > across)
    angle += (PI - 2 * angle) * (x < 0)
    return np.copysign(angle, y)
