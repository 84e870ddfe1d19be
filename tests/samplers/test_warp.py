"""Maps from the square: Jacobian = 1/density, inversion, chi-square."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from helpers import grid_uniforms

from dmis.base.vectors import Array, dot
from dmis.samplers import warp
from dmis.testing.sphere import polar, uniforms


@dataclass(frozen=True)
class Map:
    """A warp, its inverse, the density of its result, and the dimension of that result."""

    forward: Callable[[Array], Array]
    inverse: Callable[[Array], Array]
    density: Callable[[Array], Array]


def turn(w: Array) -> Array:
    """Return azimuths in full turns, in [0, 1)."""
    return np.arctan2(w[1], w[0]) / warp.TWO_PI % 1


def cone_height(w: Array) -> Array:
    """Return ``1 - cos`` of directions, without cancellation near the axis."""
    sin2 = w[0] ** 2 + w[1] ** 2
    h = sin2 / (1 + np.sqrt(np.maximum(1 - sin2, 0)))
    return np.where(w[2] < 0, 2 - h, h)


def cone(one_minus_cos: float) -> Map:
    c = np.float64(one_minus_cos)
    return Map(
        lambda u: warp.square_to_cone(u, c.astype(u.dtype)),
        lambda w: np.stack([cone_height(w) / c.astype(w.dtype), turn(w)]),
        lambda w: np.broadcast_to(warp.cone_pdf(c), w.shape[1]),
    )


def lobe(exponent: float) -> Map:
    e = np.float64(exponent)
    return Map(
        lambda u: warp.square_to_power(u, e.astype(u.dtype)),
        lambda w: np.stack([1 - w[2] ** (e.astype(w.dtype) + 1), turn(w)]),
        lambda w: warp.power_pdf(w[2], e),
    )


MAPS = {
    "disk": Map(
        warp.square_to_disk,
        lambda p: np.stack([p[0] ** 2 + p[1] ** 2, turn(p)]),
        lambda p: np.full(p.shape[1], 1 / np.pi),
    ),
    "sphere": Map(
        warp.square_to_sphere,
        lambda w: np.stack([(1 - w[2]) / 2, turn(w)]),
        lambda w: np.full(w.shape[1], 1 / (4 * np.pi)),
    ),
    "hemisphere": Map(
        warp.square_to_hemisphere, lambda w: np.stack([w[2], turn(w)]), lambda w: np.full(w.shape[1], 1 / (2 * np.pi))
    ),
    "cosine": Map(warp.square_to_cosine, lambda w: np.stack([1 - w[2] ** 2, turn(w)]), lambda w: w[2] / np.pi),
    "triangle": Map(
        warp.square_to_triangle,
        lambda b: np.stack([(1 - b[0]) ** 2, b[1] / (1 - b[0])]),
        lambda b: np.full(b.shape[1], 2.0),
    ),
    "cone 1e-12": cone(1e-12),
    "cone 1e-6": cone(1e-6),
    "cone 0.3": cone(0.3),
    "cone 1.9": cone(1.9),
    "power 0": lobe(0),
    "power 10": lobe(10),
    "power 1e4": lobe(1e4),
}
each_map = pytest.mark.parametrize("name", MAPS)


@each_map
def test_jacobian_is_the_reciprocal_density(name: str) -> None:
    """The area of the image of a small square, over the square's, is 1/density: central differences in float64.

    The step 1e-5 leaves a truncation of order 1e-8 (third derivatives times h^2) and a rounding of 1e-11; the maps'
    constants (2 pi, pi) are float32, which is where 1e-6 comes from.
    """
    m, u, h = MAPS[name], grid_uniforms(15), 1e-5
    du, dv = (
        (m.forward(u + np.reshape(d, (2, 1))) - m.forward(u - np.reshape(d, (2, 1)))) / (2 * h)
        for d in ((h, 0), (0, h))
    )
    if len(du) == 2:
        area = np.abs(du[0] * dv[1] - du[1] * dv[0])
    else:
        area = np.linalg.norm(np.cross(du, dv, axis=0), axis=0)
    np.testing.assert_allclose(area * m.density(m.forward(u)), 1, rtol=1e-6)


@pytest.mark.parametrize("name", [n for n in MAPS if n != "power 1e4"])
def test_inverse_float32(name: str) -> None:
    """The inverse undoes the map in float32, to a few roundings: 1e-5 of the square, 170 of its smallest steps.

    At exponent 1e4 a cosine is 1 minus a few hundred roundings, so that it cannot be inverted in float32.
    """
    m, u = MAPS[name], grid_uniforms(31, np.float32)
    w = m.forward(u)
    assert w.dtype == np.float32
    np.testing.assert_allclose(m.inverse(w), u, atol=1e-5)


@each_map
@pytest.mark.parametrize("corner", [(0.0, 0.0), (0.0, 1 - 2**-24), (1 - 2**-24, 0.0), (1 - 2**-24, 1 - 2**-24)])
def test_corners_are_finite_and_of_unit_length(name: str, corner: tuple[float, float]) -> None:
    """The extreme uniform numbers give finite results in the domain."""
    w = MAPS[name].forward(np.array(corner, np.float32)[:, None])
    assert np.isfinite(w).all()
    if len(w) == 3:
        np.testing.assert_allclose(dot(w, w), 1, atol=1e-6)
    elif name == "triangle":
        assert (w >= 0).all() and w.sum() <= 1 + 1e-6
    else:
        assert np.hypot(*w) <= 1 + 1e-6


@pytest.mark.parametrize("degrees", [0, 40, 90, 140, 180])
def test_to_world_turns_z_into_the_normal(degrees: float) -> None:
    """A rotation: z becomes the normal, lengths and angles stay."""
    n = polar(degrees)[:, None]
    w = warp.square_to_sphere(uniforms(100).astype(float))
    turned = warp.to_world(w, n)
    np.testing.assert_allclose(warp.to_world(np.array([[0.0], [0.0], [1.0]]), n), n, atol=1e-12)
    np.testing.assert_allclose(dot(n, turned), w[2], atol=1e-6)  # w itself is only as long as a float32 2 pi allows
    np.testing.assert_allclose(turned.T @ turned, w.T @ w, atol=1e-12)


def test_atan2_agrees_with_numpy() -> None:
    """In all quadrants, on the axes and at all scales; 3.5e-7 is a rounding or two of an angle up to pi."""
    angle = np.linspace(-np.pi, np.pi, 100_001)
    for radius in (1e-20, 1.0, 1e20):
        y, x = (radius * np.sin(angle)).astype(np.float32), (radius * np.cos(angle)).astype(np.float32)
        expected = np.arctan2(y.astype(float), x.astype(float))
        np.testing.assert_allclose(warp.atan2(y, x), expected, atol=3.5e-7)
    y, x = np.array([[0, 0, 1, -1, 0], [0, -1, 0, 0, 1]], np.float32)
    np.testing.assert_allclose(warp.atan2(y, x), np.arctan2(y, x), atol=3.5e-7)
