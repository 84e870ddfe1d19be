"""Shading points: `Surfaces` turns hits into batches of points with all that lobes, lights and shadow rays read."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from functools import cache, cached_property
from operator import is_
from typing import Any

import numpy as np

from dmis.base.patches import row_blocks
from dmis.base.plugins import locked
from dmis.base.vectors import TINY, Array, Index, Selection, columns, compose, dot, frame, normalise, take
from dmis.brdf.lobe import DeltaLobe, Directions, Lobe
from dmis.intersect import Hits
from dmis.scene.groups import Group, Part, bind_lobes
from dmis.scene.plan import Plan


class Surfaces:
    """All surfaces of a scene: vertex attributes as rows per triangle, one gather per hit, and what is made of these.

    Tables that the plan needs are built at once, others when they are first read: a scene without textures never has
    texture coordinates.

    Attributes
    ----------
    parts
        The scene's parts, whose triangles are in order.
    plan, epsilon
        Its plan, and its ray offsets.
    """

    def __init__(self, parts: tuple[Part, ...], plan: Plan, epsilon: Array) -> None:
        self.parts, self.plan, self.epsilon = parts, plan, epsilon
        _ = self.corners
        for group in plan.groups:
            if group.turns:
                _ = self.normals
            if group.textured:
                _ = self.uv
            if group.relief is not None or (group.anisotropic and group.tangent is None):
                _ = self.tangents

    def shading_points(
        self, group: Group, hits: Hits, index: Selection | None, direction: Array
    ) -> tuple[ShadingPoints, Array | None]:
        """Return the shading points of K hits, and the radiance ``(3, K)`` that they emit towards the viewer, or None.

        Parameters
        ----------
        group
            The group of their surfaces; the radiance is None if it does not emit.
        hits, index, direction
            Hits of N rays, which of them (None: all), and unit directions of the N rays, ``(3, N)``.
        """
        prim = take(hits.prim, index)
        u = take(hits.u, index)
        v = take(hits.v, index)
        wo = -take(direction, index)
        corners = columns(self.corners, prim)
        p = interpolate(corners[:9], u, v)
        ng = corners[9:]
        facing = dot(ng, wo)
        ng = ng * np.copysign(np.float32(1), facing)  # on wo's side
        epsilon = take(self.epsilon, prim)
        p += ng * epsilon
        uv = interpolate(columns(self.uv, prim), u, v) if group.textured else None
        n, cos_o = self._shading_normals(group, prim, u, v, uv, wo) if group.turns else (ng, np.abs(facing))
        row = self.plan.face_row.take(prim) if len(group.materials) > 1 else None
        dpdu = columns(self.tangents[0], prim) if group.anisotropic and group.tangent is None else group.tangent
        # parameters of one material without images are the same at all points
        lobes = group.lobes if row is None and uv is None else bind_lobes(group, row, uv)
        outside = facing > 0
        points = ShadingPoints(
            p=p, ng=ng, n=n, wo=wo, cos_o=cos_o, outside=outside, dpdu=dpdu, epsilon=epsilon, **lobes
        )
        emission = group.emission
        if emission is not None:
            if group.textured_light is not None:
                emission = group.textured_emission(p, uv)
            elif row is not None:
                emission = emission.take(row, axis=1)
            emission = emission * outside  # lights shine on one side
        return points, emission

    def _shading_normals(
        self, group: Group, prim: Index, u: Array, v: Array, uv: Array | None, wo: Array
    ) -> tuple[Array, Array]:
        """Return unit shading normals on wo's side ``(3, N)`` and ``n . wo`` ``(N,)`` at points of triangles."""
        n = interpolate(columns(self.normals, prim), u, v)
        if group.relief is not None and uv is not None:
            dpdu, dpdv = (columns(tangent, prim) for tangent in self.tangents)
            n = normalise(n) * np.copysign(np.float32(1), dot(n, columns(self.corners, prim)[9:]))  # outwards
            n = group.relief.normals(n, dpdu, dpdv, uv, group.smooth)
        cos_o = dot(n, wo)
        # normalise and turn towards wo in one multiplication
        scale = np.copysign(1 / np.sqrt(np.maximum(dot(n, n), TINY)), cos_o)
        n *= scale
        cos_o *= scale
        return n, cos_o

    # Tables -----------------------------------------------------------------------------------------------------------

    @cached_property
    def corners(self) -> Array:
        """Per triangle: first vertex, two edges, unit normal, as rows ``(T, 12)``, one gather per hit."""
        rows = np.empty((sum(len(part.mesh.faces) for part in self.parts), 12), np.float32)
        start = 0
        for part in self.parts:
            for block in row_blocks(len(part.mesh.faces), 2**14):  # in float64 they are large
                a, b, c = (part.mesh.vertices[part.mesh.faces[block, k]] for k in range(3))
                edge_u, edge_v = b - a, c - a
                normal = np.cross(edge_u, edge_v)
                normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
                np.concatenate([a, edge_u, edge_v, normal], axis=1, out=rows[start : start + len(a)])
                start += len(a)
        return rows

    @cached_property
    def normals(self) -> Array:
        """Per triangle: normal of the first vertex and the differences of the others to it, ``(T, 9)``."""
        rows = np.empty((len(self.corners), 3, 3), np.float32)
        start = 0
        for part in self.parts:
            stop = start + len(part.mesh.faces)
            if part.mesh.normals is None:
                rows[start:stop] = self.corners[start:stop, None, 9:]
            else:
                rows[start:stop] = part.mesh.normals[part.mesh.faces]
            start = stop
        rows[:, 1:] -= rows[:, :1]
        return rows.reshape(-1, 9)

    @cached_property
    def uv(self) -> Array:
        """Per triangle: texture coordinates of the first vertex and the two differences, ``(T, 6)``.

        A mesh without coordinates has (0,0), (1,0), (1,1) at the corners of each triangle, as in pbrt.
        """
        default = np.array([[0, 0], [1, 0], [1, 1]], np.float32)
        rows = np.concatenate(
            [
                np.broadcast_to(default, (len(part.mesh.faces), 3, 2))
                if part.mesh.uv is None
                else part.mesh.uv[part.mesh.faces].astype(np.float32)
                for part in self.parts
            ]
        )
        rows[:, 1:] -= rows[:, :1]
        return rows.reshape(-1, 6)

    @cached_property
    def tangents(self) -> tuple[Array, Array]:
        """Per triangle: dp/du and dp/dv, ``(T, 3)`` each; the first edge and across it for degenerate coordinates."""
        du1, dv1, du2, dv2 = self.uv[:, 2:].T[:, :, None]
        edge_u = self.corners[:, 3:6]
        edge_v = self.corners[:, 6:9]
        determinant = du1 * dv2 - du2 * dv1
        degenerate = np.abs(determinant) < 1e-20
        divisor = np.where(degenerate, 1, determinant)
        dpdu = np.where(degenerate, edge_u, (dv2 * edge_u - dv1 * edge_v) / divisor)
        across = np.cross(self.corners[:, 9:], dpdu)
        return dpdu, np.where(degenerate, across, (du1 * edge_v - du2 * edge_u) / divisor)


def interpolate(rows: Array, u: Array, v: Array) -> Array:
    """Return ``a + u (b - a) + v (c - a)`` ``(C, N)`` from the rows a, b - a and c - a of triangles, ``(3 C, N)``."""
    count = len(rows) // 3
    values = rows[count : 2 * count] * u
    values += rows[2 * count :] * v
    values += rows[:count]
    return values


class ShadingPoints:
    """N points on surfaces that share the same kinds of lobes, seen from ``wo``.

    A subset (`take`) gathers an attribute when it is first read: most directions miss the light or face away, and
    the few points that remain rarely need everything. Arrays are read-only, because all lobes and lights share them.

    Attributes
    ----------
    p
        Positions, pushed off the surface towards wo: where rays that leave on wo's side begin, ``(3, N)``.
    ng, n
        Unit geometric and shading normals, both on wo's side, ``(3, N)``; the same array on flat surfaces.
    wo
        Unit directions to the viewer, ``(3, N)``.
    cos_o
        ``n . wo``, ``(N,)``.
    reflection, transmission, delta
        Lobes with their parameters bound to these points: those that reflect, those that transmit (evaluated at the
        points of `beyond`), and Dirac deltas of either kind.
    outside
        Whether wo is on the side that the mesh's winding calls outside, ``(N,)`` bool; read where light is refracted.
    dpdu
        ``(3, N)`` or ``(3, 1)``; read by anisotropic lobes only, None where there are none.
    epsilon
        By how much p is pushed off, ``(N,)`` or one number, see `dmis.scene.rescale.ray_offsets`.
    """

    p: Array
    ng: Array
    n: Array
    wo: Array
    cos_o: Array
    outside: Array
    dpdu: Array | None
    epsilon: Array | np.float32
    reflection: tuple[Lobe, ...]
    transmission: tuple[Lobe, ...]
    delta: tuple[DeltaLobe, ...]

    def __init__(self, **attributes: Any) -> None:
        self.__dict__.update(attributes)
        for value in attributes.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        self._parent: ShadingPoints | None = None
        self._index: Selection | None = None

    def take(self, index: Selection | None) -> ShadingPoints:
        """Return the points `index`; None means all of them."""
        if index is None:
            return self
        part = ShadingPoints()
        part._parent = self._parent or self
        part._index = compose(self._index, index)
        return part

    def __getattr__(self, name: str) -> Any:
        """Gather an attribute of a subset the first time that it is read."""
        if name.startswith("_") or self._parent is None:
            raise AttributeError(name)
        if name == "ng" and self._parent.ng is self._parent.n:
            value = self.n
        else:
            value = _gather(getattr(self._parent, name), self._index)
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
        self.__dict__[name] = value
        return value

    def beyond(self) -> ShadingPoints:
        """Return the same points on the side that wo is not on, from which light comes through a rough surface.

        Normals and p are turned to that side, so that ``n . wo`` is negative; the reflection lobes are those of
        `transmission`.
        """
        n = -self.n
        turned = {"p": self.p - self.ng * (2 * self.epsilon), "ng": n if self.ng is self.n else -self.ng, "n": n}
        same = {name: getattr(self, name) for name in ("wo", "outside", "dpdu", "epsilon")}
        lobes = {"reflection": self.transmission, "transmission": (), "delta": ()}
        return ShadingPoints(**turned, **same, **lobes, cos_o=-self.cos_o)

    @cached_property
    def tangents(self) -> tuple[Array, Array]:
        """Unit tangents along and across dp/du; any frame where there is none, or it is along n. Each ``(3, N)``."""
        if self.dpdu is None:
            s, t = frame(self.n)
            return locked(s), locked(t)
        s = self.dpdu - self.n * dot(self.n, self.dpdu)
        along = np.flatnonzero(dot(s, s) <= np.float32(1e-8) * dot(self.dpdu, self.dpdu))
        if len(along):
            s[:, along] = frame(self.n[:, along])[0]
        s = normalise(s)
        x, y, z = self.n
        t = np.stack([y * s[2] - z * s[1], z * s[0] - x * s[2], x * s[1] - y * s[0]])
        return locked(s), locked(t)

    def same_side(self, wi: Array) -> np.ndarray:
        """Return whether f may be positive, ``(N,)`` bool; elsewhere it is 0, whatever technique finds `wi` ``(3, N)``.

        wi must be on wo's side of the triangle *and* of the shading normal (strict normals; Veach 1997, Section 5.3).
        BRDF sampling cannot find directions between the two horizons: if f were positive there, the mean would depend
        on the share of light samples. Transmitted light is evaluated at the points of `beyond`.
        """
        above = dot(self.ng, wi) > 0
        return above if self.ng is self.n else above & (dot(self.n, wi) > 0)

    # The BRDF as a whole: the sum of its lobes, sampled by picking one of them uniformly ------------------------------

    def eval(self, directions: Directions) -> Array:
        """Return the BRDF without the cosine, ``(1, N)``, ``(3, 1)`` or ``(3, N)``; delta lobes excluded."""
        total = self.reflection[0].eval(directions)
        for lobe in self.reflection[1:]:
            total = total + lobe.eval(directions)
        return total

    def pdf(self, directions: Directions) -> Array:
        """Return the density of `sample` at wi, ``(N,)``."""
        total = self.reflection[0].pdf(directions)
        for lobe in self.reflection[1:]:
            total = total + lobe.pdf(directions)
        return total * np.float32(1 / len(self.reflection)) if len(self.reflection) > 1 else total

    def sample(self, u: Array) -> Array:
        """Sample directions ``(3, N)``; of several lobes, ``u[0]`` picks one, see `_sample_a_lobe`."""
        return self.reflection[0].sample(self, u) if len(self.reflection) == 1 else self._sample_a_lobe(u)

    def _sample_a_lobe(self, u: Array) -> Array:
        """Sample directions ``(3, N)``; ``u[0]`` first picks the lobe and is then stretched back to [0, 1)."""
        wi = np.empty_like(self.wo)
        count = len(self.reflection)
        scaled = u[0] * count
        chosen = np.minimum(scaled.astype(np.int8), count - 1)
        stretched = np.stack([np.minimum(scaled - chosen, np.float32(1 - 2**-24)), u[1]])
        for k in range(count):
            index = np.flatnonzero(chosen == k)
            part = self.take(index)
            directions = part._lobe(k).sample(part, stretched.take(index, axis=1))
            for row, values in zip(wi, directions, strict=True):
                row[index] = values
        return wi

    def _lobe(self, k: int) -> Lobe:
        """Return one of the reflection lobes, without gathering the parameters of the others."""
        if self._parent is None or "reflection" in self.__dict__:
            return self.reflection[k]
        lobe: Lobe = _gather(self._parent.reflection[k], self._index)
        return lobe


def _gather(value: Any, index: Selection | None) -> Any:
    """Return the points `index` of an array, or of all arrays in a lobe or a tuple of lobes, but not of constants."""
    if isinstance(value, np.ndarray):
        return take(value, index)
    if isinstance(value, tuple):
        items = tuple(_gather(item, index) for item in value)
        return value if all(map(is_, items, value)) else items
    changes: dict[str, Any] = {}
    for name in _names(value.__class__):
        old = getattr(value, name)
        if (new := _gather(old, index)) is not old:
            changes[name] = new
    return replace(value, **changes) if changes else value


@cache
def _names(kind: type) -> tuple[str, ...]:
    """Return the names of the fields of a dataclass; none for another class."""
    return tuple(f.name for f in fields(kind)) if is_dataclass(kind) else ()
