"""A scene, frozen: a camera, parts (a mesh, its material, and the light whose surface it is) and lights.

What the scene needs is worked out once by `dmis.plan`; hits become surface points by the tables of `dmis.tables`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from dmis.camera import Camera
from dmis.checks import whole
from dmis.intersect import Hits, Intersector, RayCaster
from dmis.light import Light, MeshLight
from dmis.plan import NOTHING, Group, Plan
from dmis.plan import Part as Part
from dmis.seeing import pixels_that_see
from dmis.settings import DEEPEST
from dmis.surface import Surface
from dmis.survey import survey
from dmis.tables import Tables
from dmis.vec import TINY, Array, Selection, columns, dot, take

OFFSET = 1e-6
"""Of ray origins from the surfaces that rays leave, in extents of these: float32 positions are rounded."""
MIXED = 1000
"""How many times as large as a part a scene may be for all of its rays to begin equally high."""


def _extent(low: Array, high: Array) -> float:
    """The larger of the diagonal and the largest coordinate, which sets the rounding of float32 positions."""
    return float(max(np.linalg.norm(high - low), np.abs(low).max(), np.abs(high).max()))


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
    integrator, max_depth
        What the scene's file asks for, see `dmis.settings.Settings`; None if it does not say.

    Raises
    ------
    ValueError
        If an argument is something else, there is no part, a part's light is not among the lights, a mesh light that is
        not flat is no part's, or there is no such integrator or depth.
    """

    camera: Camera
    parts: tuple[Part, ...]
    lights: tuple[Light, ...]
    name: str = "scene"
    integrator: str | None = None
    max_depth: int | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.camera, Camera):
            raise ValueError(f"camera must be a Camera; got {self.camera!r}")
        for name, values, kind in (("parts", self.parts, Part), ("lights", self.lights, Light)):
            found = tuple(values) if isinstance(values, Iterable) else None
            if found is None or not all(isinstance(value, kind) for value in found):
                raise ValueError(f"{name} must be a sequence of {name} of dmis; got {values!r}")
            object.__setattr__(self, name, found)
        if not self.parts:
            raise ValueError("a scene needs at least one part, because there is nothing to see otherwise; got none")
        if self.integrator not in (None, "direct", "path"):
            raise ValueError(f"integrator must be direct or path, or None; got {self.integrator!r}")
        if self.max_depth is not None:
            object.__setattr__(self, "max_depth", whole("max_depth", self.max_depth, 1, DEEPEST, "or None"))
        for part in self.parts:
            if part.light is not None and not any(part.light is light for light in self.lights):
                raise ValueError(
                    "a part's light must be among the scene's lights, because it would be seen but not sampled"
                )
        for light in self.lights:
            if isinstance(light, MeshLight) and not light.flat and not any(part.light is light for part in self.parts):
                raise ValueError(
                    "a MeshLight that is not flat must be a part of the scene too, because its triangles may hide one "
                    "another; dmis.load.light_part makes one of it"
                )

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: the description. Tables and the Embree handle are rebuilt where they are used."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def crop(self, rows: tuple[int, int], columns: tuple[int, int]) -> Scene:
        """The scene seen through a part of the image, see `dmis.camera.Camera.crop`.

        Plan, tables and Embree are those of this scene, so a crop costs nothing.
        """
        return self.seen_by(self.camera.crop(rows, columns))

    def seen_by(self, camera: Camera) -> Scene:
        """The scene seen by a camera with the same pinhole; plan, tables and Embree are those of this scene."""
        scene = replace(self, camera=camera)
        known = "plan", "tables", "intersector", "epsilon", "own_epsilon"
        vars(scene).update({name: getattr(self, name) for name in known})
        return scene

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest coordinates of what rays go on from, ``(3,)`` float64 each: a lamp that reflects nothing,
        such as a sun, does not count if there is anything else."""
        meshes = [part.mesh for part in self.parts if part.material.lobes] or [part.mesh for part in self.parts]
        return np.min([mesh.bounds[0] for mesh in meshes], axis=0), np.max([mesh.bounds[1] for mesh in meshes], axis=0)

    @cached_property
    def epsilon(self) -> np.float32:
        """Offset of ray origins along the geometric normal, `OFFSET` of the extent of `bounds`."""
        return np.float32(OFFSET * _extent(*self.bounds))

    @cached_property
    def own_epsilon(self) -> Array | None:
        """`OFFSET` of the extent of the part that a triangle is of, ``(T,)``, for scenes whose `epsilon` would begin
        rays far above their smallest part (`MIXED`); None for others."""
        own = np.array([OFFSET * _extent(*part.mesh.bounds) for part in self.parts], np.float32)
        reflecting = own[[bool(part.material.lobes) for part in self.parts]]
        if not (reflecting * np.float32(MIXED) < self.epsilon).any():
            return None
        return np.repeat(np.clip(own, TINY, self.epsilon), [len(part.mesh.faces) for part in self.parts])

    @cached_property
    def plan(self) -> Plan:
        """What the scene needs, see `dmis.plan.Plan`."""
        asked = self.integrator, self.max_depth
        return Plan(self.camera, self.parts, self.lights, float(self.epsilon), asked, lambda: survey(self))

    @cached_property
    def seeing(self) -> np.ndarray | None:
        """Pixels that may see something, ``(H, W)`` bool; None: all of them, see `dmis.seeing`."""
        if self.plan.environment:
            return None
        live = [part.mesh for part, group in zip(self.parts, self.plan.part_group, strict=True) if group != NOTHING]
        return pixels_that_see(self.camera, live if self.plan.lit else [])

    @cached_property
    def intersector(self) -> RayCaster:
        """Embree over all triangles of all parts, in order."""
        offsets = np.cumsum([0, *(len(part.mesh.vertices) for part in self.parts)])
        vertices = np.concatenate([part.mesh.vertices for part in self.parts], dtype=np.float32)
        faces = np.concatenate([part.mesh.faces + np.int32(k) for part, k in zip(self.parts, offsets, strict=False)])
        return Intersector(vertices, faces)

    def prepare(self) -> None:
        """Build now what is otherwise built when it is first needed, so that it is not part of a measured time."""
        _ = self.plan, self.intersector, self.epsilon, self.own_epsilon, self.tables.corners, self.seeing
        for group in self.plan.groups:
            if group.smooth:
                _ = self.tables.normals
            if group.textured:
                _ = self.tables.uv
            if group.anisotropic and group.tangent is None:
                _ = self.tables.dpdu

    @cached_property
    def tables(self) -> Tables:
        """What hits are read from, see `dmis.tables.Tables`."""
        return Tables(self.parts)

    def surface(
        self, group: Group, hits: Hits, index: Selection | None, direction: Array
    ) -> tuple[Surface, Array | None]:
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
        prim, u, v = take(hits.prim, index), take(hits.u, index), take(hits.v, index)
        wo = -take(direction, index)
        rows = columns(self.tables.corners, prim)
        p = rows[3:6] * u
        p += rows[6:9] * v
        p += rows[:3]
        ng = rows[9:]
        facing = dot(ng, wo)
        side = np.copysign(np.float32(1), facing)
        ng = ng * side
        epsilon = self.epsilon if self.own_epsilon is None else self.own_epsilon.take(prim)
        p += ng * epsilon
        n, cos_o = ng, np.abs(facing)
        if group.smooth:
            rows = columns(self.tables.normals, prim)
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
            rows = columns(self.tables.uv, prim)
            uv = rows[2:4] * u + rows[4:6] * v + rows[:2]
        if group.tangent is not None:
            dpdu = group.tangent
        elif group.anisotropic:
            dpdu = columns(self.tables.dpdu, prim)
        outside = facing > 0
        emission = None
        if group.emission is not None:
            emission = (group.emission if row is None else group.emission.take(row, axis=1)) * outside
        glossy = tuple(group.bind(lobe, row, uv) for lobe in group.glossy)
        through = tuple(group.bind(lobe, row, uv) for lobe in group.through)
        delta = tuple(group.bind(lobe, row, uv) for lobe in group.delta)
        lobes = {"glossy": glossy, "through": through, "delta": delta}
        found = Surface(p=p, ng=ng, n=n, wo=wo, cos_o=cos_o, outside=outside, dpdu=dpdu, epsilon=epsilon, **lobes)
        return found, emission
