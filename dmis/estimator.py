"""Direct lighting and path tracing: camera rays in, radiance out, one batch per bounce.

Follow one camera sample: its ray meets a surface (`radiance`); each light is sampled by two techniques or more, S
shading samples in all (`_mixture`); a shading sample is a direction, the BRDF and the light's radiance there, a
weight, and an occlusion ray (`_shade`). Mirrors and glass send the sample on, to be shaded where it arrives; in path
tracing every surface does (`dmis.bounce`).

The radiance reflected at p towards wo is the integral over wi of ``f = f_r(wo, wi) L(wi) |n.wi| V(wi)``. With
densities p_l (light sampling), p_b (BRDF sampling) and the share w of light samples, the balance heuristic estimates
it by the mean over shading samples of ``f / p_w``, ``p_w = w p_l + (1 - w) p_b`` (Veach 1997, chapter 9).

Batches shrink as soon as possible: only directions that meet a light and can reflect it are evaluated, only those that
would contribute are traced. What is dropped is exactly zero.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dmis import mis, technique
from dmis.batch import Batch, Record
from dmis.bounce import Rays, bounce, merge, scatter
from dmis.cost import UNSEEN
from dmis.light import DeltaLight, Seen
from dmis.mis import Counts, Heuristic
from dmis.pair import Pair
from dmis.surface import Surface
from dmis.technique import SampledLight, Technique
from dmis.vec import Array, Index, Selection, compose, dot, indices, size, take

SHADOW_END = np.float32(1 - 1e-4)
"""Occlusion rays end a little before the light, whose own surface must not shadow it."""
POINTS = 2**17
"""Surface points of a group that are shaded at a time: many more take memory, and are not faster."""
TOGETHER = 2**15
"""Shading samples up to which several turns of a technique are one batch: more are faster apart, in the cache."""
MORE, CONTINUE = -1, -2
"""In the place of a light's number these tell apart random numbers beyond a sample's first two, and those of paths."""


@dataclass(eq=False)
class _Points:
    """Surface points of one group, and where what they reflect goes.

    Attributes
    ----------
    sample
        Camera sample numbers, ``(N,)``; None: all, in order.
    throughput
        What their light will be multiplied by on the way to the camera, ``(3, N)``; None: nothing.
    path
        Delta lobes that led here, to tell the random numbers apart.
    out
        Radiance reflected, ``(3, N)``, added to.
    beyond
        Whether the light comes from beyond the surface, see `Surface.beyond`.
    """

    surface: Surface
    sample: Selection | None
    throughput: Array | None
    path: tuple[int, ...]
    out: Array
    beyond: bool = False


def radiance(batch: Batch, origin: Array, direction: Array, seeing: Selection | None = None) -> Array:
    """Radiance along camera rays, by the settings' integrator.

    Parameters
    ----------
    origin, direction
        ``(3, N)`` float32, unit directions; sample-major, see `dmis.samplers`.
    seeing
        Those that may meet something; None: all of them. The others are counted as `UNSEEN`.

    Returns
    -------
    ``(3, N)`` float32 linear RGB.
    """
    found = np.zeros(direction.shape, np.float32)
    traced = size(seeing, direction.shape[1])
    batch.rays["camera"] += traced
    if traced < direction.shape[1]:
        batch.rays[UNSEEN] += direction.shape[1] - traced
    if not traced:
        return found
    pending = [Rays(take(origin, seeing), take(direction, seeing), seeing, None, 0, ())]
    while pending:
        rays = pending.pop()
        onward: list[Rays] = []
        for part in _visit(batch, rays, onward):
            _add(found, *part)
        if onward and batch.settings.integrator == "path":
            pending.append(merge(onward, direction.shape[1]))
        else:
            pending += onward
    return found


def _visit(batch: Batch, rays: Rays, onward: list[Rays]) -> Iterator[tuple[Array, Selection | None]]:
    """Trace rays and shade what they meet; yields radiance ``(3, K)`` and camera sample numbers ``(K,)``.

    Rays that go on are appended to `onward`.
    """
    scene, plan, settings = batch.scene, batch.scene.plan, batch.settings
    hits = batch.caster.closest(rays.origin, rays.direction)
    if rays.depth:
        kind = f"bounce {rays.depth}" if settings.integrator == "path" else "specular"
        batch.rays[kind] += len(hits.prim)
    group_of = plan.face_group.take(hits.prim)
    if plan.environment and rays.sees is not False:
        missed = indices((hits.prim < 0) & rays.sees)
        if missed is None or len(missed):
            for light in plan.environment:
                radiance = light.radiance(take(rays.direction, missed))
                if rays.throughput is not None:
                    radiance = radiance * take(rays.throughput, missed)
                yield radiance, compose(rays.sample, missed)
    last = rays.depth >= settings.deepest
    for number, group in enumerate(plan.groups):
        shines = group.emission is not None and rays.sees is not False
        if not shines and (last or not group.reflects):
            continue
        for index in _parts(indices(group_of == number), len(group_of)):
            surface, emission = scene.surface(group, hits, index, rays.direction)
            sample, throughput = compose(rays.sample, index), _take(rays.throughput, index)
            out = np.zeros(surface.wo.shape, np.float32)
            if shines and emission is not None:
                out += emission if rays.sees is True else emission * take(np.asarray(rays.sees), index)
            if group.glossy and not last:
                _light(batch, _Points(surface, sample, throughput, rays.path, out))
            if group.through and not last:
                far = surface.beyond()
                _light(batch, _Points(far, sample, throughput, rays.path, out, beyond=True))
            if throughput is not None:
                out *= throughput
            yield out, sample
            if not last:
                onward += _continue(batch, rays, surface, sample, throughput)


def _parts(index: Index | None, n: int) -> Iterator[Selection | None]:
    """The selection `index` of n points (None: all), at most `POINTS` at a time."""
    number = size(index, n)
    if number <= POINTS:
        if number:
            yield index
        return
    edges = np.linspace(0, number, -(-number // POINTS) + 1).astype(int).tolist()
    for begin, end in itertools.pairwise(edges):
        yield slice(begin, end) if index is None else index[begin:end]


def _continue(
    batch: Batch, rays: Rays, surface: Surface, sample: Selection | None, throughput: Array | None
) -> Iterator[Rays]:
    """The rays that go on from the points of one group: one per point in path tracing, else one per delta lobe."""
    settings = batch.settings
    ends = rays.depth + 1 >= settings.deepest
    if settings.integrator == "path":
        if ends and not (surface.delta and batch.scene.plan.visible):
            return  # the light that one more surface would send was gathered here
        if not (surface.glossy or surface.through or surface.delta):
            return
        u = batch.sampler.draw((*rays.path, CONTINUE), sample)
        following = bounce(surface, sample, throughput, rays.depth, u, batch.rng, last=ends)
        if following is not None:
            yield following
        return
    for k, lobe in enumerate(surface.delta if not ends else ()):
        origin, direction, factor = scatter(surface, lobe)
        if throughput is not None:
            factor = factor * throughput
        index = indices(factor.max(axis=0) > 0)
        if index is None or len(index):
            origin, direction, factor = (take(a, index) for a in (origin, direction, factor))
            yield Rays(origin, direction, compose(sample, index), factor, rays.depth + 1, (*rays.path, k))


def _light(batch: Batch, points: _Points) -> None:
    """Add the light that the points reflect, from all lights or from one picked for each point."""
    plan = batch.scene.plan
    lights = (*plan.sampled, *plan.deltas)
    picked = None
    if batch.settings.lights == "one" and len(lights) > 1:
        picked = batch.rng.integers(len(lights), size=points.out.shape[1], dtype=np.int16)
    for k, light in enumerate(lights):
        index = None if picked is None else indices(picked == k)
        if index is not None and len(index) == 0:
            continue
        scale = np.float32(1 if picked is None else len(lights))
        if light.delta:
            eye = not points.path and k - len(plan.sampled) in plan.headlights
            _delta(batch, points, light, index, scale, traced=not eye)  # type: ignore[arg-type]
        else:
            key = (*points.path, k + len(lights) * points.beyond)
            _mixture(batch, points, light, index, scale, key)  # type: ignore[arg-type]


def _mixture(
    batch: Batch, points: _Points, light: SampledLight, index: Selection | None, scale: np.float32, key: tuple[int, ...]
) -> None:
    """Add what the points `index` reflect of one light: S shading samples each, divided between techniques."""
    settings = batch.settings
    techniques = tuple(technique.find(name) for name in settings.techniques)
    heuristic = mis.find(settings.combiner)
    sample = compose(points.sample, index)
    w, counts = batch.division(points.path)
    each = [count if isinstance(count, int) else take(count, sample) for count in counts.each]
    each.append(settings.shading_samples - sum(each))
    w, control = take(w, sample), _take(batch.control, sample)
    n = size(index, points.out.shape[1])
    for side, (own, count) in enumerate(zip(techniques, each, strict=True)):
        ordered = not points.path and (side == 0 or len(each) == 2)  # as camera samples are
        for turns in _turns(batch, count, n, ordered):
            u = [_draw(batch, counts, key, side, turn, compose(sample, those), own.numbers) for turn, those in turns]
            chosen = turns[0][1] if len(turns) == 1 else _joined(n, *(those for _, those in turns))
            where = compose(index, chosen)
            part = points.surface.take(where)
            seen = own.sample(part, light, u[0] if len(u) == 1 else np.concatenate(u, axis=1))
            share, turn = take(w, chosen), turns[0][0]
            found = _shade(batch, points, part, where, seen, techniques, side, turn, share, heuristic, scale, key)
            if control is not None:
                beta = take(control, chosen) * (scale / np.float32(settings.shading_samples))
                _add(points.out, -beta * _control(side, share, part.p.shape[1], *found), where)


def _turns(batch: Batch, count: Array | int, n: int, ordered: bool) -> Iterator[list[tuple[int, Selection | None]]]:
    """Each turn of a technique that n points take `count` times, and which of them take it.

    If they are `ordered`, counts only fall, or only rise. Turns of few points come together, to be one batch; but one
    by one where statistics tell them apart.
    """
    together: list[tuple[int, Selection | None]] = []
    total, apart = 0, batch.records is not None or n == 1  # of a single point, `take` makes a constant
    for turn in range(batch.settings.shading_samples):
        those: Selection | None
        if isinstance(count, int):
            those = None if turn < count else slice(0, 0)
        else:
            those = _run(count > turn) if ordered else indices(count > turn)
        number = size(those, n)
        if number == 0:
            break
        if together and (apart or total + number > TOGETHER):
            yield together
            together, total = [], 0
        together.append((turn, those))
        total += number
    if together:
        yield together


def _joined(n: int, *selections: Selection | None) -> Index:
    """Selections from n points, one after the other."""
    every = np.arange(n)
    return np.concatenate([take(every, selection) for selection in selections])


def _draw(
    batch: Batch, counts: Counts, key: tuple[int, ...], side: int, turn: int, points: Selection | None, numbers: int = 2
) -> Array:
    """Numbers for one shading sample of the camera samples `points`, ``(numbers, N)``.

    Structured samplers spread the numbers of a pixel over all its samples of one technique, so where techniques take
    turns unevenly, each sample takes the place in its technique's sequence that its pixel has reached.
    """
    if numbers > 2:
        parts = [_draw(batch, counts, k, side, turn, points) for k in (key, (*key, MORE))]
        return np.concatenate(parts)[:numbers]
    if counts.reached is None:
        return batch.sampler.draw((*key, side, turn), points)
    return batch.sampler.draw((*key, side), points, take(counts.reached[side], points) + turn)


def _shade(
    batch: Batch,
    points: _Points,
    surface: Surface,
    where: Selection | None,
    seen: Seen,
    techniques: tuple[Technique, ...],
    side: int,
    turn: int,
    w: Array,
    heuristic: Heuristic,
    scale: np.float32,
    key: tuple[int, ...],
) -> tuple[Index | None, list[Array]]:
    """Add one shading sample of the technique `side` to each of the points `where`, whose surface is given.

    Returns which of them have a direction that meets a light, and the densities of all techniques there.
    """
    lit = _lit(surface, seen)
    if lit is not None and len(lit) == 0:
        return lit, [np.zeros(0, np.float32)] * len(techniques)
    surface, wi, w = surface.take(lit), take(seen.wi, lit), take(w, lit)
    light_pdf, distance = take(seen.pdf, lit), take(seen.distance, lit)
    pair = Pair(surface, wi)
    pdf = [each.pdf(surface, pair, light_pdf) for each in techniques]
    shares = mis.against(batch.settings.combiner, mis.shares(w), side)
    factor = heuristic([share * p for share, p in zip(shares, pdf, strict=True)], side) * pair.cos_i
    factor *= scale / np.float32(batch.settings.shading_samples)
    accepted = pdf[side] > 0  # others are as if they had met no light
    f = surface.eval(pair) * (factor * accepted)
    alive: Selection | None = indices((f if len(f) == 1 else f.max(axis=0, keepdims=True))[0] > 0)
    value = np.zeros((3, 0), np.float32)
    if size(alive, 1):
        way = take(surface.p, alive), take(wi, alive), take(distance, alive)
        clear = indices(_visible(batch, techniques[side].rays, *way))
        alive = compose(alive, clear)  # the sky is looked up only where it is seen
        both = compose(lit, alive)
        value = take(f, alive) * seen.radiance_at(both)
        _add(points.out, value, compose(where, both))
    if batch.records is None and batch.control is None:
        return lit, pdf
    pdf = [np.where(accepted, p, np.float32(k == side)) for k, p in enumerate(pdf)]
    if batch.records is not None:
        _record(batch, points, Record(side, key, turn, compose(where, lit), value, np.stack(pdf)), alive)
    return lit, pdf


def _lit(surface: Surface, seen: Seen) -> Index | None:
    """Which directions meet the light, and leave the triangle on the side that is seen."""
    if 2 * np.count_nonzero(seen.emits) < len(seen.emits):  # few, as of BRDF samples and a small light
        met = np.flatnonzero(seen.emits)
        return met[dot(take(surface.ng, met), take(seen.wi, met)) > 0]
    return indices(seen.emits & (dot(surface.ng, seen.wi) > 0))


def _control(side: int, w: Array, n: int, lit: Index | None, pdf: list[Array]) -> Array:
    """``(p_l - p_b) / p_w`` of n shading samples of one technique, those that are not `lit` included, ``(n,)``."""
    w = np.broadcast_to(w, n)
    g = 1 / w if side == 0 else -1 / (1 - w)
    w, (light, brdf) = take(w, lit), pdf
    g[slice(None) if lit is None else lit] = (light - brdf) / (w * light + (1 - w) * brdf)
    return g


def _record(batch: Batch, points: _Points, record: Record, alive: Selection | None) -> None:
    """Write down shading samples of `points`, as they arrive at the camera; only those `alive` have a value."""
    assert batch.records is not None
    value = np.zeros((3, record.pdf.shape[1]), np.float32)
    value[:, slice(None) if alive is None else alive] = record.value * np.float32(batch.settings.shading_samples)
    if points.throughput is not None:
        value *= take(points.throughput, record.sample)
    batch.records.append(replace(record, sample=compose(points.sample, record.sample), value=value))


def _delta(
    batch: Batch, points: _Points, light: DeltaLight, index: Selection | None, scale: np.float32, traced: bool
) -> None:
    """Add what the points `index` reflect of a light that has a single direction."""
    surface = points.surface.take(index)
    seen = light.sample(surface.p)
    lit: Selection | None = indices(seen.emits & (dot(surface.ng, seen.wi) > 0))
    clear: np.ndarray | bool = True
    if traced and size(lit, 1):
        clear = _visible(batch, "delta", take(surface.p, lit), take(seen.wi, lit), take(seen.distance, lit))
        if 2 * np.count_nonzero(clear) < len(clear):  # few: to gather them takes less time than to shade all
            lit, clear = compose(lit, np.flatnonzero(clear)), True
    if not size(lit, 1):
        return
    surface = surface.take(lit)
    pair = Pair(surface, take(seen.wi, lit))
    value = surface.eval(pair) * (pair.cos_i * scale) * seen.radiance_at(lit)
    _add(points.out, value * clear, compose(index, lit))


def _visible(batch: Batch, kind: str, origin: Array, wi: Array, distance: Array) -> np.ndarray:
    """Whether nothing stands between the points and the light, ``(N,)`` bool."""
    batch.rays[kind] += wi.shape[1]
    return ~batch.caster.occluded(origin, wi, np.broadcast_to(distance * SHADOW_END, wi.shape[1:]))


def _run(condition: np.ndarray) -> slice | None:
    """Where `condition` holds, which is at the beginning or at the end; None if it holds everywhere."""
    length, number = len(condition), np.count_nonzero(condition)
    if number == length:
        return None
    return slice(0, number) if condition[0] else slice(length - number, length)


def _take(values: Array | None, index: Selection | None) -> Array | None:
    """`take` that lets None through."""
    return None if values is None else take(values, index)


def _add(out: Array, value: Array, index: Selection | None) -> None:
    """Add `value` ``(3, K)`` to the columns `index` of `out` (None: all of them)."""
    if index is None or isinstance(index, slice):
        out[:, index or slice(None)] += value
        return
    for row, values in zip(out, value, strict=True):
        np.add.at(row, index, values)
