"""A scene's plan: the groups and lights that a render computes with, made once; what adds nothing is left out.

The plan puts the materials that consist of the same kinds of lobes in one `Group`: the estimator partitions hits by
group, not by material, and reads the parameters from tables. Groups keep apart what costs: texture lookups,
interpolated normals, tangents and emission exist only where a group has them.

What is left out is provably zero, whatever the samples: lights without power, lobes that are black, images that are
constant.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from dmis.base.plugins import checked
from dmis.brdf.materials import Material
from dmis.light.light import LIGHT_CHECKS, AreaLight, DeltaLight, InfiniteLight, Light, SampledLight
from dmis.light.pieces import Pieces
from dmis.scene.camera import Camera
from dmis.scene.groups import NO_GROUP, Group, Part, batch_key, has_texture, make_group, simplify

MANY_LIGHTS = 128
"""Number of lights from which on they are sampled as one. At equal CPU time, relMSE is that of samples of each with
about 90 lights by the balance heuristic, with 130 by ``auto`` (benchmarks/many_lights.py of 9db2350c)."""
DEEPER_LIGHTS = 4
"""Number of area lights from which on a tree selects one of them where a path has scattered. relMSE times CPU time over
samples of each light there is 0.70 on ``ten-lights``, 0.92 on ``veach-mis`` (docs/paths.md), and above 1 where
CORNELL's lamp is cut in two or three."""
MANY_TRIANGLES = 1000
"""Triangles of a mesh light from which on a tree over them costs no more than the shadow rays that it saves."""


class Plan:
    """Groups and lights of a scene, computed once from the scene alone.

    Attributes
    ----------
    groups
        The groups of materials that appear on triangles.
    part_group
        Group of each part, or `NO_GROUP`.
    sampled, deltas
        Lights that take part in MIS; lights that cannot. Lights without power are in neither.
    environment
        Infinite lights, which camera rays see where they leave the scene.
    parts
        The scene's parts, simplified. Their lights have power.
    removed_lights, removed_lobes
        Number of lights without power, and of black lobes, which are left out.
    unseen
        Sampled lights with a surface that no part has, so that the camera does not see it.
    headlights
        Positions in `deltas` of point lights at the pinhole: whatever the camera sees, they see, so camera hits
        need no shadow rays towards them.
    """

    def __init__(self, camera: Camera, parts: tuple[Part, ...], lights: tuple[Light, ...], epsilon: float) -> None:
        self.removed_lights = len(lights)
        guarded = ((id(light), checked(light, LIGHT_CHECKS)) for light in lights)
        live_lights: dict[int, Any] = {number: light for number, light in guarded if light.brightness(1.0) > 0}
        lights = tuple(live_lights[id(light)] for light in lights if id(light) in live_lights)
        self.removed_lights -= len(lights)
        self.sampled: tuple[SampledLight, ...] = tuple(light for light in lights if not light.delta)  # type: ignore[misc]
        self.deltas: tuple[DeltaLight, ...] = tuple(light for light in lights if light.delta)  # type: ignore[misc]
        self.environment: tuple[InfiniteLight, ...] = tuple(light for light in lights if light.infinite)  # type: ignore[misc]
        eye = camera.origin[:, 0]
        faded = any(part.mask is not None and part.mask.cutoff is None for part in parts)
        # through a mask that fades, a shadow ray may meet what the camera ray passed
        heads = () if faded or not camera.is_pinhole else enumerate(self.deltas)
        self.headlights = frozenset(k for k, light in heads if light.is_at(eye, 0.1 * epsilon))
        self._sampled: dict[str, tuple[SampledLight, ...]] = {}
        keys: dict[Any, dict[tuple[int, int], tuple[int, Material, AreaLight | None]]] = {}
        part_keys, part_rows = [], []
        materials = {id(part.material): part.material for part in parts}
        simplified = {number: simplify(material) for number, material in materials.items()}
        self.removed_lobes = sum(len(materials[k].lobes) - len(simplified[k].lobes) for k in materials)
        parts = tuple(
            replace(part, material=simplified[id(part.material)], light=live_lights.get(id(part.light)))
            for part in parts
        )
        self.parts = parts
        seen = {id(part.light) for part in parts}
        self.unseen = tuple(light for light in self.sampled if id(light) not in seen and light.mesh() is not None)
        for part in parts:
            key = batch_key(part)
            part_keys.append(key)
            members = keys.setdefault(key, {})
            member = members.setdefault((id(part.material), id(part.light)), (len(members), part.material, part.light))
            part_rows.append(member[0])
        live = [key for key in keys if key is not None]
        if len(live) >= NO_GROUP:
            raise ValueError(
                f"a scene may have at most {NO_GROUP - 1} groups of textured or different materials; got {len(live)}"
            )
        self.groups = tuple(make_group(key, [member[1:] for member in keys[key].values()]) for key in live)
        self.part_group = [NO_GROUP if key is None else live.index(key) for key in part_keys]
        triangles = [part.mesh.triangles for part in parts]
        # One entry more than there are triangles: the -1 of a miss reads the last one.
        self.face_group = np.repeat(np.array([*self.part_group, NO_GROUP], np.uint8), [*triangles, 1])
        self.face_row = np.repeat(np.array(part_rows, np.int32), triangles)

    def sampled_lights(self, lights: str, compensation: float) -> tuple[SampledLight, ...]:
        """Return what light samples are taken of: `sampled`, or one light in the place of many of them.

        Both arguments are settings of these names; the second is that of `InfiniteLight.compensated`.
        """
        if lights not in self._sampled:
            self._sampled[lights] = self._with_selections(lights)
        sampled = self._sampled[lights]
        if not self.environment:
            return sampled
        return tuple(light.compensated(compensation) if light.infinite else light for light in sampled)  # type: ignore[attr-defined]

    def prepare(self, lights: str, compensation: float) -> None:
        """Make the tables of all that light samples are taken of, so that threads need not."""
        deeper = ("tree",) if self.selects_deeper(lights) else ()
        for name in (lights, *deeper):
            self.sampled_lights(name, compensation)

    def selection(self, lights: str) -> str | None:
        """Return the name of the selection by which one of `many` is sampled; None: each has its own samples."""
        if lights == "auto":
            return "tree" if len(self.many) >= MANY_LIGHTS else None
        return lights if self.many and lights not in ("all", "one", "pbrt") else None

    @cached_property
    def many(self) -> dict[int, Pieces]:
        """Pieces of the lights that can be one of many, by `id`: area lights that hide what is behind them."""
        unseen = {id(light) for light in self.unseen}
        areas = (light for light in self.sampled if not light.infinite and id(light) not in unseen)
        pieces = {id(light): light.pieces() for light in areas}  # type: ignore[attr-defined]
        return {number: of_light for number, of_light in pieces.items() if of_light is not None}

    def selects_deeper(self, lights: str) -> bool:
        """Return whether a tree selects among `many` where a path has scattered; first, each has its own samples."""
        return lights == "auto" and self.selection(lights) is None and len(self.many) >= DEEPER_LIGHTS

    def selects_triangles(self, light: Light, lights: str) -> bool:
        """Return whether a light is sampled by a tree over its own triangles."""
        pieces = self.many.get(id(light)) if lights == "auto" and self.selection(lights) is None else None
        return pieces is not None and len(pieces.area) >= MANY_TRIANGLES

    def _with_selections(self, lights: str) -> tuple[SampledLight, ...]:
        """Return `sampled` with one light in the place of `many`, or of each that has many triangles."""
        name = self.selection(lights)
        if name is None and not any(self.selects_triangles(light, lights) for light in self.sampled):
            return self.sampled
        from dmis.light.selection import select_lights

        if name is not None:
            alone = (light for light in self.sampled if id(light) not in self.many)
            return (select_lights(name, list(self.many.values())), *alone)
        return tuple(
            select_lights("tree", [self.many[id(light)]]) if self.selects_triangles(light, lights) else light
            for light in self.sampled
        )

    @cached_property
    def has_light(self) -> bool:
        """Whether there is any light: without, all images are black."""
        return bool(self.sampled or self.deltas)

    @cached_property
    def has_visible_light(self) -> bool:
        """Whether there is a light that rays can meet."""
        return bool(self.environment) or any(group.emission is not None for group in self.groups)

    @cached_property
    def mixable(self) -> bool:
        """Whether there is anything to mix: a light that two techniques can reach from some surface."""
        return any(self.mixes(group, light) for group in self.groups for light in self.sampled)

    def mixes(self, group: Group, light: Light) -> bool:
        """Return whether MIS applies: the light has an extent, and the surface a lobe that is a function."""
        return bool(group.reflection or group.transmission) and not light.delta


def textures(material: Material) -> bool:
    """Return whether a material has relief, or an image that is not the same everywhere."""
    return material.relief is not None or (
        any(has_texture(lobe) for lobe in material.lobes) and any(has_texture(x) for x in simplify(material).lobes)
    )
