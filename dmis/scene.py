"""A scene, frozen; and its plan: what this scene needs, computed once, and what it can leave out.

A scene is a camera, parts (a mesh, its material, and the light whose visible surface it is, if any) and lights. The
plan puts all triangles in one table, and the materials that consist of the same kinds of lobes in one `Group`: the
estimator partitions hits by group, not by material, and reads the parameters from tables. Groups keep apart what
costs: texture lookups, interpolated normals, tangents, emission exist only where a group has them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from dmis.brdf import Anisotropic, Conductor, Delta, Dielectric, Glossy, Lobe
from dmis.camera import Camera
from dmis.geometry import Mesh
from dmis.intersect import Hits, Intersector, RayCaster
from dmis.light import AreaLight, DeltaLight, EnvironmentLight, Light, PointLight
from dmis.material import Material
from dmis.surface import Surface
from dmis.texture import Image
from dmis.vec import Array, Index, dot

NOTHING = 255
"""Group number of misses, and of surfaces that neither reflect nor emit."""


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh with its material; `light` is the light whose visible surface it is. Its winding gives the bright side."""

    mesh: Mesh
    material: Material
    light: AreaLight | None = None


@dataclass(frozen=True, eq=False)
class Group:
    """Materials with the same kinds of lobes, shaded as one batch.

    Attributes
    ----------
    materials
        The materials; a part's row in the parameter tables is its position here.
    glossy, delta
        Lobes with parameter tables ``(C, M)`` or ``(M,)`` in place of numbers, or textures (then M = 1).
    emission
        ``(3, M)`` radiance of the bright side; None if nothing here emits.
    textured, smooth, anisotropic
        Whether texture coordinates, interpolated normals, tangents are needed.
    """

    materials: tuple[Material, ...]
    glossy: tuple[Glossy, ...]
    delta: tuple[Delta, ...]
    emission: Array | None
    textured: bool
    smooth: bool
    anisotropic: bool

    def bind(self, lobe: Any, row: Index | None, uv: Array | None) -> Any:
        """`lobe` with the parameters of each point: rows of the tables, or texture values at `uv` ``(2, N)``."""
        if len(self.materials) == 1 and not self.textured:
            return lobe
        changes: dict[str, Any] = {}
        for name, value in _parameters(lobe):
            if isinstance(value, Image):
                assert uv is not None
                changes[name] = value(uv) if name in _COLOURS else value(uv)[0]
            elif is_dataclass(value):
                changes[name] = self.bind(value, row, uv)
            elif row is not None:
                changes[name] = value.take(row, axis=-1)
        return replace(lobe, **changes)


class Plan:
    """What a scene needs. Everything here is computed once, from the scene alone.

    Attributes
    ----------
    groups
        The groups of materials that appear on triangles.
    sampled, deltas
        Lights that take part in MIS; lights that cannot.
    environment
        Environment lights, which camera rays see where they leave the scene.
    headlights
        Positions in `deltas` of point lights at the pinhole: whatever the camera sees, they see, so camera hits
        need no shadow rays towards them.
    """

    def __init__(self, scene: Scene) -> None:
        self.sampled: tuple[Light, ...] = tuple(light for light in scene.lights if not light.delta)
        self.deltas: tuple[DeltaLight, ...] = tuple(light for light in scene.lights if light.delta)  # type: ignore[misc]
        self.environment = tuple(light for light in scene.lights if isinstance(light, EnvironmentLight))
        eye = scene.camera.origin[:, 0]
        self.headlights = frozenset(
            k
            for k, light in enumerate(self.deltas)
            if isinstance(light, PointLight) and np.allclose(light.position, eye, rtol=1e-6, atol=0.1 * scene.epsilon)
        )
        keys: dict[Any, list[tuple[Material, AreaLight | None]]] = {}
        part_keys = []
        for part in scene.parts:
            key = _group_key(part)
            part_keys.append(key)
            members = keys.setdefault(key, [])
            if not any(m is part.material and light is part.light for m, light in members):
                members.append((part.material, part.light))
        live = [key for key in keys if key is not None]
        if len(live) >= NOTHING:
            raise ValueError(
                f"a scene may have at most {NOTHING - 1} groups of textured or different materials; got {len(live)}"
            )
        self.groups = tuple(_make_group(key, keys[key]) for key in live)
        face_group, face_row = [], []
        for part, key in zip(scene.parts, part_keys, strict=True):
            group = NOTHING if key is None else live.index(key)
            row = next(k for k, (m, light) in enumerate(keys[key]) if m is part.material and light is part.light)
            face_group.append(np.full(len(part.mesh.faces), group, np.uint8))
            face_row.append(np.full(len(part.mesh.faces), row, np.int32))
        # One entry more than there are triangles: the -1 of a miss reads the last one.
        self.face_group = np.concatenate([*face_group, np.array([NOTHING], np.uint8)])
        self.face_row = np.concatenate(face_row)
        self._name = scene.name
        self._size = scene.camera.resolution

    def describe(self) -> str:
        """What there is, what it needs, and what is left out, in a few lines."""
        width, height = self._size
        lines = [f"scene {self._name}, {width}x{height}, {len(self.face_row):,} triangles"]
        for k, group in enumerate(self.groups):
            names = ", ".join(sorted({material.name for material in group.materials}))
            lobes = " + ".join(type(lobe).__name__ for lobe in (*group.glossy, *group.delta)) or "no lobes"
            needs = [
                text
                for needed, text in (
                    (group.textured, "textures"),
                    (group.smooth, "interpolated normals"),
                    (group.anisotropic, "tangents"),
                    (group.emission is not None, "emission"),
                )
                if needed
            ]
            triangles = int((self.face_group == k).sum())
            lines.append(
                f"  group {k}: {len(group.materials)} x {names}: {lobes}; {triangles:,} triangles; "
                f"needs {', '.join(needs) or 'nothing else'}"
            )
        nothing = int((self.face_group[:-1] == NOTHING).sum())
        if nothing:
            lines.append(f"  {nothing:,} triangles neither reflect nor emit: they only occlude")
        for light in self.sampled:
            lines.append(f"  {type(light).__name__}: two techniques, MIS")
        for k, light in enumerate(self.deltas):
            rays = ", at the pinhole: no shadow rays from camera hits" if k in self.headlights else ""
            lines.append(f"  {type(light).__name__}: a single direction, outside MIS{rays}")
        if not self.sampled:
            lines.append("  no light to sample by two techniques: MIS does not apply")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class Scene:
    """A camera, parts and lights.

    Parameters
    ----------
    camera
        See `dmis.camera.Camera`.
    parts
        At least one.
    lights
        All lights, those with a visible surface included.
    name
        For titles and file names.

    Raises
    ------
    ValueError
        If there is no part, or a part's light is not among the lights.
    """

    camera: Camera
    parts: tuple[Part, ...]
    lights: tuple[Light, ...]
    name: str = "scene"

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(self.parts))
        object.__setattr__(self, "lights", tuple(self.lights))
        if not self.parts:
            raise ValueError("a scene needs at least one part, because there is nothing to see otherwise; got none")
        for part in self.parts:
            if part.light is not None and not any(part.light is light for light in self.lights):
                raise ValueError(
                    "a part's light must be among the scene's lights, because it would be seen but not sampled"
                )

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: the description. Tables and the Embree handle are rebuilt where they are used."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def epsilon(self) -> np.float32:
        """Offset of ray origins along the geometric normal, 1e-6 of the scene's extent (the larger of its
        diagonal and its largest coordinate, which sets the rounding of float32 positions)."""
        low = np.min([part.mesh.vertices.min(axis=0) for part in self.parts], axis=0)
        high = np.max([part.mesh.vertices.max(axis=0) for part in self.parts], axis=0)
        extent = max(np.linalg.norm(high - low), np.abs(low).max(), np.abs(high).max())
        return np.float32(1e-6 * extent)

    @cached_property
    def plan(self) -> Plan:
        """See `Plan`."""
        return Plan(self)

    @cached_property
    def intersector(self) -> RayCaster:
        """Embree over all triangles of all parts, in order."""
        offsets = np.cumsum([0, *(len(part.mesh.vertices) for part in self.parts)])
        vertices = np.concatenate([part.mesh.vertices for part in self.parts])
        faces = np.concatenate([part.mesh.faces + k for part, k in zip(self.parts, offsets, strict=False)])
        return Intersector(vertices, faces)

    @cached_property
    def _corners(self) -> Array:
        """Per triangle: first vertex, two edges, unit normal, as rows ``(T, 12)``, one gather per hit."""
        corners = np.concatenate([part.mesh.vertices[part.mesh.faces] for part in self.parts])
        edge_u, edge_v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(edge_u, edge_v)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        return np.concatenate([corners[:, 0], edge_u, edge_v, normal], axis=1).astype(np.float32)

    @cached_property
    def _normals(self) -> Array:
        """Per triangle: normal of the first vertex and the differences of the others to it, ``(T, 9)``."""
        rows = np.empty((len(self._corners), 3, 3), np.float32)
        start = 0
        for part in self.parts:
            stop = start + len(part.mesh.faces)
            if part.mesh.normals is None:
                rows[start:stop] = self._corners[start:stop, None, 9:]
            else:
                rows[start:stop] = part.mesh.normals[part.mesh.faces]
            start = stop
        rows[:, 1:] -= rows[:, :1]
        return rows.reshape(-1, 9)

    @cached_property
    def _uv(self) -> Array:
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
    def _dpdu(self) -> Array:
        """Per triangle: dp/du ``(T, 3)``; the first edge where the coordinates are degenerate."""
        du1, dv1, du2, dv2 = self._uv[:, 2:].T
        edge_u, edge_v = self._corners[:, 3:6], self._corners[:, 6:9]
        determinant = (du1 * dv2 - du2 * dv1)[:, None]
        degenerate = np.abs(determinant) < 1e-20
        dpdu = (dv2[:, None] * edge_u - dv1[:, None] * edge_v) / np.where(degenerate, 1, determinant)
        return np.where(degenerate, edge_u, dpdu)

    def surface(self, group: Group, hits: Hits, index: Index | None, direction: Array) -> tuple[Surface, Array | None]:
        """The surface points of the hits `index` (None: all), which must belong to `group`, and what they emit.

        Parameters
        ----------
        direction
            Unit directions of the rays that hit, ``(3, N)``, of all hits.

        Returns
        -------
        surface
            Its size is that of `index`.
        emission
            ``(3, N)`` radiance emitted towards the viewer; None if the group does not emit.
        """
        if index is None:
            prim, u, v, wo = hits.prim, hits.u, hits.v, -direction
        else:
            prim, u, v = hits.prim.take(index), hits.u.take(index), hits.v.take(index)
            wo = -direction.take(index, axis=1)
        rows = np.ascontiguousarray(self._corners.take(prim, axis=0).T)
        p = rows[3:6] * u
        p += rows[6:9] * v
        p += rows[:3]
        ng = rows[9:]
        facing = dot(ng, wo)
        side = np.copysign(np.float32(1), facing)
        ng *= side
        p += ng * self.epsilon
        n, cos_o = ng, np.abs(facing)
        if group.smooth:
            rows = np.ascontiguousarray(self._normals.take(prim, axis=0).T)
            n = rows[3:6] * u
            n += rows[6:9] * v
            n += rows[:3]
            cos_o = dot(n, wo)
            # normalise and turn towards wo in one multiplication
            scale = np.copysign(1 / np.sqrt(np.maximum(dot(n, n), np.float32(1e-30))), cos_o)
            n *= scale
            cos_o *= scale
        row = self.plan.face_row.take(prim) if len(group.materials) > 1 else None
        uv = dpdu = None
        if group.textured:
            rows = np.ascontiguousarray(self._uv.take(prim, axis=0).T)
            uv = rows[2:4] * u + rows[4:6] * v + rows[:2]
        if group.anisotropic:
            dpdu = np.ascontiguousarray(self._dpdu.take(prim, axis=0).T)
        outside = facing > 0
        emission = None
        if group.emission is not None:
            emission = (group.emission if row is None else group.emission.take(row, axis=1)) * outside
        glossy = tuple(group.bind(lobe, row, uv) for lobe in group.glossy)
        delta = tuple(group.bind(lobe, row, uv) for lobe in group.delta)
        surface = Surface(p=p, ng=ng, n=n, wo=wo, cos_o=cos_o, outside=outside, dpdu=dpdu, glossy=glossy, delta=delta)
        return surface, emission


_COLOURS = {"reflectance", "diffuse", "specular", "transmittance"}
_SCALARS = {"exponent", "u", "v"}


def _parameters(lobe: Any) -> Iterator[tuple[str, Any]]:
    """The parameters that differ from point to point, and the nested data that may hold some."""
    for field in fields(lobe):
        value = getattr(lobe, field.name)
        if field.name in _COLOURS | _SCALARS or (is_dataclass(value) and not isinstance(value, Dielectric | Conductor)):
            yield field.name, value


def _shape_of(lobe: Any) -> tuple[Any, ...]:
    """What two lobes must share to be shaded together: their types, and what is not a parameter of the point."""
    named = dict(_parameters(lobe))
    rest = tuple(getattr(lobe, f.name) for f in fields(lobe) if f.name not in named)
    nested = tuple(_shape_of(value) for value in named.values() if is_dataclass(value) and not isinstance(value, Image))
    return type(lobe), rest, nested


def _textures(lobe: Any) -> bool:
    return any(isinstance(v, Image) or (is_dataclass(v) and _textures(v)) for _, v in _parameters(lobe))


def _group_key(part: Part) -> Any:
    """Equal for parts that can be shaded together; None for parts that neither reflect nor emit."""
    material = part.material
    if not material.lobes and part.light is None:
        return None
    own = id(material) if any(_textures(lobe) for lobe in material.lobes) else None
    smooth = part.mesh.normals is not None and bool(material.lobes)
    return tuple(_shape_of(lobe) for lobe in material.lobes), own, smooth, part.light is not None


def _make_group(key: Any, members: list[tuple[Material, AreaLight | None]]) -> Group:
    _, own, smooth, emits = key
    materials = tuple(material for material, _ in members)
    lobes = tuple(_tabulate(same) for same in zip(*(material.lobes for material in materials), strict=True))
    emission = None
    if emits:
        emission = np.stack(
            [np.asarray(light.radiance, np.float32) for _, light in members if light is not None], axis=1
        )
    return Group(
        materials,
        tuple(lobe for lobe in lobes if not isinstance(lobe, Delta)),
        tuple(lobe for lobe in lobes if isinstance(lobe, Delta)),
        emission,
        own is not None,
        smooth,
        any(isinstance(value, Anisotropic) for lobe in lobes for _, value in _parameters(lobe)),
    )


def _tabulate(lobes: tuple[Lobe, ...] | tuple[Any, ...]) -> Any:
    """One lobe whose parameters are tables over the materials: colours ``(1 or 3, M)``, scalars ``(M,)``."""
    changes: dict[str, Any] = {}
    for name, value in _parameters(lobes[0]):
        values = [getattr(lobe, name) for lobe in lobes]
        if isinstance(value, Image):
            changes[name] = value
        elif is_dataclass(value):
            changes[name] = _tabulate(tuple(values))
        elif name in _SCALARS:
            table = np.array([float(np.asarray(x).reshape(-1)[0]) for x in values], np.float32)
            changes[name] = table if len(lobes) > 1 else table[0]
        else:
            table = np.stack([np.broadcast_to(np.asarray(x, np.float32).reshape(-1), 3) for x in values], axis=1)
            changes[name] = table[:1] if (table == table[0]).all() else table
    return replace(lobes[0], **changes)
