"""Meshes of analytic shapes: pbrt's quadrics (sphere, cylinder, disk) and parallelograms.

Parameters have pbrt's names and meaning, so that a number in a scene file is the same number here. Angles are degrees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dmis.base.validate import direction, positive, vector, whole
from dmis.base.vectors import Floats
from dmis.geometry.mesh import Mesh, weld


@dataclass(frozen=True, eq=False)
class Quadric:
    """A quadric of pbrt in object space: a map from (u, v) in [0, 1]^2, which a grid of lines tessellates.

    Attributes
    ----------
    radius
        Radius of the circle about the z axis, or of the sphere.
    phimax
        Degrees that u spans about the z axis.
    at
        Function of azimuths in radians and v, (A, B) each; it returns points (A, B, 3), and normals (A, B, 3) or None
        for those of the triangles.
    start, arc
        Of a sphere: the polar angle at v = 0, and the decrease of the polar angle up to v = 1, in radians; else 0.
    """

    radius: float
    phimax: float
    at: Callable[[Floats, Floats], tuple[Floats, Floats | None]]
    start: float = 0.0
    arc: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.phimax <= 360:
            raise ValueError(f"phimax must be above 0 and at most 360 degrees; got {self.phimax}")

    def lines(self, segments: int) -> tuple[Floats, Floats]:
        """Return lines u (A,) and v (B,) of an even grid with `segments` quads around a full circle."""
        columns = int(np.ceil(whole("segments", segments, 3) * self.phimax / 360))
        return np.linspace(0, 1, columns + 1), np.linspace(0, 1, max(1, segments // 2 if self.arc else 1) + 1)

    def mesh(self, segments: int = 256) -> Mesh:
        """Return its mesh with `segments` quads around a full circle, evenly spaced; uv are (u, v)."""
        return self.mesh_between(*self.lines(segments))

    def mesh_between(self, u: Floats, v: Floats) -> Mesh:
        """Return the mesh of the triangles between lines u (A,) and v (B,), both from 0 to 1; uv are (u, v)."""
        uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=2)
        return grid(*self.at(np.radians(self.phimax) * uv[..., 0], uv[..., 1]), uv)


def spherical(radius: float = 1, zmin: float | None = None, zmax: float | None = None, phimax: float = 360) -> Quadric:
    """Return a sphere about the origin, from height `zmin` to `zmax`, up to azimuth `phimax`; normals out.

    The heights default to the poles and are clamped to them. uv are pbrt's: azimuth, and polar angle from `zmin` to
    `zmax`.
    """
    low = -positive("radius", radius) if zmin is None else zmin
    high = radius if zmax is None else zmax
    bottom, top = (float(np.arccos(np.clip(z / radius, -1, 1))) for z in (low, high))
    if not bottom > top:
        raise ValueError(f"zmin must be below zmax on a sphere of radius {radius}, else it is empty; got {low}, {high}")

    def at(phi: Floats, v: Floats) -> tuple[Floats, Floats]:
        theta = bottom + v * (top - bottom)
        normal = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=2)
        return radius * normal, normal

    return Quadric(radius, phimax, at, bottom, bottom - top)


def cylindrical(radius: float = 1, zmin: float = -1, zmax: float = 1, phimax: float = 360) -> Quadric:
    """Return an open cylinder about z, up to azimuth `phimax`; normals out; uv are azimuth and height."""
    positive("radius", radius)
    if not zmin < zmax:
        raise ValueError(f"zmin must be below zmax, else the cylinder is empty; got {zmin}, {zmax}")

    def at(phi: Floats, v: Floats) -> tuple[Floats, Floats]:
        normal = np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=2)
        return radius * normal + [0, 0, zmin] + [0, 0, zmax - zmin] * v[..., None], normal

    return Quadric(radius, phimax, at)


def circular(height: float = 0, radius: float = 1, innerradius: float = 0, phimax: float = 360) -> Quadric:
    """Return a disk or ring at z = `height`, up to azimuth `phimax`; normal +z.

    uv are pbrt's: azimuth, and radius from the rim to the centre.
    """
    if not 0 <= innerradius < positive("radius", radius):
        raise ValueError(f"innerradius must be at least 0 and less than the radius {radius}; got {innerradius}")

    def at(phi: Floats, v: Floats) -> tuple[Floats, None]:
        r = radius + v * (innerradius - radius)
        return np.stack([r * np.cos(phi), r * np.sin(phi), 0 * r + height], axis=2), None

    return Quadric(radius, phimax, at)


def sphere(radius: float = 1, segments: int = 256) -> Mesh:
    """Return the mesh of a whole sphere about the origin, with `segments` quads around a full circle; normals out."""
    return spherical(radius).mesh(segments)


def quad(corner: npt.ArrayLike, u: npt.ArrayLike, v: npt.ArrayLike) -> Mesh:
    """Return the mesh of a parallelogram with sides `u`, `v` (3,) from `corner` (3,).

    The normal is u x v; uv are (0, 0) at the corner and (1, 1) opposite to it.
    """
    corner, u, v = vector("corner", corner), vector("u", u), vector("v", v)
    direction("u x v", np.cross(u, v))
    uv = np.array([[[0.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [1.0, 1.0]]])
    return grid(corner + uv[..., :1] * u + uv[..., 1:] * v, None, uv)


def grid(points: Floats, normals: Floats | None, uv: Floats) -> Mesh:
    """Triangulate a grid of points (A, B, 3), or P of them (P, A, B, 3); outside is the first axis times the second.

    Points equal up to rounding become equal, so that no ray passes between triangles; triangles that lose their area
    are dropped.
    """
    index = np.arange(points.size // 3).reshape(-1, *uv.shape[:2])
    a, b, c, d = index[:, :-1, :-1], index[:, 1:, :-1], index[:, 1:, 1:], index[:, :-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=3).reshape(-1, 3)
    points = points.reshape(-1, 3)
    same = weld(points)
    corner = same[faces]
    faces = faces[(corner != np.roll(corner, 1, axis=1)).all(axis=1)]
    normals = None if normals is None else normals.reshape(-1, 3)
    return Mesh(points[same], faces, normals, np.tile(uv.reshape(-1, 2), (len(index), 1)))
