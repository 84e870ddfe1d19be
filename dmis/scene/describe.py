"""A scene's plan in words, as ``python -m dmis info`` prints it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from dmis.light.light import Light
from dmis.scene.groups import Group
from dmis.scene.plan import Plan


def describe_plan(plan: Plan, unread: Sequence[str] = ()) -> str:
    """Return a scene's groups and lights in words, what is left out, and what is `unread` in its file."""
    lines = [f"{len(plan.face_row):,} triangles"]
    left = len(plan.face_row)
    for k, group in enumerate(plan.groups):
        triangles = int((plan.face_group == k).sum())
        left -= triangles
        names = ", ".join(sorted({material.name for material in group.materials}))
        lobes = " + ".join(type(lobe).__name__ for lobe in (*group.reflection, *group.transmission, *group.delta))
        costs = group.textured, group.smooth, group.anisotropic, group.emission is not None
        named = zip(("textures", "interpolated normals", "tangents", "emission"), costs, strict=True)
        needs = ", ".join(name for name, needed in named if needed) or "nothing else"
        lines.append(
            f"  group {k}: {len(group.materials)} x {names}: {lobes or 'no lobes'}; {triangles:,} triangles; "
            f"needs {needs}; {_sampling(plan, group)}"
        )
    if left:
        lines.append(f"  {left:,} triangles neither reflect nor emit: they only occlude")
    selection = plan.selection("auto")
    if selection is not None:
        count = sum(len(pieces.area) for pieces in plan.many.values())
        lines.append(
            f"  {len(plan.many):,} lights are sampled as one: a {selection} selects one of their {count:,} pieces"
        )
    for light in plan.sampled:
        if selection is not None and id(light) in plan.many:
            continue
        mixed = any(plan.mixes(group, light) for group in plan.groups)
        way = "two techniques, MIS" if mixed else "no surface to sample it for, outside MIS"
        tree = ", a tree selects the triangle of a sample" if plan.selects_triangles(light, "auto") else ""
        lines.append(f"  {type(light).__name__}: {way}{tree}")
    if plan.selects_deeper("auto"):
        lines.append(f"  by paths, after the first scattering: a tree selects one of {len(plan.many)} area lights")
    if plan.unseen:
        lines.append(f"  no part has the surface of {_names(plan.unseen)}: invisible to the camera")
    for k, delta in enumerate(plan.deltas):
        rays = ", at the pinhole: no shadow rays from camera hits" if k in plan.headlights else ""
        lines.append(f"  {type(delta).__name__}: a single direction, outside MIS{rays}")
    if not plan.has_light:
        lines.append("  no light emits: images are black")
    elif not plan.mixable:
        lines.append("  nothing to mix: no light can be reached by two techniques, so rules learn no shares")
    if unread:
        lines.append(f"  not read from the file: {', '.join(unread)}")
    for number, what in ((plan.removed_lights, "lights that emit"), (plan.removed_lobes, "lobes that reflect")):
        if number:
            lines.append(f"  left out: {number} {what} nothing")
    return "\n".join(lines)


def describe_source(source: Mapping[str, Any]) -> Iterator[str]:
    """Yield lines about how a scene's file was read, see `dmis.scene.scene.Scene`."""
    if "bounds" in source:
        low, high = (", ".join(f"{x:.4g}" for x in source["bounds"][k : k + 3]) for k in (0, 3))
        yield f"  from ({low}) to ({high}), {source['up']} is up"
    if "cameras" in source:
        yield f"  cameras of the file, the default first: {', '.join(source['cameras'])}"
    if "lit" in source:
        yield f"  lit by {source['lit']}"
    if "added" in source:
        yield f"  added to the file: {'; '.join(source['added'])}"
    if "dialect" in source:
        yield f"  dialect of pbrt: {source['dialect']}, from: {source['dialect_from']}"
    if found := source.get("quadrics"):
        shapes = "sphere, cylinder or disk" if found["shapes"] == 1 else "spheres, cylinders and disks"
        yield (
            f"  {found['shapes']:,} {shapes}: {found['triangles']:,} triangles, off by at most "
            f"{max(found['pixels'], found['lamp_pixels']):.2g} pixels of this camera"
        )


def _sampling(plan: Plan, group: Group) -> str:
    """Return how the light that a group's surfaces reflect is sampled, kind of light by kind of light."""
    if not (group.reflection or group.transmission or group.delta):
        return "reflects nothing: no samples, paths end"
    if not (group.reflection or group.transmission):
        return "mirrored and refracted rays are followed: no light sampling, no MIS"
    mixed = _names(light for light in plan.sampled if plan.mixes(group, light))
    ways = [f"MIS of {mixed}"] if mixed else []
    if plan.deltas:
        ways.append(f"one sample of each {_names(plan.deltas)}, no BRDF sampling")
    if group.delta:
        ways.append("mirrored and refracted rays are followed")
    return "; ".join(ways) or "no light: no samples"


def _names(lights: Iterable[Light]) -> str:
    """Return kinds of lights, and how many of each."""
    count = Counter(type(light).__name__ for light in lights)
    return ", ".join(name if n == 1 else f"{n} x {name}" for name, n in count.items())
