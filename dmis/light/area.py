"""Area lights: surfaces that emit on one side, along their normal, as in pbrt.

Their pdf is positive on both sides, since sampling does not know which side the receiver is on. Lights that overlap in
one plane emit independently of each other, see `dmis.light.coincident`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from dmis.base.selection import Index
from dmis.base.validate import positive
from dmis.base.vectors import TINY, Array, dot, frame
from dmis.geometry import shapes, transforms
from dmis.geometry.mesh import Mesh
from dmis.intersect import Intersector
from dmis.light.coincident import Coincident, find_coincident
from dmis.light.light import AreaLight, moved, scaled
from dmis.light.light_sample import LightSample, Rgb, direction, point
from dmis.samplers.warp import cone_pdf, square_to_cone, square_to_disk, square_to_triangle, to_world

_MIN_FAR_END = np.float32(1e-12)  # of directions that lead away from a sphere, whose distances are not used
_ANY_POINT = np.zeros((3, 1), np.float32)
"""A point: the radiance of these lights is the same at all of theirs."""


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

    Raises
    ------
    ValueError
        If the radius is not positive, the normal is zero, or the radiance is negative or not finite.
    """

    centre: Rgb
    normal: Rgb
    radius: float
    radiance: Rgb

    def __post_init__(self) -> None:
        positive("radius", self.radius)
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array, Array, Array, Array]:
        normal = direction("normal", self.normal)
        s, t = (a * np.float32(self.radius) for a in frame(normal))
        return point("centre", self.centre), normal, s, t, self.emission(_ANY_POINT)

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` to points on the disk, `u` ``(2, N)``."""
        centre, normal, s, t, radiance = self._data
        x, y = square_to_disk(u)
        return _light_sample_towards(centre - p + s * x + t * y, normal, np.pi * self.radius**2, radiance)

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return what unit directions `wi` ``(3, N)`` from `p` see of the disk."""
        centre, normal, _, _, radiance = self._data
        distance, cos, q = _intersect_plane(p - centre, wi, normal)
        inside = (distance > 0) & (dot(q, q) < np.float32(self.radius**2))
        return _light_sample_of_hit(wi, distance, cos, inside, np.pi * self.radius**2, radiance)

    def extent(self) -> float:
        """Return the radius."""
        return float(self.radius)

    def rescaled(self, origin: Array, length: float, gain: float) -> Self:
        """Return the light in other units, see `dmis.light.light.Light.rescaled`."""
        return replace(
            self,
            centre=moved(self.centre, origin, length),
            radius=scaled(self.radius, length),
            radiance=scaled(self.radiance, gain),
        )

    def mesh(self) -> Mesh:
        """Return the visible surface."""
        normal = np.asarray(self.normal, float) / np.linalg.norm(self.normal)
        matrix = transforms.translate(self.centre)
        s, t = (axis[:, 0].astype(float) for axis in frame(normal[:, None]))
        matrix[:3, :3] = np.stack([s, t if np.cross(s, t) @ normal > 0 else -t, normal], axis=1)
        return shapes.disk(radius=self.radius).transformed(matrix)


@dataclass(frozen=True, eq=False)
class QuadLight(AreaLight):
    """A parallelogram ``corner + a edge_u + b edge_v`` that emits along ``edge_u x edge_v``; sampled uniformly in area.

    Parameters
    ----------
    corner, edge_u, edge_v
        Three numbers each, in units of the scene.
    radiance
        Emitted in every direction of the bright side, linear RGB, not negative.

    Raises
    ------
    ValueError
        If the edges are parallel, or the radiance is negative or not finite.
    """

    corner: Rgb
    edge_u: Rgb
    edge_v: Rgb
    radiance: Rgb

    def __post_init__(self) -> None:
        if self._data[4] == 0:
            raise ValueError(f"edge_u and edge_v must not be parallel; got {self.edge_u} and {self.edge_v}")

    @cached_property
    def _data(self) -> tuple[Array, Array, Array, Array, float, Array]:
        u, v = np.asarray(self.edge_u, float), np.asarray(self.edge_v, float)
        cross = np.cross(u, v)
        area = float(np.linalg.norm(cross))
        normal = (cross / max(area, 1e-300)).astype(np.float32)[:, None]
        corner, edges = point("corner", self.corner), [point("edge", e) for e in (self.edge_u, self.edge_v)]
        return corner, edges[0], edges[1], normal, area, self.emission(_ANY_POINT)

    @cached_property
    def _dual(self) -> tuple[Array, Array]:
        """Vectors whose dot products with a point of the plane are its coordinates along the edges."""
        edges = np.array([self.edge_u, self.edge_v], float)
        a, b = np.linalg.solve(edges @ edges.T, edges).astype(np.float32)
        return a[:, None], b[:, None]

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` to points on the quad, `u` ``(2, N)``."""
        corner, edge_u, edge_v, normal, area, radiance = self._data
        return _light_sample_towards(corner - p + edge_u * u[0] + edge_v * u[1], normal, area, radiance)

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return what unit directions `wi` ``(3, N)`` from `p` see of the quad."""
        corner, _, _, normal, area, radiance = self._data
        distance, cos, q = _intersect_plane(p - corner, wi, normal)
        a, b = dot(self._dual[0], q), dot(self._dual[1], q)
        inside = (distance > 0) & (a >= 0) & (a <= 1) & (b >= 0) & (b <= 1)
        return _light_sample_of_hit(wi, distance, cos, inside, area, radiance)

    def extent(self) -> float:
        """Return the root of the area."""
        return float(np.sqrt(np.linalg.norm(np.cross(self.edge_u, self.edge_v))))

    def rescaled(self, origin: Array, length: float, gain: float) -> Self:
        """Return the light in other units, see `dmis.light.light.Light.rescaled`."""
        return replace(
            self,
            corner=moved(self.corner, origin, length),
            edge_u=scaled(self.edge_u, length),
            edge_v=scaled(self.edge_v, length),
            radiance=scaled(self.radiance, gain),
        )

    def mesh(self) -> Mesh:
        """Return the visible surface."""
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

    Raises
    ------
    ValueError
        If the radius is not positive, or the radiance is negative or not finite.
    """

    centre: Rgb
    radius: float
    radiance: Rgb

    def __post_init__(self) -> None:
        positive("radius", self.radius)
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        return point("centre", self.centre), self.emission(_ANY_POINT)

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` in the cone of the sphere, `u` ``(2, N)``."""
        to, distance2, one_minus_cos, outside = self._cone(p)
        axis = to * (1 / np.sqrt(distance2))
        wi = to_world(square_to_cone(u, one_minus_cos), axis)
        return self._light_sample(wi, to, distance2, one_minus_cos, outside, outside)

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return what unit directions `wi` ``(3, N)`` from `p` see of the sphere."""
        to, distance2, one_minus_cos, outside = self._cone(p)
        along = dot(to, wi)
        across = to - wi * along  # |to|^2 - along^2 would cancel for a far light
        inside = outside & (along > 0) & (dot(across, across) < np.float32(self.radius**2))
        return self._light_sample(wi, to, distance2, one_minus_cos, inside, outside)

    def extent(self) -> float:
        """Return the radius."""
        return float(self.radius)

    def rescaled(self, origin: Array, length: float, gain: float) -> Self:
        """Return the light in other units, see `dmis.light.light.Light.rescaled`."""
        return replace(
            self,
            centre=moved(self.centre, origin, length),
            radius=scaled(self.radius, length),
            radiance=scaled(self.radiance, gain),
        )

    def mesh(self) -> Mesh:
        """Return the visible surface."""
        return shapes.sphere(self.radius).transformed(transforms.translate(self.centre))

    def _cone(self, p: Array) -> tuple[Array, Array, Array, Array]:
        to = self._data[0] - p
        distance2 = np.maximum(dot(to, to), TINY)
        sin2 = np.minimum(np.float32(self.radius**2) / distance2, 1)  # 1: the receiver is inside
        one_minus_cos = sin2 / (1 + np.sqrt(1 - sin2))
        return to, distance2, one_minus_cos, sin2 < 1

    def _light_sample(
        self, wi: Array, to: Array, distance2: Array, cone: Array, is_hit: Array, outside: Array
    ) -> LightSample:
        along = dot(to, wi)
        across = to - wi * along
        radius2 = np.float32(self.radius**2)
        far = along + np.sqrt(np.maximum(radius2 - dot(across, across), 0))
        # the near end is |to|^2 - radius^2 over the far one; their difference would cancel for a large sphere
        near = np.maximum(distance2 - radius2, 0) / np.maximum(far, _MIN_FAR_END)
        return LightSample(wi, near, self._data[1], cone_pdf(cone) * is_hit, is_hit)


@dataclass(frozen=True, eq=False)
class MeshLight(AreaLight):
    """Triangles that emit along their winding's normal; sampled uniformly in area.

    Directions are tested against the light's own triangles by an Embree scene of their own. Where triangles overlap in
    one plane, those that face the receiver emit towards it, and their radiances add up: triangles that are listed a
    second time with the opposite winding make a lamp that emits on both sides, with the same winding one that is twice
    as bright.

    Parameters
    ----------
    vertices
        ``(V, 3)``, in units of the scene.
    faces
        ``(F, 3)`` vertex indices.
    radiance
        Emitted in every direction of the bright side, linear RGB, not negative.

    Raises
    ------
    ValueError
        If vertices or faces are none of a `dmis.geometry.mesh.Mesh`, no triangle has an area, or the radiance is
        negative or not finite.
    """

    vertices: Array
    faces: Array
    radiance: Rgb

    def __post_init__(self) -> None:
        if not self._data[2] > 0:
            raise ValueError("a mesh light must have a positive area; all its triangles are degenerate")

    @cached_property
    def _data(self) -> tuple[Array, Array, float, Array]:
        """Corner, two edges and unit normal of each triangle ``(12, F)``; cumulative shares of area; area; radiance."""
        mesh = Mesh(self.vertices, self.faces)
        triangles = mesh.vertices[mesh.faces]
        corner, edge_u = triangles[:, 0], triangles[:, 1] - triangles[:, 0]
        edge_v = triangles[:, 2] - triangles[:, 0]
        cross = np.cross(edge_u, edge_v)
        twice = np.linalg.norm(cross, axis=1)
        normal = cross / np.maximum(twice, 1e-300)[:, None]
        rows = np.concatenate([corner, edge_u, edge_v, normal], axis=1).T.astype(np.float32)
        cdf = np.cumsum(twice)
        area = float(cdf[-1] / 2)
        return rows, cdf / max(cdf[-1], 1e-300), area, self.emission(_ANY_POINT)

    @cached_property
    def flat(self) -> bool:
        """Whether all triangles are in one plane, up to rounding, so that none can be in front of another."""
        rows, _, area, _ = self._data
        normal, corner = rows[9:, 0], rows[:3]
        away = normal @ (corner - corner[:, :1]), normal @ rows[3:6], normal @ rows[6:9]
        return bool(np.abs(away).max() <= 1e-5 * np.sqrt(area))

    @cached_property
    def overlaps(self) -> Coincident | None:
        """Triangles that overlap others in one plane, see `dmis.light.coincident`; None: there are none."""
        mesh = Mesh(self.vertices, self.faces)
        return find_coincident(mesh.vertices[mesh.faces])

    @property
    def doubled_triangles(self) -> tuple[int, int] | None:
        """The first two triangles that overlap in one plane and face the same side; None: there are none."""
        same = np.flatnonzero([] if self.overlaps is None else self.overlaps.same)
        if self.overlaps is None or not len(same):
            return None
        return int(self.overlaps.triangle[same[0]]), int(self.overlaps.other[same[0]])

    @cached_property
    def _intersector(self) -> Intersector:
        return Intersector(self.vertices, self.faces)

    def __getstate__(self) -> dict[str, object]:
        return {k: v for k, v in self.__dict__.items() if k != "_intersector"}

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` to points on the triangles, `u` ``(2, N)``."""
        rows, cdf, area, radiance = self._data
        index = np.minimum(np.searchsorted(cdf, u[0], side="right"), len(cdf) - 1)
        low = np.where(index > 0, cdf.take(index - 1), 0)
        within = ((u[0] - low) / np.maximum(cdf.take(index) - low, 1e-30)).astype(np.float32)
        a, b = square_to_triangle(np.stack([np.clip(within, 0, 1), u[1]]))
        chosen = rows.take(index, axis=1)
        light_sample = _light_sample_towards(
            chosen[:3] - p + chosen[3:6] * a + chosen[6:9] * b, chosen[9:], area, radiance
        )
        if self.overlaps is not None:
            light_sample = _add_up(light_sample, self.overlaps, index, a, b)
        if not self.flat:  # what other triangles hide `hit` does not see either: densities are those of the nearest
            facing = np.flatnonzero(light_sample.emits)
            nearest = self._intersector.closest(
                np.broadcast_to(p, light_sample.wi.shape)[:, facing], light_sample.wi[:, facing]
            ).distance
            light_sample.emits[facing] = nearest >= light_sample.distance[facing] * np.float32(1 - 1e-4)
        return light_sample

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return what unit directions `wi` ``(3, N)`` from `p` see of the triangles: the nearest one."""
        rows, _, area, radiance = self._data
        hits = self._intersector.closest(p, wi)
        is_hit = hits.prim >= 0
        chosen = rows.take(np.maximum(hits.prim, 0), axis=1)
        light_sample = _light_sample_of_hit(wi, hits.distance, dot(chosen[9:], wi), is_hit, area, radiance)
        return (
            light_sample if self.overlaps is None else _add_up(light_sample, self.overlaps, hits.prim, hits.u, hits.v)
        )

    def extent(self) -> float:
        """Return the diagonal of the bounds."""
        return float(np.linalg.norm(np.ptp(np.asarray(self.vertices, np.float64), axis=0)))

    def rescaled(self, origin: Array, length: float, gain: float) -> Self:
        """Return the light in other units, see `dmis.light.light.Light.rescaled`."""
        return replace(
            self,
            vertices=moved(self.vertices, origin, length),
            radiance=scaled(self.radiance, gain),
        )

    def mesh(self) -> Mesh:
        """Return the visible surface."""
        return Mesh(self.vertices, self.faces)

    def hides_itself(self) -> bool:
        """Return whether the triangles are not in one plane."""
        return not self.flat


def _add_up(light_sample: LightSample, overlaps: Coincident, prim: Index, u: Array, v: Array) -> LightSample:
    """Return `light_sample` with the light of all triangles at points (u, v) of the triangles `prim` (-1: a miss)."""
    # p_l = m d^2 / (area |cos|) where m triangles overlap, and the radiance is that of the k of them that face p
    point, pair = overlaps.at(prim, u, v)
    facing = light_sample.emits.take(point) == overlaps.same.take(pair)
    size = len(light_sample.emits)
    m = 1 + np.bincount(point, minlength=size).astype(np.float32)
    k = light_sample.emits + np.bincount(point.compress(facing), minlength=size).astype(np.float32)
    return LightSample(light_sample.wi, light_sample.distance, light_sample.radiance * k, light_sample.pdf * m, k > 0)


def _light_sample_towards(to: Array, normal: Array, area: float, radiance: Array) -> LightSample:
    """Return the sample of a flat light along `to`, a point on it minus the receiver; pdf ``d^2 / (area |cos|)``."""
    distance2 = np.maximum(dot(to, to), TINY)
    inverse = 1 / np.sqrt(distance2)
    cos = -dot(normal, to) * inverse
    pdf = distance2 / (np.float32(area) * np.maximum(np.abs(cos), np.float32(1e-12)))
    return LightSample(to * inverse, distance2 * inverse, radiance, pdf, cos > 0)


def _intersect_plane(p: Array, wi: Array, normal: Array) -> tuple[Array, Array, Array]:
    """Return where rays from `p` (relative to the plane) meet a plane: distance, normal . wi, relative point."""
    cos = dot(normal, wi)
    cos = np.copysign(np.maximum(np.abs(cos), np.float32(1e-12)), cos)
    distance = dot(normal, p) / -cos
    return distance, cos, wi * distance + p


def _light_sample_of_hit(
    wi: Array, distance: Array, cos: Array, is_hit: Array, area: float, radiance: Array
) -> LightSample:
    """Return the sample of a flat light that directions hit (or not) at `distance`; `cos` = normal . wi."""
    reach = np.where(is_hit, distance, np.float32(0))  # the square of a miss's distance may overflow
    pdf = reach * reach / (np.float32(area) * np.maximum(np.abs(cos), np.float32(1e-12)))
    return LightSample(wi, distance, radiance, pdf, is_hit & (cos < 0))
