"""What the statistical tests share: a chi-square test of directions, quadrature over the sphere, small scenes.

All seeds are fixed, so a test that passes once passes always; `LEVEL` says how likely a right implementation would
have been to fail at the first run. It is 1 % for all statistical tests of the suite together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.stats

from dmis.base.vectors import Array
from dmis.brdf.materials import Material, matte
from dmis.estimator.settings import Settings
from dmis.geometry.shapes import quad
from dmis.light.area import QuadLight
from dmis.light.light import Light
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.scene.shading_points import ShadingPoints

LEVEL = 1 - 0.99 ** (1 / 1000)
"""Šidák's level of each of (at most) 1000 statistical tests whose chance of any false alarm is 1 %."""
Z_LIMIT = float(scipy.stats.norm.isf(LEVEL / 2))
"""Two-sided limit of a normal deviate at `LEVEL`, 4.4."""


def uniforms(count: int, seed: int = 1) -> Array:
    """Random numbers in [0, 1), ``(2, count)`` float32."""
    return np.random.default_rng(seed).random((2, count), dtype=np.float32)


def grid_uniforms(side: int, dtype: type = np.float64, low: float = 0.03, high: float = 0.97) -> Array:
    """A regular grid in the unit square, away from its edges, ``(2, side**2)``."""
    line = np.linspace(low, high, side)
    return np.stack(np.meshgrid(line, line, indexing="ij")).reshape(2, -1).astype(dtype)


def unit(*v: float) -> Array:
    """A unit vector along `v`, ``(3,)`` float64."""
    a = np.array(v, float)
    return a / np.linalg.norm(a)


def polar(degrees: float, azimuth: float = 25.0) -> Array:
    """The unit vector at `degrees` from +z, ``(3,)``; an azimuth that is no symmetry of any frame."""
    theta, phi = np.radians(degrees), np.radians(azimuth)
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def columns(v: Array, count: int = 1) -> Array:
    """The vector `v` repeated, C-contiguous ``(3, count)`` float32."""
    return np.ascontiguousarray(np.repeat(np.asarray(v, np.float32).reshape(3, 1), count, axis=1))


# Statistics ---------------------------------------------------------------------------------------------------------


def chi2_p(observed: Array, expected: Array) -> float:
    """p-value of counts against their expectations; cells that expect fewer than 5 are pooled into one."""
    observed, expected = np.ravel(observed).astype(float), np.ravel(expected).astype(float)
    order = np.argsort(expected)
    observed, expected = observed[order], expected[order]
    pooled = int(np.searchsorted(expected, 5))
    if pooled:
        while expected[:pooled].sum() < 5:
            pooled += 1
        observed = np.append(observed[pooled:], observed[:pooled].sum())
        expected = np.append(expected[pooled:], expected[:pooled].sum())
    assert len(expected) > 1, "no cells are left: the test would say nothing"
    statistic = ((observed - expected) ** 2 / expected).sum()
    return float(scipy.stats.chi2.sf(statistic, len(expected) - 1))


def angles(w: Array, axis: Array) -> tuple[Array, Array]:
    """Angle from `axis` ``(3,)`` and azimuth about it in [0, 2 pi) of the directions `w` ``(3, N)``, float64."""
    s, t = tangents(axis)
    x, y, z = s @ w.astype(float), t @ w.astype(float), axis @ w.astype(float)
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x) % (2 * np.pi)


def tangents(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that complete `axis` ``(3,)`` to a right-handed frame; x and y for the z axis."""
    s = unit(*np.cross((0.0, 1.0, 0.0) if abs(axis[1]) < 0.9 else (0.0, 0.0, 1.0), axis))
    return s, np.cross(axis, s)


def sphere_nodes(axis: Array, theta: Array, phi: Array, per_cell: int) -> tuple[Array, Array]:
    """Midpoint nodes of the cells between the edges `theta` and `phi` about `axis`, and their solid angles.

    Directions ``(3, M)`` float32 and weights ``(M,)``, M = cells * per_cell**2, the nodes of a cell in a row. Weights
    are exact differences of cosines, so that they add up to the sphere's solid angle.
    """
    fine = [np.interp(np.arange((len(e) - 1) * per_cell + 1) / per_cell, np.arange(len(e)), e) for e in (theta, phi)]
    mid = [(e[1:] + e[:-1]) / 2 for e in fine]
    # cos a - cos b without cancellation for narrow rings
    ring = 2 * np.sin(mid[0]) * np.sin(np.diff(fine[0]) / 2)
    shape = (len(theta) - 1, per_cell, len(phi) - 1, per_cell)
    weights = np.outer(ring, np.diff(fine[1])).reshape(shape).swapaxes(1, 2).reshape(-1)
    t, p = (a.reshape(shape).swapaxes(1, 2).reshape(-1) for a in np.meshgrid(*mid, indexing="ij"))
    x, y = tangents(axis)
    w = np.outer(x, np.sin(t) * np.cos(p)) + np.outer(y, np.sin(t) * np.sin(p)) + np.outer(axis, np.cos(t))
    return w.astype(np.float32), weights


def sphere_rule(
    axis: Array = (0.0, 0.0, 1.0), rings: int = 512, sectors: int = 256, power: float = 1.0
) -> tuple[Array, Array]:
    """Midpoint rule over the sphere; ``power > 1`` puts more rings near `axis`, where a narrow lobe lies."""
    theta = np.pi * np.linspace(0, 1, rings + 1) ** power
    return sphere_nodes(np.asarray(axis, float), theta, np.linspace(0, 2 * np.pi, sectors + 1), 1)


def chi2_directions(
    w: Array,
    pdf: Callable[[Array], Array],
    axis: Array,
    theta: Array | None = None,
    phi: Array | None = None,
    accepted: Array | None = None,
    per_cell: int = 24,
) -> float:
    """p-value of the directions `w` ``(3, N)`` against their density `pdf`.

    Cells are rings about `axis` cut into sectors. The rings are given, or are quantiles of the first eighth of the
    directions, which are then left out of the test. Directions that are not `accepted` ``(N,)`` are a cell of their
    own, which expects what the density lacks to 1: so the test also compares the density's integral with the accepted
    share.
    """
    axis = np.asarray(axis, float)
    a, b = angles(w, axis)
    ok = np.ones(len(a), bool) if accepted is None else accepted
    if theta is None:
        learn = len(a) // 8
        inner = np.quantile(a[:learn][ok[:learn]], np.linspace(0, 1, 17)[1:-1])
        # a narrow lobe falls off over many magnitudes in the outermost ring: cut it further for the quadrature
        outer = np.geomspace(max(inner[-1], 1e-6), np.pi, 17)
        theta = np.unique(np.concatenate([[0.0], inner, outer]))
        a, b, ok = a[learn:], b[learn:], ok[learn:]
    if phi is None:
        phi = np.linspace(0, 2 * np.pi, 13)
    observed = np.histogram2d(a[ok], b[ok], [theta, phi])[0].reshape(-1)
    nodes, weights = sphere_nodes(axis, theta, phi, per_cell)
    mass = (pdf(nodes).astype(float) * weights).reshape(len(observed), -1).sum(axis=1)
    lacking = max(1 - mass.sum(), 0)
    return chi2_p(np.append(observed, (~ok).sum()), np.append(mass, lacking) * len(a))


def z_score(a: Array, b: Array | float) -> float:
    """Difference of the means of two independent samples (or of a sample and a number) over its standard error."""
    a = np.asarray(a, float)
    error2, other = a.var(ddof=1) / len(a), b
    if np.ndim(b):
        b = np.asarray(b, float)
        error2, other = error2 + b.var(ddof=1) / len(b), b.mean()
    return float((a.mean() - other) / np.sqrt(error2))


# Surfaces and scenes ------------------------------------------------------------------------------------------------


def surface(
    material: Material, wo: Array, count: int = 1, n: Array = (0, 0, 1), dpdu: Array = (1, 0, 0)
) -> ShadingPoints:
    """`count` points at the origin with `material`, all seen from `wo`; lobes bound as a scene binds them."""
    group = box_scene(material).plan.groups[0]
    normal, wo_ = columns(n, count), columns(wo, count)
    return ShadingPoints(
        p=np.zeros((3, count), np.float32),
        ng=normal,
        n=normal,
        wo=wo_,
        cos_o=(normal * wo_).sum(axis=0),
        outside=np.ones(count, bool),
        dpdu=columns(dpdu, count),
        epsilon=np.float32(0),
        reflection=group.reflection,
        transmission=group.transmission,
        delta=group.delta,
    )


FLOOR = quad((-4, -4, 0), (8, 0, 0), (0, 8, 0))
"""A square floor, 8 on a side, at z = 0."""


def box_scene(
    material: Material | None = None,
    lights: tuple[Light, ...] | None = None,
    extra: tuple[Part, ...] = (),
    resolution: tuple[int, int] = (16, 16),
    eye: tuple[float, float, float] = (0.0, -3.0, 2.0),
    target: tuple[float, float, float] = (0.0, 0.0, 0.0),
    fov: float = 40.0,
) -> Scene:
    """A floor under `lights` (default: a quad above it), and what is `extra`."""
    if lights is None:
        lights = (QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (5, 4, 3)),)
    camera = Camera.look_at(eye, target, fov=fov, resolution=resolution)
    return Scene(camera, (Part(FLOOR, material or matte(0.6)), *extra), lights)


def pickled(value: Any) -> Any:
    """`value` after a trip through pickle."""
    import pickle

    return pickle.loads(pickle.dumps(value))


def pixel_shares(w: Array | float) -> Array:
    """Shares of both techniques, ``(2, P)`` from `w` of the first, ``(P,)``; ``(2, 1)`` from a number."""
    first = np.atleast_1d(np.float32(w))
    return np.stack([first, 1 - first])


def tile_of(
    scene: Scene,
    seed: int = 0,
    spp: int = 16,
    w: float = 0.5,
    sampler: str = "independent",
    beta: float | None = None,
    **settings: object,
) -> tuple[Array, Counter[str]]:
    """Pixel means ``(H, W, 3)`` of one tile that is the whole image, and its rays; `beta` of a control variate."""
    width, height = scene.camera.resolution
    control = None if beta is None else np.full((3, width * height), beta, np.float32)
    shares, settings = pixel_shares(w), Settings(sampler=sampler, **settings)
    tile = Tile(seed, 0, 0, (0, height), (0, width), spp, shares, settings, control=control)
    rendered = render_tile(scene, tile)
    return rendered.moments.mean, rendered.rays


def means(scene: Scene, seeds: range, spp: int = 8, **options: object) -> Array:
    """Mean radiance of the image for each seed, ``(seeds,)``."""
    return np.array([tile_of(scene, seed, spp, **options)[0].mean() for seed in seeds])
