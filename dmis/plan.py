"""A scene's plan: what it needs, worked out once, and what it can leave out.

The plan puts the materials that consist of the same kinds of lobes in one `Group`: the estimator partitions hits by
group, not by material, and reads the parameters from tables. Groups keep apart what costs: texture lookups,
interpolated normals, tangents and emission exist only where a group has them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from dmis.brdf import Anisotropic, Conductor, Delta, Dielectric, Glossy
from dmis.camera import Camera
from dmis.geometry import Mesh
from dmis.light import AreaLight, DeltaLight, EnvironmentLight, Light, PointLight
from dmis.material import Material
from dmis.mesh import direction
from dmis.roughness import Elliptic
from dmis.texture import Image
from dmis.vec import Array, Index

NOTHING = 255
"""Group number of misses, and of surfaces that neither reflect nor emit."""


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh with its material.

    Parameters
    ----------
    mesh
        Triangles in world space.
    material
        How they reflect.
    light
        The light whose visible surface this is; the winding of the triangles gives the bright side. None: it is none.
    tangent
        The direction that anisotropic lobes call u, three numbers, laid upon the surface; default: the one in which
        the mesh's texture coordinate u grows.
    """

    mesh: Mesh
    material: Material
    light: AreaLight | None = None
    tangent: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.tangent is not None:
            direction("tangent", self.tangent)


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
    tangent
        ``(3, 1)``, the same for all points; None if tangents are those of the meshes.
    """

    materials: tuple[Material, ...]
    glossy: tuple[Glossy, ...]
    delta: tuple[Delta, ...]
    emission: Array | None
    textured: bool
    smooth: bool
    anisotropic: bool
    tangent: Array | None = None

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

    def __init__(self, camera: Camera, parts: tuple[Part, ...], lights: tuple[Light, ...], epsilon: float) -> None:
        self.sampled: tuple[Light, ...] = tuple(light for light in lights if not light.delta)
        self.deltas: tuple[DeltaLight, ...] = tuple(light for light in lights if light.delta)  # type: ignore[misc]
        self.environment = tuple(light for light in lights if isinstance(light, EnvironmentLight))
        eye = camera.origin[:, 0]
        self.headlights = frozenset(
            k
            for k, light in enumerate(self.deltas)
            if isinstance(light, PointLight) and np.allclose(light.position, eye, rtol=1e-6, atol=0.1 * epsilon)
        )
        keys: dict[Any, list[tuple[Material, AreaLight | None]]] = {}
        part_keys = []
        for part in parts:
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
        for part, key in zip(parts, part_keys, strict=True):
            group = NOTHING if key is None else live.index(key)
            row = next(k for k, (m, light) in enumerate(keys[key]) if m is part.material and light is part.light)
            face_group.append(np.full(len(part.mesh.faces), group, np.uint8))
            face_row.append(np.full(len(part.mesh.faces), row, np.int32))
        # One entry more than there are triangles: the -1 of a miss reads the last one.
        self.face_group = np.concatenate([*face_group, np.array([NOTHING], np.uint8)])
        self.face_row = np.concatenate(face_row)

    def describe(self) -> str:
        """What there is, what it needs, and what is left out, in a few lines."""
        lines = [f"{len(self.face_row):,} triangles"]
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


_COLOURS = {"reflectance", "diffuse", "specular", "transmittance"}
_SCALARS = {"exponent", "u", "v", "alpha", "alpha_u", "alpha_v"}


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


def _anisotropic(lobe: Any) -> bool:
    """Whether a lobe, or the data nested in it, needs tangents."""
    if isinstance(lobe, Anisotropic | Elliptic):
        return True
    return any(_anisotropic(value) for _, value in _parameters(lobe) if is_dataclass(value))


def _group_key(part: Part) -> Any:
    """Equal for parts that can be shaded together; None for parts that neither reflect nor emit."""
    material = part.material
    if not material.lobes and part.light is None:
        return None
    own = id(material) if any(_textures(lobe) for lobe in material.lobes) else None
    smooth = part.mesh.normals is not None and bool(material.lobes)
    tangent = part.tangent if any(_anisotropic(lobe) for lobe in material.lobes) else None
    return tuple(_shape_of(lobe) for lobe in material.lobes), own, smooth, part.light is not None, tangent


def _make_group(key: Any, members: list[tuple[Material, AreaLight | None]]) -> Group:
    _, own, smooth, emits, tangent = key
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
        any(_anisotropic(lobe) for lobe in lobes),
        None if tangent is None else direction("tangent", tangent).astype(np.float32)[:, None],
    )


def _tabulate(lobes: tuple[Any, ...]) -> Any:
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
