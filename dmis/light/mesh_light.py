"""Area lights made of triangles, which may overlap or hide one another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from dmis.base.selection import Index
from dmis.base.vectors import Array, dot
from dmis.geometry.mesh import Ints, Mesh
from dmis.intersect import Intersector
from dmis.light.coincident import Coincident, find_coincident
from dmis.light.light import AreaLight, moved, scaled
from dmis.light.light_sample import ANY_POINT, LightSample, Rgb, flat_light_hit, flat_light_sample
from dmis.light.triangle_order import compact_order, shortest_edge_last
from dmis.samplers.warp import square_to_triangle


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
        triangles = self._mesh.vertices[self._sampled_faces]
        corner, edge_u = triangles[:, 0], triangles[:, 1] - triangles[:, 0]
        edge_v = triangles[:, 2] - triangles[:, 0]
        cross = np.cross(edge_u, edge_v)
        twice = np.linalg.norm(cross, axis=1)
        normal = cross / np.maximum(twice, 1e-300)[:, None]
        rows = np.concatenate([corner, edge_u, edge_v, normal], axis=1).T.astype(np.float32)
        cdf = np.cumsum(twice)
        area = float(cdf[-1] / 2)
        return rows, cdf / max(cdf[-1], 1e-300), area, self.emission(ANY_POINT)

    @cached_property
    def _mesh(self) -> Mesh:
        return Mesh(self.vertices, self.faces)

    @cached_property
    def _order(self) -> Index:
        """Triangles in the order in which the first number of a sample goes through them."""
        return compact_order(self._mesh.vertices[self._mesh.faces])

    @cached_property
    def _sampled_faces(self) -> Ints:
        """Triangles in `_order`, their shortest edge between vertices 2 and 0.

        The first number of a sample picks the triangle, and what is left of it a place along this edge; the second
        number the distance from it. What is left is the same for all samples of a pixel if triangles are equal and
        points even, so it decides about the shortest way.
        """
        return shortest_edge_last(self._mesh.vertices, self._mesh.faces)[self._order]

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
        return find_coincident(self._mesh.vertices[self._sampled_faces])

    @property
    def doubled_triangles(self) -> tuple[int, int] | None:
        """The first two triangles that overlap in one plane and face the same side; None: there are none."""
        if self.overlaps is None or not self.overlaps.same.any():
            return None
        pairs = np.sort(self._order[np.stack([self.overlaps.triangle, self.overlaps.other])], axis=0)
        first, second = min(pairs.T[self.overlaps.same].tolist())
        return first, second

    @cached_property
    def _intersector(self) -> Intersector:
        return Intersector(self._mesh.vertices, self._sampled_faces)

    def __getstate__(self) -> dict[str, object]:
        return {k: v for k, v in self.__dict__.items() if k != "_intersector"}

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)`` to points on the triangles, `u` ``(2, N)``."""
        rows, cdf, area, radiance = self._data
        index = np.minimum(np.searchsorted(cdf, u[0], side="right"), len(cdf) - 1)
        low = np.where(index > 0, cdf.take(index - 1), 0)
        within = ((u[0] - low) / np.maximum(cdf.take(index) - low, 1e-30)).astype(np.float32)
        a, b = square_to_triangle(np.stack([u[1], np.clip(within, 0, 1)]))
        chosen = rows.take(index, axis=1)
        light_sample = flat_light_sample(chosen[:3] - p + chosen[3:6] * a + chosen[6:9] * b, chosen[9:], area, radiance)
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
        light_sample = flat_light_hit(wi, hits.distance, dot(chosen[9:], wi), is_hit, area, radiance)
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
        return self._mesh

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
