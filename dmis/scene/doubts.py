"""Doubts about a scene: what float32 does not tell apart, such as lamps in one place, and lights behind glass alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.materials import Material
from dmis.geometry.refinement import diagonals
from dmis.intersect import RayCaster
from dmis.light.coincident import find_overlaps, lamp_triangles
from dmis.samplers.warp import square_to_sphere
from dmis.scene.groups import Part
from dmis.scene.plan import Plan

MAX_OFFSET = 1e-3
"""Largest ray offset beside a small body, in sizes of the body, that passes without a warning."""


def lamp_doubts(parts: Sequence[Part], plan: Plan, caster: RayCaster, reach: float) -> Iterator[str]:
    """Yield a message about the first lamp that is nearer to a surface than `reach`; a ValueError if two overlap.

    Parameters
    ----------
    parts, plan, caster
        Those of the scene.
    reach
        Two ray offsets: a surface within one gets no light, and some up to another.
    """
    lights = [part.light for part in plan.parts]
    names = [
        f"part {k} ({part.material.name if light is None else type(light).__name__})"
        for k, (part, light) in enumerate(zip(parts, lights, strict=True))
    ] + [f"a {type(light).__name__} without a part" for light in plan.unseen]
    unseen = [Part(mesh, Material(()), light) for light in plan.unseen if (mesh := light.mesh()) is not None]  # type: ignore[arg-type]
    triangles, _, owner = lamp_triangles([*plan.parts, *unseen])
    number, prim = find_overlaps(caster, triangles, reach)
    met = np.searchsorted(np.cumsum([part.mesh.triangles for part in parts]), prim, side="right")
    pairs, first = np.unique(np.stack([owner[number], met]), axis=1, return_index=True)
    near = []
    for lamp, other, k in zip(*pairs.tolist(), number[first].tolist(), strict=True):
        place = f"at {tuple(np.round(triangles[k].mean(axis=0), 6).tolist())}"
        if lights[other] is None:
            near.append(f"{names[lamp]} is nearer to {names[other]} than {reach:.2g}, {place}")
        elif lamp < len(parts) and lights[other] is not lights[lamp]:
            raise ValueError(
                f"lamps must not overlap, because a ray meets only one of them; got {names[lamp]} and {names[other]} "
                f"in one place {place}. Move one, cut them, leave out one of equal ones, or make them opposite"
            )
    if near:
        more = f" (and {len(near) - 1} more such pairs)" if len(near) > 1 else ""
        yield f"{near[0]}{more}: rays begin above the light, which gives no light there; move it farther away"


def point_light_doubts(plan: Plan, caster: RayCaster) -> Iterator[str]:
    """Yield a message about each point of light of which all light meets smooth glass or mirrors first.

    No shadow ray passes these, and no path that comes through them meets a point: the light is lost. It is sampled at
    512 places around, so that of a spot only those count where it shines, and of a narrow one none.

    Parameters
    ----------
    plan, caster
        Those of the scene.
    """
    smooth = [bool(part.material.lobes) and all(lobe.delta for lobe in part.material.lobes) for part in plan.parts]
    of_face = np.repeat([*smooth, False], [*(part.mesh.triangles for part in plan.parts), 1])  # the last: of a miss
    u = (np.indices((16, 32), np.float32).reshape(2, -1) + np.float32(0.5)) / np.array([[16], [32]], np.float32)
    directions = square_to_sphere(u)
    for light in plan.deltas if any(smooth) else ():
        for name in light.positions or ():
            place = np.asarray(getattr(light, name), np.float32)[:, None]
            lit = light.sample(place + directions, u).radiance.any(axis=0)
            prim = caster.closest(np.broadcast_to(place, directions.shape), directions).prim
            if lit.any() and of_face[prim[lit]].all():
                yield (
                    f"only smooth glass and mirrors are around a {type(light).__name__} at {place[:, 0].tolist()}: it "
                    "lights nothing, because no shadow ray passes them; write a small SphereLight, with paths"
                )


def offset_doubts(parts: Sequence[Part], small: Array, epsilon: Array) -> Iterator[str]:
    """Yield a message about the one of the bodies `small` ``(B, 2, 3)`` beside which rays begin farthest off.

    That is the largest of the ray offsets `epsilon`, ``(T,)`` if there are any such bodies, in sizes of the body, if
    above `MAX_OFFSET`.
    """
    if not len(small):
        return
    sizes = diagonals(small)
    far = np.flatnonzero(epsilon > MAX_OFFSET * sizes.min())
    corners = np.concatenate([part.mesh.vertices[part.mesh.faces] for part in parts])[far]
    low, high = corners.min(axis=1), corners.max(axis=1)
    near = ((low <= most + size) & (high >= least - size) for (least, most), size in zip(small, sizes, strict=True))
    offsets = np.array([epsilon[far[mask.all(axis=1)]].max(initial=0) for mask in near]) / sizes
    k = int(np.argmax(offsets))
    if offsets[k] > MAX_OFFSET:
        bounds = [part.mesh.bounds for part in parts]
        inside = [(low <= small[k, 0]).all() and (high >= small[k, 1]).all() for low, high in bounds]
        yield (
            f"rays begin {offsets[k]:.2g} times the size of a body off the surfaces around it (part "
            f"{inside.index(True)}): shadows and gaps below that are lost. Make the triangles there smaller, or "
            f"leave out what is far away"
        )
