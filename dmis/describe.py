"""A scene's plan in words, as ``python -m dmis info`` prints it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from dmis.light import Light
from dmis.survey import MATTERS

if TYPE_CHECKING:
    from dmis.plan import Group, Plan


def describe(plan: Plan) -> str:
    """What there is, what it needs, how its light is sampled, what is left out, and what is recommended."""
    lines = [f"{len(plan.face_row):,} triangles"]
    left = len(plan.face_row)
    for k, group in enumerate(plan.groups):
        triangles = int((plan.face_group == k).sum())
        left -= triangles
        names = ", ".join(sorted({material.name for material in group.materials}))
        lobes = " + ".join(type(lobe).__name__ for lobe in (*group.glossy, *group.through, *group.delta)) or "no lobes"
        needs = ", ".join(name for name, needed in _needs((group,)) if needed) or "nothing else"
        lines.append(
            f"  group {k}: {len(group.materials)} x {names}: {lobes}; {triangles:,} triangles; needs {needs}; "
            f"{_sampling(plan, group)}"
        )
    if left:
        lines.append(f"  {left:,} triangles neither reflect nor emit: they only occlude")
    for light in plan.sampled:
        mixed = any(plan.mixes(group, light) for group in plan.groups)
        way = "two techniques, MIS" if mixed else "no surface to sample it for, outside MIS"
        lines.append(f"  {type(light).__name__}: {way}")
    for k, light in enumerate(plan.deltas):
        rays = ", at the pinhole: no shadow rays from camera hits" if k in plan.headlights else ""
        lines.append(f"  {type(light).__name__}: a single direction, outside MIS{rays}")
    if not plan.sampled:
        lines.append("  no light to sample by two techniques: MIS does not apply")
    lines.append(f"  left out: {'; '.join(_left_out(plan)) or 'nothing'}")
    return "\n".join([*lines, *_recommended(plan)])


def _needs(groups: Iterable[Group]) -> Iterator[tuple[str, bool]]:
    groups = tuple(groups)
    yield "textures", any(group.textured for group in groups)
    yield "interpolated normals", any(group.smooth for group in groups)
    yield "tangents", any(group.anisotropic for group in groups)
    yield "emission", any(group.emission is not None for group in groups)


def _sampling(plan: Plan, group: Group) -> str:
    """How the light that a group's surfaces reflect is found, kind of light by kind of light."""
    if not (group.glossy or group.through or group.delta):
        return "reflects nothing: no samples, paths end"
    if not (group.glossy or group.through):
        return "mirrored and refracted rays are followed: no light sampling, no MIS"
    mixed = _names(light for light in plan.sampled if plan.mixes(group, light))
    ways = [f"MIS of {mixed}"] if mixed else []
    if plan.deltas:
        ways.append(f"one sample of each {_names(plan.deltas)}, no BRDF sampling")
    if group.delta:
        ways.append("mirrored and refracted rays are followed")
    return "; ".join(ways) or "no light: no samples"


def _left_out(plan: Plan) -> Iterator[str]:
    """What nothing is spent on, and why."""
    if plan.dark:
        yield f"{plan.dark} without power of the lights"
    if plan.dropped:
        yield f"{plan.dropped} black of the lobes"
    needs = [*_needs(plan.groups), ("environment lookups", bool(plan.environment))]
    needs.append(("mirrored and refracted rays", any(group.delta for group in plan.groups)))
    unneeded = [name for name, needed in needs if not needed]
    if unneeded:
        yield f"{', '.join(unneeded)}, because nothing needs them"


def _recommended(plan: Plan) -> Iterator[str]:
    """The integrator, and what each costs."""
    found, (asked, _) = plan.survey, plan.asked
    says = f"about {found.indirect:.0%} of the light is indirect"
    if asked is None:
        compared = "at least" if found.indirect >= MATTERS else "less than"
        yield f"  recommended integrator: {plan.integrator}, because {says}, {compared} {MATTERS:.0%}"
    else:
        yield f"  recommended integrator: {asked}, as the scene asks, with max_depth {plan.depth(asked)}; {says}"
    for name, rays in found.rays.items():
        yield (
            f"  expected cost, {name}: {rays:.1f} rays per camera sample at w = 1/2, all in all the work of "
            f"{found.cost[name]:.1f} camera rays"
        )


def _names(lights: Iterable[Light]) -> str:
    """Kinds of lights, and how many of each."""
    count = Counter(type(light).__name__ for light in lights)
    return ", ".join(name if n == 1 else f"{n} x {name}" for name, n in count.items())
