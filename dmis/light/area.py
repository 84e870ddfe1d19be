"""Area lights: surfaces that emit on one side, along their normal, as in pbrt.

Their pdf is positive on both sides, since sampling does not know which side the receiver is on. Lights made
of triangles are in `dmis.light.mesh_light`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from dmis.base.validate import positive
from dmis.base.vectors import Array, dot, frame
from dmis.geometry import shapes, transforms
from dmis.geometry.mesh import Mesh
from dmis.light.light import AreaLight
from dmis.light.light_sample import (
    ANY_POINT,
    LightSample,
    Rgb,
    direction,
    flat_light_hit,
    flat_light_sample,
    intersect_plane,
    point,
    sphere_light_hit,
    sphere_light_sample,
)
from dmis.light.pieces import DISK, PARALLELOGRAM, SPHERE, Pieces
from dmis.samplers.warp import square_to_disk


@dataclass(frozen=True, eq=False)
class DiskLight(AreaLight):
    """A disk that emits along `normal`; sampled uniformly in area, density ``d^2 / (area |cos|)``.

    Parameters
    ----------
    centre
        Three numbers, in units of the scene.
    normal
        Where the bright side looks; of any length but 0.
    radius
        Positive, in units of the scene.
    radiance
        Emitted in every direction of the bright side, linear RGB, not negative.
    """

    centre: Rgb
    normal: Rgb
    radius: float
    radiance: Rgb
    positions: ClassVar[tuple[str, ...]] = ("centre",)
    lengths: ClassVar[tuple[str, ...]] = ("radius",)

    def __post_init__(self) -> None:
        positive("radius", self.radius)
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array, Array, Array, Array]:
        normal = direction("normal", self.normal)
        s, t = (a * np.float32(self.radius) for a in frame(normal))
        return point("centre", self.centre), normal, s, t, self.emission(ANY_POINT)

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` to points on the disk, `u` ``(2, N)``."""
        centre, normal, s, t, radiance = self._data
        x, y = square_to_disk(u)
        return flat_light_sample(centre - p + s * x + t * y, normal, np.pi * self.radius**2, radiance)

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return what unit directions `wi` ``(3, N)`` from `p` see of the disk."""
        centre, normal, _, _, radiance = self._data
        distance, cos, q = intersect_plane(p - centre, wi, normal)
        inside = (distance > 0) & (dot(q, q) < np.float32(self.radius**2))
        return flat_light_hit(wi, distance, cos, inside, np.pi * self.radius**2, radiance)

    def pieces(self) -> Pieces:
        centre, normal, s, t, radiance = self._data
        return Pieces.of(DISK, np.concatenate([centre, s, t, normal]), np.pi * self.radius**2, radiance)

    def mesh(self) -> Mesh:
        normal = np.asarray(self.normal, float)[:, None] / np.linalg.norm(self.normal)
        matrix = transforms.translate(self.centre)
        matrix[:3, :3] = np.hstack([*frame(normal), normal])
        return shapes.circular(radius=self.radius).mesh().transformed(matrix)


@dataclass(frozen=True, eq=False)
class QuadLight(AreaLight):
    """A parallelogram ``corner + a edge_u + b edge_v`` that emits along ``edge_u x edge_v``; sampled uniformly in area.

    Parameters
    ----------
    corner, edge_u, edge_v
        Three numbers each, in units of the scene; the edges must not be parallel.
    radiance
        Emitted in every direction of the bright side, linear RGB, not negative.
    """

    corner: Rgb
    edge_u: Rgb
    edge_v: Rgb
    radiance: Rgb
    positions: ClassVar[tuple[str, ...]] = ("corner",)
    lengths: ClassVar[tuple[str, ...]] = ("edge_u", "edge_v")

    def __post_init__(self) -> None:
        if self._data[4] == 0:
            raise ValueError(f"edge_u and edge_v must not be parallel; got {self.edge_u} and {self.edge_v}")

    @cached_property
    def _data(self) -> tuple[Array, Array, Array, Array, float, Array]:
        u, v = np.asarray(self.edge_u, float), np.asarray(self.edge_v, float)
        cross = np.cross(u, v)
        area = float(np.linalg.norm(cross))
        normal = (cross / max(area, 1e-300)).astype(np.float32)[:, None]
        edge_u, edge_v = (point("edge", edge) for edge in (self.edge_u, self.edge_v))
        return point("corner", self.corner), edge_u, edge_v, normal, area, self.emission(ANY_POINT)

    @cached_property
    def _dual(self) -> tuple[Array, Array]:
        """Vectors whose dot products with a point of the plane are its coordinates along the edges."""
        edges = np.array([self.edge_u, self.edge_v], float)
        a, b = np.linalg.solve(edges @ edges.T, edges).astype(np.float32)
        return a[:, None], b[:, None]

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` to points on the quad, `u` ``(2, N)``."""
        corner, edge_u, edge_v, normal, area, radiance = self._data
        return flat_light_sample(corner - p + edge_u * u[0] + edge_v * u[1], normal, area, radiance)

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return what unit directions `wi` ``(3, N)`` from `p` see of the quad."""
        corner, _, _, normal, area, radiance = self._data
        distance, cos, q = intersect_plane(p - corner, wi, normal)
        a, b = dot(self._dual[0], q), dot(self._dual[1], q)
        inside = (distance > 0) & (a >= 0) & (a <= 1) & (b >= 0) & (b <= 1)
        return flat_light_hit(wi, distance, cos, inside, area, radiance)

    def pieces(self) -> Pieces:
        corner, edge_u, edge_v, normal, area, radiance = self._data
        return Pieces.of(PARALLELOGRAM, np.concatenate([corner, edge_u, edge_v, normal]), area, radiance)

    def mesh(self) -> Mesh:
        return shapes.quad(self.corner, self.edge_u, self.edge_v)


@dataclass(frozen=True, eq=False)
class SphereLight(AreaLight):
    """A sphere that emits outwards; sampled uniformly in the cone it subtends. Receivers inside it see nothing.

    Parameters
    ----------
    centre
        Three numbers, in units of the scene.
    radius
        Positive, in units of the scene.
    radiance
        Emitted in every direction of the bright side, linear RGB, not negative.
    """

    centre: Rgb
    radius: float
    radiance: Rgb
    positions: ClassVar[tuple[str, ...]] = ("centre",)
    lengths: ClassVar[tuple[str, ...]] = ("radius",)

    def __post_init__(self) -> None:
        positive("radius", self.radius)
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        return point("centre", self.centre), self.emission(ANY_POINT)

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` in the cone of the sphere, `u` ``(2, N)``."""
        centre, radiance = self._data
        return sphere_light_sample(centre - p, np.float32(self.radius**2), u, radiance)

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return what unit directions `wi` ``(3, N)`` from `p` see of the sphere."""
        centre, radiance = self._data
        return sphere_light_hit(wi, centre - p, np.float32(self.radius**2), radiance)

    def mesh(self) -> Mesh:
        return shapes.sphere(self.radius).transformed(transforms.translate(self.centre))

    def pieces(self) -> Pieces:
        centre, radiance = self._data
        edges = np.eye(3).reshape(9, 1) * self.radius
        return Pieces.of(SPHERE, np.concatenate([centre, edges]), np.pi * self.radius**2, radiance)
