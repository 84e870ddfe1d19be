"""Draws: which light the vertices of a batch sample, which of the vertices, and the shading samples that they take.

All that decides *who samples what* is here: all lights or one that is picked, the lamps that a light tree selects among
where paths have scattered, lights that only a subset of the camera samples looks at, lights whose occlusion is known,
and the far side of surfaces that light comes through. What an estimate is made of is in `dmis.estimator.direct`.

A technique's shading samples come in batches whose arrays stay in the cache: those that few vertices take are merged.
Where camera samples are in order, selections are slices, which copy nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.base.vectors import Array, Index, Selection, compose, indices, size, take, take_optional
from dmis.estimator.batch import Batch, Samples, Vertices
from dmis.light.light import SampledLight

if TYPE_CHECKING:
    from dmis.estimator.patterns import LightSubsets

MERGED = 2**15
"""Largest merged batch, in shading samples: larger ones are slower than several, because they leave the cache."""


@dataclass(eq=False)
class Draw:
    """A light that some of the vertices sample.

    Attributes
    ----------
    light
        A `dmis.light.light.SampledLight` or a `dmis.light.light.DeltaLight`.
    vertices, index
        The vertices, whose radiance is added to, and which of them sample the light; None: all.
    key
        Tells the random numbers of this light at these vertices apart from others.
    over_probability
        1 / P(light): a light that is picked with probability 1 / n stands for n.
    traced
        Whether its occlusion is found by a ray; otherwise nothing is in between.
    """

    light: Any
    vertices: Vertices
    index: Selection | None
    key: tuple[int, ...]
    over_probability: np.float32
    traced: bool = True


def draws(batch: Batch, vertices: Vertices) -> Iterator[Draw]:
    """Yield what the vertices sample: on the side of wo, and on the other side of surfaces that light comes through.

    The lights may be others where their paths have scattered before.
    """
    plan = batch.scene.plan
    settings = batch.settings
    lights = plan.sampled_lights(settings.lights, settings.sky_compensation)
    sampled: list[tuple[tuple[SampledLight, ...], Index | None]] = [(lights, None)]
    if vertices.scattered is not False and plan.selects_deeper(settings.lights):
        selected = plan.sampled_lights("tree", settings.sky_compensation)
        scattered = np.broadcast_to(vertices.scattered, vertices.radiance.shape[1])
        parts = (selected, scattered), (lights, ~scattered)
        sampled = [(some, indices(here)) for some, here in parts if here.any()]
    surface = vertices.surface
    for some, where in sampled if surface.reflection else ():
        yield from _draws_of_lights(batch, vertices, False, some, where)
    if surface.transmission:
        vertices = replace(vertices, surface=surface.beyond())
        for some, where in sampled:
            yield from _draws_of_lights(batch, vertices, True, some, where)


def _draws_of_lights(
    batch: Batch, vertices: Vertices, beyond: bool, sampled: tuple[SampledLight, ...], where: Index | None
) -> Iterator[Draw]:
    """Yield draws of `sampled` and delta lights at the vertices `where`: of all, or of one picked for each vertex."""
    plan, lights = batch.scene.plan, (*sampled, *batch.scene.plan.deltas)
    picked = None
    if batch.settings.one_light and len(lights) > 1:
        u = batch.numbers.light((*vertices.path, int(beyond)), vertices.sample)
        picked = (u * np.float32(len(lights))).astype(np.int16)
    over_probability = np.float32(1 if picked is None else len(lights))
    first_surface = not vertices.path
    for number, light in enumerate(lights):
        index = where if picked is None else indices(picked == number)
        key = (*vertices.path, number + len(lights) * beyond)
        is_headlight = first_surface and number - len(sampled) in plan.headlights
        draw = Draw(light, vertices, index, key, over_probability, traced=not is_headlight)
        if batch.samples.subsets is not None and first_surface and not beyond:
            # delta lights share the last place
            yield from _of_subset(batch.samples.subsets, min(number, len(sampled)), draw)
        elif index is None or len(index):
            yield draw


def _of_subset(subsets: LightSubsets, light: int, draw: Draw) -> Iterator[Draw]:
    """Yield a draw of the camera samples that sample the light, and add what they reflect with their weight."""
    vertices = draw.vertices
    subset = subsets.of_light(light, vertices.sample)
    if subset is None:
        yield draw
        return
    index, weight, block = subset
    if len(index):
        apart = replace(vertices, radiance=np.zeros_like(vertices.radiance))
        yield replace(draw, vertices=apart, index=index)
        # sum of f / p_w over all m camera samples of a pixel ~ m / m' times that over the m' of the subset
        reflected = apart.radiance.take(index, axis=1) * weight
        subsets.radiance[block, :, compose(vertices.sample, index)] += reflected.T


def shading_samples(batch: Batch, draw: Draw) -> Iterator[Samples]:
    """Yield S shading samples of each vertex of a draw, divided between the techniques, in batches."""
    vertices, samples = draw.vertices, batch.samples
    camera_sample = compose(vertices.sample, draw.index)
    shares = take(samples.shares, camera_sample)
    tilt = take_optional(samples.tilt, camera_sample)
    n = size(draw.index, vertices.radiance.shape[1])
    for k, technique in enumerate(batch.techniques):
        if tilt is not None and not tilt[k].any():  # W_k = 0
            continue
        counts = samples.counts[k]
        before = None if samples.samples_before is None else samples.samples_before[k]
        count = counts if isinstance(counts, int) else take(counts, camera_sample)
        # vertices that camera rays meet are in the order of the camera samples, whose counts of the first fall
        ordered = not vertices.path and (k == 0 or len(batch.techniques) == 2)
        for merged in merged_samples(batch, count, n, ordered):
            u = [
                batch.numbers.direction(
                    (*draw.key, k), i, compose(camera_sample, points), counts, before, technique.numbers
                )
                for i, points in merged
            ]
            sample_index, points = merged[0]
            if len(merged) > 1:
                every = np.arange(n)
                points = np.concatenate([take(every, selection) for _, selection in merged])
            vertex = compose(draw.index, points)
            surface = vertices.surface.take(vertex)
            shares_of_points, tilt_of_points = take(shares, points), take_optional(tilt, points)
            light = draw.light.seen_from(surface.ng) if draw.light.needs_normals else draw.light
            light_sample = technique.sample(surface, light, u[0] if len(u) == 1 else np.concatenate(u, axis=1))
            yield Samples(k, sample_index, draw.key, vertex, surface, light_sample, shares_of_points, tilt_of_points)


def merged_samples(
    batch: Batch, count: Array | int, n: int, ordered: bool
) -> Iterator[list[tuple[int, Selection | None]]]:
    """Yield sample indices of a technique that n points sample `count` times, each with the points that have it.

    If they are `ordered`, counts only fall, or only rise. Sample indices of few points come together, to be one batch;
    but one by one where statistics tell them apart.
    """
    merged: list[tuple[int, Selection | None]] = []
    total = 0
    apart = batch.records is not None or n == 1  # of a single point, `take` makes a constant
    for i in range(batch.settings.shading_samples):
        points: Selection | None
        if isinstance(count, int):
            points = None if i < count else slice(0, 0)
        else:
            points = prefix_or_suffix(count > i) if ordered else indices(count > i)
        number = size(points, n)
        if number == 0:
            break
        if merged and (apart or total + number > MERGED):
            yield merged
            merged, total = [], 0
        merged.append((i, points))
        total += number
    if merged:
        yield merged


def prefix_or_suffix(condition: np.ndarray) -> slice | None:
    """Return the beginning or the end where `condition` holds; None if it holds everywhere."""
    length, number = len(condition), np.count_nonzero(condition)
    if number == length:
        return None
    return slice(0, number) if condition[0] else slice(length - number, length)
