"""Area lights made of triangles, which may hide one another."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from dmis.base.color import LUMINANCE
from dmis.base.vectors import Array, dot
from dmis.brdf.texture import Image, check_values
from dmis.geometry.mesh import Ints, Mesh
from dmis.intersect import Intersector
from dmis.light.coincident import find_overlaps, find_twins
from dmis.light.light import AreaLight
from dmis.light.light_sample import ANY_POINT, LightSample, Rgb, flat_light_hit, flat_light_sample
from dmis.light.pieces import TRIANGLE, Pieces
from dmis.light.triangle_order import compact_order, shortest_edge_last
from dmis.samplers.warp import square_to_triangle

EVEN_SHARE = 0.1
"""Part of the mean luminance of an image of radiance that each triangle is sampled by, whatever its own."""
_INSIDE = np.array([[a + 1, b + 1] for a in range(6) for b in range(6 - a)], np.float32).T / 8
"""Places in a triangle at which an image of radiance is looked up for its mean."""
MIN_GAP = 2e-6
"""Least distance of two triangles that face each other, in largest coordinates: rays begin 10^-6 above surfaces."""


@dataclass(frozen=True, eq=False)
class MeshLight(AreaLight):
    """Triangles that emit along their winding's normal; sampled uniformly in area.

    Directions are tested against the light's own triangles by an Embree scene of their own. A triangle that is listed a
    second time with the opposite winding makes both emit as one of two sides; a copy with the same winding is left out.

    Parameters
    ----------
    vertices
        ``(V, 3)``, in units of the scene.
    faces
        ``(F, 3)`` vertex indices.
    radiance
        Emitted in every direction of the bright side, linear RGB, not negative; or an `Image` of it. Then triangles
        are sampled by area times mean luminance, plus `EVEN_SHARE` of that of all triangles.
    uv
        Coordinates of the vertices in the image, ``(V, 2)``; those of the part whose light this is.

    Raises
    ------
    ValueError
        If vertices or faces are none of a `dmis.geometry.mesh.Mesh`, no triangle has an area, or the radiance is
        negative or not finite, or an image without `uv`; or if two triangles overlap in one plane, in part.
    """

    vertices: Array
    faces: Array
    radiance: Rgb | Image
    uv: Array | None = None
    positions: ClassVar[tuple[str, ...]] = ("vertices",)

    def __post_init__(self) -> None:
        if isinstance(self.radiance, Image):
            check_values("radiance", self.radiance, "finite and not negative", "it is emitted")
            if self.uv is None:
                raise ValueError("uv must be given with an image of radiance, because it says where the image is")
            vars(self)["textured"] = True
        if not np.max(self._data[2]) > 0:
            raise ValueError("a mesh light must have a positive area; all its triangles are degenerate")
        self._refuse_overlaps()

    def _refuse_overlaps(self) -> None:
        """Raise a ValueError if two triangles overlap in part."""
        faces = self._sampled[0]
        triangles = self._mesh.vertices[faces]
        centre = triangles.mean(axis=(0, 1))  # float32 has more digits about it
        caster = Intersector(self._mesh.vertices - centre, faces)
        reach = MIN_GAP * np.abs(triangles - centre).max()
        first, second = find_overlaps(caster, triangles - centre, reach)
        overlap = first != second
        if overlap.any():
            places = (str(triangles[index[overlap][0]].mean(axis=0).tolist()) for index in (first, second))
            raise ValueError(
                f"triangles of a mesh light must not overlap in part, because a ray meets only one of them; got two in "
                f"one plane, about {' and '.join(places)}"
            )

    @cached_property
    def _data(self) -> tuple[Array, Array, Any, Array]:
        """Corner, two edges and unit normal of each triangle ``(12, F)``; cumulative shares of samples; the area, of an
        image that of each triangle over its share, ``(F,)``; radiance.
        """
        triangles = self._mesh.vertices[self._sampled[0]]
        corner, edge_u = triangles[:, 0], triangles[:, 1] - triangles[:, 0]
        edge_v = triangles[:, 2] - triangles[:, 0]
        cross = np.cross(edge_u, edge_v)
        twice = np.linalg.norm(cross, axis=1)
        normal = cross / np.maximum(twice, 1e-300)[:, None]
        rows = np.concatenate([corner, edge_u, edge_v, normal], axis=1).T.astype(np.float32)
        if self.textured:
            mean = self._emitted(np.arange(len(twice))[:, None], *_INSIDE).mean(axis=2)
            luminance = np.tensordot(LUMINANCE, mean, 1)
            weight = twice * (luminance + EVEN_SHARE * max(np.average(luminance, weights=twice), 1e-30))
            share = weight / weight.sum()
            return rows, np.cumsum(share), (twice / 2 / np.maximum(share, 1e-300)).astype(np.float32), np.zeros((3, 1))
        cdf = np.cumsum(twice)
        area = float(cdf[-1] / 2)
        return rows, cdf / max(cdf[-1], 1e-300), area, self.emission(ANY_POINT)

    def _emitted(self, index: Array, a: Array, b: Array) -> Array:
        """Return the radiance ``(3, ...)`` at coordinates along the edges of the triangles `index`."""
        if not isinstance(self.radiance, Image):
            return self._data[3]
        rows = self._uv_rows[:, index]
        uv = rows[:2] + rows[2:4] * a + rows[4:] * b
        values = self.radiance(uv.reshape(2, -1))  # one row, if the image is grey
        return np.broadcast_to(values, (3, values.shape[1])).reshape(3, *uv.shape[1:])

    @cached_property
    def _uv_rows(self) -> Array:
        """Texture coordinates of the first corner of each triangle and the differences along its edges, ``(6, F)``."""
        corners = np.asarray(self._mesh.uv, np.float32)[self._sampled[0]]
        return np.concatenate([corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1).T

    @cached_property
    def _mesh(self) -> Mesh:
        return Mesh(self.vertices, self.faces, uv=self.uv)

    @cached_property
    def _sampled(self) -> tuple[Ints, Array]:
        """Triangles in the order in which the first number of a sample goes through them; whether both sides emit.

        The first number of a sample picks the triangle, and what is left of it a place along its shortest edge, which
        is between vertices 2 and 0; the second number the distance from it. What is left is the same for all samples of
        a pixel if triangles are equal and points low-discrepancy, so it decides about the shortest way.
        """
        vertices, faces = self._mesh.vertices, self._mesh.faces
        same, reverse = find_twins(vertices[faces])
        number = np.arange(len(faces))
        kept = np.flatnonzero((same == number) & ((reverse < 0) | (reverse >= number)))
        kept = kept[compact_order(vertices[faces[kept]])]
        return shortest_edge_last(vertices, faces[kept]), reverse[kept] >= 0

    @cached_property
    def flat(self) -> bool:
        """Whether all triangles are in one plane, up to rounding, so that none can be in front of another."""
        rows, _, area, _ = self._data
        normal, corner = rows[9:, 0], rows[:3]
        away = normal @ (corner - corner[:, :1]), normal @ rows[3:6], normal @ rows[6:9]
        return bool(np.abs(away).max() <= 1e-5 * np.sqrt(np.min(area)))

    @cached_property
    def _intersector(self) -> Intersector:
        return Intersector(self._mesh.vertices, self._sampled[0])

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
        if self.textured:
            area, radiance = area.take(index), self._emitted(index, a, b)
        light_sample = flat_light_sample(chosen[:3] - p + chosen[3:6] * a + chosen[6:9] * b, chosen[9:], area, radiance)
        light_sample.emits |= self._sampled[1].take(index)
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
        if self.textured:
            index = np.maximum(hits.prim, 0)
            area, radiance = area.take(index), self._emitted(index, hits.u, hits.v)
        light_sample = flat_light_hit(wi, hits.distance, dot(chosen[9:], wi), is_hit, area, radiance)
        light_sample.emits |= is_hit & self._sampled[1].take(hits.prim)
        return light_sample

    def pieces(self) -> Pieces | None:
        if self.textured:
            return None
        rows, _, _, radiance = self._data
        area = np.linalg.norm(np.cross(rows[3:6], rows[6:9], axis=0), axis=0) / 2
        return Pieces.of(TRIANGLE, rows, area, radiance, self._sampled[1])

    def extent(self) -> float:
        """Return the diagonal of the bounds."""
        return float(np.linalg.norm(np.ptp(np.asarray(self.vertices, np.float64), axis=0)))

    def mesh(self) -> Mesh:
        return self._mesh

    def hides_itself(self) -> bool:
        """Return whether the triangles are not in one plane."""
        return not self.flat
