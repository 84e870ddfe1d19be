"""A scene, frozen: a camera, parts (a mesh, its material, and the light whose surface it is) and lights.

What the scene needs is worked out once by `dmis.scene.plan`; `dmis.scene.shading_points` turns hits into shading
points.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from dmis import no_attribute
from dmis.base.vectors import Array, Selection, columns
from dmis.geometry.refinement import bodies, refine_near_bodies, small_beside
from dmis.intersect import Hits, Intersector, RayCaster
from dmis.light.coincident import lamp_triangles, two_sided
from dmis.light.light import Light, check_light_methods
from dmis.scene.camera import Camera
from dmis.scene.doubts import lamp_doubts, offset_doubts, point_light_doubts
from dmis.scene.groups import NO_GROUP, Group, Part
from dmis.scene.plan import Plan, textures
from dmis.scene.rescale import ray_offsets, rescale, units
from dmis.scene.shading_points import ShadingPoints, Surfaces
from dmis.scene.suggestions import Suggestions


class SceneWarning(UserWarning):
    """Contents of a scene or its file that may not appear in the image as meant."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A camera, parts and lights.

    Parameters
    ----------
    camera
        See `dmis.scene.camera.Camera`.
    parts
        At least one.
    lights
        All lights, those with a visible surface included.
    name
        For titles and file names.
    suggested
        What the scene's file asks for: integrator and depth.
    source
        How a file was read, JSON data for the provenance of images: ``unread``, a list of contents that are left out,
        ``added``, of what it lacks, ``cameras``, ``lit``, what of the file lights it; of a pbrt file ``dialect``
        and ``dialect_from``, ``file`` (its words), ``caller`` or ``guess``; and ``quadrics``, how they are tessellated.

    Raises
    ------
    ValueError
        If an argument is something else, there is no part, a part's light is not among the lights, a light lacks a
        method, or a mesh light that is not flat is no part's.

    Warns
    -----
    SceneWarning
        If the material of a mesh without texture coordinates has an image.
    """

    camera: Camera
    parts: tuple[Part, ...]
    lights: tuple[Light, ...]
    name: str = "scene"
    suggested: Suggestions = field(default_factory=Suggestions)
    source: Mapping[str, Any] = field(default_factory=dict)
    __getattr__ = no_attribute

    def __repr__(self) -> str:
        width, height = self.camera.resolution
        triangles = sum(part.mesh.triangles for part in self.parts)
        counts = ((len(self.parts), "part"), (triangles, "triangle"), (len(self.lights), "light"))
        contents = ", ".join(f"{n:,} {noun}{'' if n == 1 else 's'}" for n, noun in counts)
        return f"Scene({self.name} {width}x{height}, {contents})"

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
        if not isinstance(self.suggested, Suggestions):
            raise ValueError(f"suggested must be dmis.Suggestions, such as those of a file; got {self.suggested!r}")
        lights, seen = ({id(light) for light in of} for of in (self.lights, (part.light for part in self.parts)))
        for part in self.parts:
            if part.light is not None and id(part.light) not in lights:
                raise ValueError(
                    "a part's light must be among the scene's lights, because it would be seen but not sampled"
                )
        for light in self.lights:
            check_light_methods(light)
            if light.hides_itself() and id(light) not in seen:
                raise ValueError(
                    f"a {type(light).__name__} that is not flat must be a part of the scene too, because its triangles "
                    "may hide one another; dmis.light_part makes one of it"
                )
        bare = [part for part in self.parts if part.mesh.uv is None and textures(part.material)]
        if bare:
            text = (
                f"scene {self.name}: {len(bare)} of {len(self.parts)} parts have an image texture and no texture "
                f"coordinates (the first: {bare[0].material.name}, {bare[0].mesh.triangles} triangles); each of their "
                "triangles shows the half of the image from (0, 0) over (1, 0) to (1, 1), as in pbrt; give the mesh uv"
            )
            warnings.warn(SceneWarning(text), stacklevel=3)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, which are pickled; tables and the Embree handle are rebuilt where they are used."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def crop(self, *window: Any, **old: Any) -> Scene:
        """Return the scene seen through a window ``(x0, y0, x1, y1)``, see `dmis.scene.camera.Camera.crop`.

        With fixed shares the window has the same bits as in the whole image; to a rule that learns it is an image of
        its own (`dmis.pipeline.job.Job.window`). Plan, tables and Embree are those of this scene.
        """
        return self.seen_by(self.camera.crop(*window, **old))

    @cached_property
    def uncropped(self) -> Scene:
        """The scene of the whole image that this one is a window of, see `crop`."""
        return self.seen_by(self.camera.uncropped)

    def seen_by(self, camera: Camera) -> Scene:
        """Return the scene seen by a camera with the same pinhole; plan, tables and Embree are those of this scene."""
        shared = "plan", "surfaces", "intersector", "epsilon"
        return self.changed(camera=camera, **{name: getattr(self, name) for name in shared})

    def changed(self, **values: Any) -> Scene:
        """Return a copy with other fields or tables, which are not checked: for those that follow from this scene."""
        scene = object.__new__(type(self))
        vars(scene).update(self.__getstate__() | values)
        return scene

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest coordinates of the parts that rays leave, ``(3,)`` float64 each: a lamp that reflects
        nothing, such as a sun, does not count if there is any other part."""
        meshes = [part.mesh for part in self.parts if part.material.lobes] or [part.mesh for part in self.parts]
        return np.min([mesh.bounds[0] for mesh in meshes], axis=0), np.max([mesh.bounds[1] for mesh in meshes], axis=0)

    @cached_property
    def bodies(self) -> Array:
        """Bounds ``(B, 2, 3)`` of the bodies of all parts, see `dmis.geometry.refinement`."""
        return np.concatenate([bodies(part.mesh) for part in self.parts])

    @property
    def small_bodies(self) -> Array:
        """Bounds ``(B, 2, 3)`` of the bodies that are small beside the scene, see `dmis.geometry.refinement`."""
        return small_beside(float(np.linalg.norm(np.subtract(*self.bounds))), self.bodies)

    @cached_property
    def epsilon(self) -> Array:
        """Ray offsets, float32: one, ``()``, or of each triangle, ``(T,)``, see `dmis.scene.rescale.ray_offsets`."""
        return ray_offsets(self.parts, self.bounds, self.small_bodies)

    @cached_property
    def units(self) -> tuple[Array, float, float]:
        """Origin ``(3,)``, unit of length and unit of radiance of `in_float32`, see `dmis.scene.rescale.units`."""
        return units(*self.bounds, self.small_bodies, self.lights)

    @cached_property
    def _other_units(self) -> tuple[Scene, float] | None:
        origin, length, gain = self.units
        scene = self
        if origin.any() or length != 1 or gain != 1:
            scene = self.changed(**rescale(self.camera, self.parts, self.lights, self.units))
        parts = tuple(replace(part, mesh=refine_near_bodies(part.mesh, scene.bodies)) for part in scene.parts)
        if any(new.mesh is not old.mesh for new, old in zip(parts, scene.parts, strict=True)):
            scene = scene.changed(parts=parts)
        # not the scene itself: it would refer to itself, and its memory would not be freed at once
        return None if scene is self else (scene, gain)

    @property
    def in_float32(self) -> tuple[Scene, float]:
        """The scene in units that float32 holds, and the factor for its image, see `dmis.scene.rescale`.

        It is kept with this scene, as are its tables and Embree's copy; it is this scene if that is not extreme.
        """
        return self._other_units or (self, 1.0)

    @cached_property
    def plan(self) -> Plan:
        """Groups and lights that a render computes with, see `dmis.scene.plan.Plan`."""
        return Plan(self.camera, self.parts, self.lights, float(np.min(self.epsilon)))

    def describe(self) -> str:
        """Return in words what ``python -m dmis info`` prints: the plan, what the file suggests, how it was read."""
        from dmis.scene.describe import describe_plan, describe_source

        unread = self.source.get("unread", ())
        return "\n".join([describe_plan(self.plan, unread), self.suggested.describe(), *describe_source(self.source)])

    @cached_property
    def covered_pixels(self) -> np.ndarray | None:
        """Pixels that triangles may cover, ``(H, W)`` bool; None: all of them, see `Camera.covered_pixels`."""
        if self.plan.environment:
            return None
        live = [part.mesh for part, group in zip(self.parts, self.plan.part_group, strict=True) if group != NO_GROUP]
        return self.camera.covered_pixels(live if self.plan.has_light else [])

    @cached_property
    def intersector(self) -> RayCaster:
        """Embree over all triangles of all parts, in order; of lamps back to back it reports the one that is met, and
        it traces rays on through the holes of masks."""
        meshes = [part.mesh for part in self.parts]
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        # the last vertex is no number: Embree leaves out triangles that have it
        vertices = np.concatenate([*(mesh.vertices for mesh in meshes), np.full((1, 3), np.nan)], dtype=np.float32)
        faces = np.concatenate([mesh.faces + np.int32(k) for mesh, k in zip(meshes, offsets, strict=False)])
        lamps = lamp_triangles(self.parts)[:2]
        caster = two_sided(Intersector(vertices[:-1], faces), *lamps)
        masked = np.repeat([part.mask is not None for part in self.parts], [len(mesh.faces) for mesh in meshes])
        if not masked.any():
            return caster
        from dmis.scene.masks import MaskedCaster

        solid = two_sided(Intersector(vertices, np.where(masked[:, None], offsets[-1], faces)), *lamps)
        return MaskedCaster(caster, solid, self.parts, lambda prim: columns(self.surfaces.uv, prim))

    @cached_property
    def _doubts(self) -> tuple[str, ...]:
        return (
            *lamp_doubts(self.parts, self.plan, self.intersector, 2 * float(np.min(self.epsilon))),
            *offset_doubts(self.parts, self.small_bodies, self.epsilon),
            *point_light_doubts(self.plan, self.intersector),
        )

    def prepare(self) -> None:
        """Build now what is otherwise built when it is first needed, so that it is not part of a measured time.

        A ValueError if two lamps overlap; a SceneWarning if float32 does not resolve a small part, or a lamp is nearer
        to a surface than rays can tell.
        """
        for text in self._doubts:
            warnings.warn(SceneWarning(f"scene {self.name}: {text}"), stacklevel=3)
        _ = self.intersector, self.covered_pixels, self.surfaces

    @cached_property
    def surfaces(self) -> Surfaces:
        """Vertex attributes of the triangles, and what turns hits into shading points."""
        return Surfaces(self.parts, self.plan, self.epsilon)

    def shading_points(
        self, group: Group, hits: Hits, index: Selection | None, direction: Array
    ) -> tuple[ShadingPoints, Array | None]:
        """Return the shading points of hits, and what they emit, see `Surfaces.shading_points`."""
        return self.surfaces.shading_points(group, hits, index, direction)
