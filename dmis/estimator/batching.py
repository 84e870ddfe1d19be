"""Batching: what makes the estimator fast, apart from what it computes.

Samples of a technique are merged or cut into batches whose arrays stay in the cache. Batches shrink as soon as
possible: only directions that meet a light on the reflecting side are evaluated, only those that would contribute are
traced. What is dropped is exactly zero. Where camera samples are in order, selections are slices, which copy nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from dmis.base.vectors import Array, Index, Selection, compose, indices, size, take
from dmis.estimator.allocation import Counts
from dmis.estimator.batch import Batch
from dmis.estimator.cost import ray_kind_of_colour
from dmis.estimator.samples import Samples, Vertices
from dmis.estimator.technique import SampledLight, technique_by_name
from dmis.light.light_sample import LightSample
from dmis.samplers.pixel_block import MORE
from dmis.samplers.streams import BlockSampler
from dmis.scene.shading_points import ShadingPoints

POINTS = 2**17
"""Surface points of a group that are shaded at a time: many more take memory, and are not faster."""
MERGED = 2**15
"""Largest merged batch, in shading samples: larger ones are slower than several, because they leave the cache."""
SHADOW_END = np.float32(1 - 1e-4)
"""Occlusion rays end a little before the light, whose own surface must not shadow it."""


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


def shading_samples(
    batch: Batch, vertices: Vertices, light: SampledLight, index: Selection | None, key: tuple[int, ...]
) -> Iterator[Samples]:
    """Yield S shading samples of each of the vertices `index`, divided between the techniques, in batches.

    Parameters
    ----------
    key
        Tells the random numbers of this light at these vertices apart from others.
    """
    settings = batch.settings
    camera_sample = compose(vertices.sample, index)
    counts = batch.counts
    per_technique = [count if isinstance(count, int) else take(count, camera_sample) for count in counts.per_technique]
    per_technique.append(settings.shading_samples - sum(per_technique))
    shares, tilt = take(batch.shares, camera_sample), take_optional(batch.tilt, camera_sample)
    n = size(index, vertices.radiance.shape[1])
    for k, (name, count) in enumerate(zip(settings.techniques, per_technique, strict=True)):
        if tilt is not None and not tilt[k].any():  # W_k = 0
            continue
        sampling = technique_by_name(name)
        ordered = not vertices.path and (k == 0 or len(per_technique) == 2)  # as camera samples are
        for merged in merged_samples(batch, count, n, ordered):
            u = [
                draw_numbers(batch, counts, (key, k, i), compose(camera_sample, points), sampling.numbers)
                for i, points in merged
            ]
            sample_index, points = merged[0]
            if len(merged) > 1:
                every = np.arange(n)
                points = np.concatenate([take(every, selection) for _, selection in merged])
            vertex = compose(index, points)
            surface = vertices.surface.take(vertex)
            seen = light.seen_from(surface.ng)
            light_sample = sampling.sample(surface, seen, u[0] if len(u) == 1 else np.concatenate(u, axis=1))
            tilt_of_samples = take_optional(tilt, points)
            yield Samples(k, sample_index, key, vertex, surface, light_sample, take(shares, points), tilt_of_samples)


def merged_samples(
    batch: Batch, count: Array | int, n: int, ordered: bool
) -> Iterator[list[tuple[int, Selection | None]]]:
    """Yield sample indices of a technique that n points sample `count` times, each with the points that have it.

    If they are `ordered`, counts only fall, or only rise. Sample indices of few points come together, to be one batch;
    but one by one where statistics tell them apart.
    """
    merged: list[tuple[int, Selection | None]] = []
    total, apart = 0, batch.records is not None or n == 1  # of a single point, `take` makes a constant
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


def draw_numbers(
    batch: Batch,
    counts: Counts,
    place: tuple[tuple[int, ...], int, int],
    camera_sample: Selection | None,
    numbers: int = 2,
) -> Array:
    """Draw uniform numbers for one shading sample of each of the camera samples, ``(numbers, N)``.

    Structured samplers spread the numbers of a pixel over all its samples of one technique, so where counts are
    uneven, a sample's place in its technique's sequence is the number of samples before it.

    Parameters
    ----------
    place
        Key of light and path, technique index, sample index.
    """
    key, k, i = place
    if numbers > 2:
        parts = [draw_numbers(batch, counts, (key, k, i), camera_sample) for key in (key, (*key, MORE))]
        return np.concatenate(parts)[:numbers]
    if counts.samples_before is None:
        count = counts.of_every_camera_sample(k, batch.settings.shading_samples)
        if count is not None and isinstance(batch.sampler, BlockSampler):
            return batch.sampler.draw_block((*key, k), camera_sample, i, count)
        return batch.sampler.draw((*key, k, i), camera_sample)
    return batch.sampler.draw((*key, k), camera_sample, take(counts.samples_before[k], camera_sample) + i)


def facing_light(surface: ShadingPoints, light_sample: LightSample) -> Index | None:
    """Return the indices of directions that meet the light and for which f may be positive; None: all."""
    if 2 * np.count_nonzero(light_sample.emits) < len(light_sample.emits):  # few, as of BRDF samples and a small light
        met = np.flatnonzero(light_sample.emits)
        return met[surface.take(met).same_side(take(light_sample.wi, met))]
    return indices(light_sample.emits & surface.same_side(light_sample.wi))


def unoccluded(
    batch: Batch, kind: str, origin: Array, wi: Array, distance: Array, sample: Selection | None
) -> np.ndarray:
    """Return V, whether nothing occludes the light from the points, ``(N,)`` bool.

    Rays are counted as `kind`, and as those of the camera samples `sample`.
    """
    count_rays(batch, kind, wi.shape[1], sample)
    return ~batch.caster.occluded(origin, wi, np.broadcast_to(distance * SHADOW_END, wi.shape[1:]))


def count_rays(batch: Batch, kind: str, number: int, sample: Selection | None) -> None:
    """Count so many rays of a kind, one for each of the camera samples `sample`, by colour where a rule asks for it."""
    batch.rays[kind] += number
    if batch.colour is not None:
        for colour, n in enumerate(np.bincount(take(batch.colour, sample)).tolist()):
            batch.rays[ray_kind_of_colour(kind, colour)] += n


def take_optional(values: Array | None, index: Selection | None) -> Array | None:
    """Return `take` of the values; None if they are None."""
    return None if values is None else take(values, index)


def accumulate(total: Array, value: Array, index: Selection | None) -> None:
    """Add `value` ``(3, K)`` to the columns `index` of `total` (None: all of them), repeated ones included."""
    if index is None or isinstance(index, slice):
        total[:, index or slice(None)] += value
        return
    for row, values in zip(total, value, strict=True):
        np.add.at(row, index, values)
