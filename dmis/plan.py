"""A scene's plan: what it needs, worked out once, and what it can leave out.

The plan puts the materials that consist of the same kinds of lobes in one `Group`: the estimator partitions hits by
group, not by material, and reads the parameters from tables. Groups keep apart what costs: texture lookups,
interpolated normals, tangents and emission exist only where a group has them.

What is left out is provably zero, whatever the samples: lights without power, lobes that are black, images that are
constant. Which integrator is worth its cost cannot be proved, and is only recommended, by `dmis.survey`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from dmis.brdf import Anisotropic, Delta, Glossy
from dmis.camera import Camera
from dmis.describe import describe
from dmis.geometry import Mesh
from dmis.light import AreaLight, DeltaLight, EnvironmentLight, Light, PointLight
from dmis.material import Material
from dmis.mesh import direction
from dmis.reduction import COLOURS, SCALARS, parameters, reduced, shines
from dmis.rough_glass import RoughTransmission
from dmis.roughness import Elliptic
from dmis.seen import rgb
from dmis.settings import DEPTH, Settings
from dmis.survey import MATTERS, Survey
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
    glossy, through, delta
        Lobes with parameter tables ``(C, M)`` or ``(M,)`` in place of numbers, or textures (then M = 1): those that
        reflect, those of light that comes through, and those that are Dirac deltas.
    emission
        ``(3, M)`` radiance of the bright side; None if nothing here emits.
    textured, smooth, anisotropic
        Whether texture coordinates, interpolated normals, tangents are needed.
    tangent
        ``(3, 1)``, the same for all points; None if tangents are those of the meshes.
    """

    materials: tuple[Material, ...]
    glossy: tuple[Glossy, ...]
    through: tuple[RoughTransmission, ...]
    delta: tuple[Delta, ...]
    emission: Array | None
    textured: bool
    smooth: bool
    anisotropic: bool
    tangent: Array | None = None

    @property
    def reflects(self) -> bool:
        """Whether there is any lobe, and not just emission."""
        return bool(self.glossy or self.through or self.delta)

    def bind(self, lobe: Any, row: Index | None, uv: Array | None) -> Any:
        """`lobe` with the parameters of each point: rows of the tables, or texture values at `uv` ``(2, N)``."""
        if len(self.materials) == 1 and not self.textured:
            return lobe
        changes: dict[str, Any] = {}
        for name, value in parameters(lobe):
            if isinstance(value, Image):
                assert uv is not None
                changes[name] = value(uv) if name in COLOURS else value(uv)[0]
            elif is_dataclass(value):
                changes[name] = self.bind(value, row, uv)
            elif row is not None:
                changes[name] = value.take(row, axis=-1)
        return replace(lobe, **changes)


class Plan:
    """What a scene needs. Everything here is computed once, from the scene alone.

    Parameters
    ----------
    asked
        Integrator and depth that the scene asks for, each None if it does not say.
    survey
        Renders a thumbnail, see `dmis.survey`; called once, and only if someone wants to know.

    Attributes
    ----------
    groups
        The groups of materials that appear on triangles.
    part_group
        Group of each part, or `NOTHING`.
    sampled, deltas
        Lights that take part in MIS; lights that cannot. Lights without power are in neither.
    environment
        Environment lights, which camera rays see where they leave the scene.
    dark
        How many lights have no power.
    headlights
        Positions in `deltas` of point lights at the pinhole: whatever the camera sees, they see, so camera hits
        need no shadow rays towards them.
    """

    def __init__(
        self,
        camera: Camera,
        parts: tuple[Part, ...],
        lights: tuple[Light, ...],
        epsilon: float,
        asked: tuple[str | None, int | None],
        survey: Callable[[], Survey],
    ) -> None:
        self.asked, self._survey = asked, survey
        every = lights
        lights = tuple(light for light in every if shines(light))
        self.dark = len(every) - len(lights)
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
        lean = {id(part.material): reduced(part.material) for part in parts}
        self.dropped = sum(
            len(material.lobes) - len(lean[id(material)].lobes)
            for material in {id(part.material): part.material for part in parts}.values()
        )
        parts = tuple(
            replace(part, material=lean[id(part.material)], light=part.light if part.light in lights else None)
            for part in parts
        )
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
        self.part_group = [NOTHING if key is None else live.index(key) for key in part_keys]
        face_group, face_row = [], []
        for part, key, group in zip(parts, part_keys, self.part_group, strict=True):
            row = next(k for k, (m, light) in enumerate(keys[key]) if m is part.material and light is part.light)
            face_group.append(np.full(len(part.mesh.faces), group, np.uint8))
            face_row.append(np.full(len(part.mesh.faces), row, np.int32))
        # One entry more than there are triangles: the -1 of a miss reads the last one.
        self.face_group = np.concatenate([*face_group, np.array([NOTHING], np.uint8)])
        self.face_row = np.concatenate(face_row)

    @property
    def lit(self) -> bool:
        """Whether there is any light: without, all images are black."""
        return bool(self.sampled or self.deltas)

    @property
    def visible(self) -> bool:
        """Whether there is a light that rays can meet."""
        return bool(self.environment) or any(group.emission is not None for group in self.groups)

    def mixes(self, group: Group, light: Light) -> bool:
        """Whether MIS applies: the light has an extent, and the surface a lobe that is a function."""
        return bool(group.glossy or group.through) and not light.delta

    @cached_property
    def survey(self) -> Survey:
        """What a thumbnail tells, see `dmis.survey`."""
        return self._survey()

    @property
    def integrator(self) -> str:
        """What the scene asks for; if it does not say, ``path`` where the survey finds enough indirect light."""
        if self.asked[0] is not None:
            return self.asked[0]
        return "path" if self.survey.indirect >= MATTERS else "direct"

    def settle(self, settings: Settings) -> Settings:
        """`settings` with an integrator and a depth in place of ``auto``."""
        if settings.integrator != "auto" and settings.max_depth != "auto":
            return settings
        integrator = self.integrator if settings.integrator == "auto" else settings.integrator
        depth = self.depth(integrator) if settings.max_depth == "auto" else settings.max_depth
        return replace(settings, integrator=integrator, max_depth=depth)

    def depth(self, integrator: str) -> int:
        """The scene's depth, if it asks for this integrator or for none; else `dmis.settings.DEPTH`."""
        asked, depth = self.asked
        return DEPTH if depth is None or asked not in (None, integrator) else depth

    def describe(self) -> str:
        """The plan in words, see `dmis.describe`."""
        return describe(self)


def _shape_of(lobe: Any) -> tuple[Any, ...]:
    """What two lobes must share to be shaded together: their types, and what is not a parameter of the point."""
    named = dict(parameters(lobe))
    rest = tuple(getattr(lobe, f.name) for f in fields(lobe) if f.name not in named)
    nested = tuple(_shape_of(value) for value in named.values() if is_dataclass(value) and not isinstance(value, Image))
    return type(lobe), rest, nested


def _textures(lobe: Any) -> bool:
    return any(isinstance(v, Image) or (is_dataclass(v) and _textures(v)) for _, v in parameters(lobe))


def _anisotropic(lobe: Any) -> bool:
    """Whether a lobe, or the data nested in it, needs tangents."""
    if isinstance(lobe, Anisotropic | Elliptic):
        return True
    return any(_anisotropic(value) for _, value in parameters(lobe) if is_dataclass(value))


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
        emission = np.concatenate(
            [rgb("radiance", light.radiance) for _, light in members if light is not None], axis=1
        )
    return Group(
        materials,
        tuple(lobe for lobe in lobes if not isinstance(lobe, Delta | RoughTransmission)),
        tuple(lobe for lobe in lobes if isinstance(lobe, RoughTransmission)),
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
    for name, value in parameters(lobes[0]):
        values = [getattr(lobe, name) for lobe in lobes]
        if isinstance(value, Image):
            changes[name] = value
        elif is_dataclass(value):
            changes[name] = _tabulate(tuple(values))
        elif name in SCALARS:
            table = np.array([float(np.asarray(x).reshape(-1)[0]) for x in values], np.float32)
            changes[name] = table if len(lobes) > 1 else table[0]
        else:
            table = np.stack([np.broadcast_to(np.asarray(x, np.float32).reshape(-1), 3) for x in values], axis=1)
            changes[name] = table[:1] if (table == table[0]).all() else table
    return replace(lobes[0], **changes)
