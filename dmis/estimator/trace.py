"""Tracing of camera samples: camera rays in, radiance out; the paths of a batch go on together, bounce by bounce.

Follow one camera sample: its ray meets a surface, whose emission counts; the surface reflects the lights
(`dmis.estimator.direct`); mirrors and glass send the sample on, to be shaded where it arrives; in path tracing every
surface does (`dmis.estimator.path`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from dmis.base.vectors import Array, Index, Selection, accumulate, compose, indices, size, take, take_optional
from dmis.estimator.batch import Batch, Vertices
from dmis.estimator.direct import add_direct_light
from dmis.estimator.path import Rays, bounce, merge, scatter
from dmis.intersect import UNTRACED, Hits
from dmis.scene.shading_points import ShadingPoints

POINTS = 2**17
"""Surface points of a group that are shaded at a time: many more take memory, and are not faster."""


def radiance(batch: Batch, origin: Array, direction: Array, coverage: Selection | None = None) -> Array:
    """Return the radiance along camera rays, by the settings' integrator.

    Parameters
    ----------
    origin, direction
        ``(3, N)`` float32, unit directions, in the order of `Batch.samples`.
    coverage
        Those that may meet something; None: all of them. The others are counted as `UNTRACED`.

    Returns
    -------
    ``(3, N)`` float32 linear RGB.
    """
    total = np.zeros(direction.shape, np.float32)
    traced = size(coverage, direction.shape[1])
    if traced < direction.shape[1]:
        every = np.arange(direction.shape[1])
        batch.caster.skip(UNTRACED, np.setdiff1d(every, take(every, coverage), assume_unique=True))
    if not traced:
        return total
    pending = [Rays(take(origin, coverage), take(direction, coverage), coverage, None, 0, ())]
    while pending:
        rays = pending.pop()
        following: list[Rays] = []
        for value, sample in _shade(batch, rays, following):
            accumulate(total, value, sample)
        if following and batch.settings.integrator == "path":
            pending.append(merge(following, direction.shape[1]))
        else:
            pending += following
    return total


def _shade(batch: Batch, rays: Rays, following: list[Rays]) -> Iterator[tuple[Array, Selection | None]]:
    """Trace rays and shade what they meet; yields radiance ``(3, K)`` and camera sample numbers ``(K,)``.

    Rays that continue the paths are appended to `following`.
    """
    scene, plan, path = batch.scene, batch.scene.plan, batch.settings.integrator == "path"
    kind = "camera"
    if rays.depth:
        kind = f"bounce {rays.depth}" if path else "specular"
    hits = batch.caster.closest(kind, rays.origin, rays.direction, rays.sample)
    group_of = plan.face_group.take(hits.prim)
    if plan.environment and rays.adds_emission is not False:
        yield from _sky(batch, rays, hits)
    last = rays.depth >= batch.settings.deepest
    for number, group in enumerate(plan.groups):
        emits = group.emission is not None and rays.adds_emission is not False
        if not emits and (last or not group.reflects):
            continue
        for index in point_chunks(indices(group_of == number), len(group_of)):
            surface, emission = scene.surfaces.shading_points(group, hits, index, rays.direction)
            sample, throughput = compose(rays.sample, index), take_optional(rays.throughput, index)
            # L_o = L_e + integral of f   (docs/theory.md, Eq. 1)
            out = np.zeros(surface.wo.shape, np.float32)
            if emits and emission is not None:
                out += emission * take(np.asarray(rays.adds_emission), index)
            if not last:
                # next-event estimation counted the emission that these rays meet: a lobe scattered them
                shows = rays.adds_emission
                scattered = not shows if isinstance(shows, bool) else ~take(shows, index)
                add_direct_light(batch, Vertices(surface, sample, throughput, rays.path, out, scattered))
            if throughput is not None:
                out *= throughput
            yield out, sample
            if path and not last:
                following += _path_ray(batch, rays, surface, sample, throughput)
            elif group.delta and not last:
                following += _delta_rays(batch, rays, surface, sample, throughput)


def point_chunks(index: Index | None, n: int) -> Iterator[Selection | None]:
    """Yield the selection `index` of n points (None: all) in parts of at most `POINTS`."""
    number = size(index, n)
    if number <= POINTS:
        if number:
            yield index
        return
    edges = np.linspace(0, number, -(-number // POINTS) + 1).astype(int).tolist()
    for begin, end in itertools.pairwise(edges):
        yield slice(begin, end) if index is None else index[begin:end]


def _sky(batch: Batch, rays: Rays, hits: Hits) -> Iterator[tuple[Array, Selection | None]]:
    """Yield the radiance of skies, which belong to no group, where rays miss everything."""
    missed = indices((hits.prim < 0) & rays.adds_emission)
    if missed is None or len(missed):
        for light in batch.scene.plan.environment:
            sky = light.radiance(take(rays.direction, missed))
            if rays.throughput is not None:
                sky = sky * take(rays.throughput, missed)
            yield sky, compose(rays.sample, missed)


def _path_ray(
    batch: Batch, rays: Rays, surface: ShadingPoints, sample: Selection | None, throughput: Array | None
) -> list[Rays]:
    """Return the rays with which paths go on from the points of one group, one per point; empty if they end."""
    ends = rays.depth + 1 >= batch.settings.deepest
    if ends and not (surface.delta and batch.scene.plan.has_visible_light):
        return []  # the light that one more surface would send was gathered here
    if not (surface.reflection or surface.transmission or surface.delta):
        return []
    u = batch.numbers.onward(rays.path, sample)
    continued = bounce(surface, sample, throughput, rays.depth, u, batch.numbers.rng, last=ends)
    return [] if continued is None else [continued]


def _delta_rays(
    batch: Batch, rays: Rays, surface: ShadingPoints, sample: Selection | None, throughput: Array | None
) -> Iterator[Rays]:
    """Yield the rays that mirrors and glass send on from the points of one group, for each delta lobe."""
    if rays.depth + 1 >= batch.settings.deepest:
        return
    for k, lobe in enumerate(surface.delta):
        origin, direction, factor = scatter(surface, lobe)
        if throughput is not None:
            factor = factor * throughput
        index = indices(factor.max(axis=0) > 0)
        if index is None or len(index):
            origin, direction, factor = (take(a, index) for a in (origin, direction, factor))
            yield Rays(origin, direction, compose(sample, index), factor, rays.depth + 1, (*rays.path, k))
