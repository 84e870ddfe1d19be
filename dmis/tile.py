"""Tiles: the units of work, small and picklable, whose results do not depend on who renders them or when."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from dmis.batch import Batch, Record
from dmis.combine import COLLECTORS, slot
from dmis.estimator import radiance
from dmis.fireflies import clamp
from dmis.intersect import RayCaster
from dmis.mis import allocate
from dmis.samplers import make_sampler, stream
from dmis.scene import Scene
from dmis.settings import Settings
from dmis.variance import Moments, patch_sum
from dmis.vec import Array, compose, indices, take

CHUNK = 2**16
"""Camera samples per batch: the arrays of one batch stay in the cache. See `batch_size`."""
BASE = 4
"""Side in pixels of the patches that statistics are summed over in a tile."""


@dataclass(frozen=True, eq=False)
class Tile:
    """One rectangle of pixels in one pass.

    Attributes
    ----------
    seed, pass_, number
        What its random stream is made from.
    rows, columns
        ``(begin, end)`` in the image.
    spp
        Camera samples per pixel, one number or ``(P,)``, P pixels in row order.
    w
        Share of the first technique, one number or ``(P,)``; of K > 2 techniques all shares, ``(K, 1)`` or ``(K, P)``.
    statistic
        What is gathered from the shading samples, see `Statistic`; None: nothing.
    control
        Coefficient of the control variate, ``(3, P)``, see `dmis.control`; None: there is none.
    later
        `w` at all surfaces that a path meets but the first; None: the same.
    """

    seed: int
    pass_: int
    number: int
    rows: tuple[int, int]
    columns: tuple[int, int]
    spp: np.ndarray | int
    w: Array | float
    settings: Settings
    statistic: Callable[[int, int], Statistic] | None = None
    control: Array | None = None
    later: Array | float | None = None


class Statistic(Protocol):
    """What is gathered from the shading samples of a tile; made with its number of pixels and of shading samples.

    `dmis.curves.Curves` is one.
    """

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Take in one block: `count` camera samples of every pixel, sample-major, their radiance ``(3, N)``."""
        ...

    def sums(self) -> Mapping[str, Array]:
        """Results by name, in the last axis one per pixel; they are summed over patches of `BASE` pixels."""
        ...


@dataclass(frozen=True, eq=False)
class Rendered:
    """What came out of a tile: moments of radiance ``(rows, columns, 3)``, rays by kind, and the statistic's sums over
    patches of `BASE` pixels, ``(..., rows / BASE, columns / BASE)``.
    """

    number: int
    moments: Moments
    rays: Counter[str]
    sums: Mapping[str, Array]


def batch_size(settings: Settings) -> int:
    """Camera samples per batch: `CHUNK`; four times as many where paths go on, because these become fewer, and calls of
    NumPy take longer than their work if they have little.
    """
    return 4 * CHUNK if settings.integrator == "path" and settings.deepest > 1 else CHUNK


def split(
    resolution: tuple[int, int], spp: int, uneven: bool = False, batch: int = CHUNK
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Rows and columns of the tiles of an image: of 32 to 128 pixels a side, so that `batch` samples fill a batch; half
    as large where the numbers of samples are `uneven`, so that no tile has most of them.
    """
    across = down = 32
    while down < 128 and 2 * across * down * spp <= (batch // 2 if uneven else batch):
        across, down = (2 * across, down) if across == down else (across, 2 * down)
    width, height = resolution
    return [
        ((y, min(y + down, height)), (x, min(x + across, width)))
        for y in range(0, height, down)
        for x in range(0, width, across)
    ]


def render_tile(scene: Scene, tile: Tile, caster: RayCaster | None = None) -> Rendered:
    """Render one tile.

    Parameters
    ----------
    caster
        What answers ray queries; None: the scene's Embree handle.

    Raises
    ------
    ValueError
        If a pixel is not finite.
    """
    tile = replace(tile, settings=scene.plan.settle(tile.settings))
    (top, bottom), (left, right) = tile.rows, tile.columns
    y, x = (a.reshape(-1).astype(np.float32) for a in np.mgrid[top:bottom, left:right])
    pixels, settings = len(x), tile.settings
    shading_samples = settings.shading_samples
    rng = stream(tile.seed, tile.pass_, tile.number)
    sampler = make_sampler(settings.sampler, rng, pixels, np.unique(tile.spp).tolist(), shading_samples)
    collector = None
    if settings.combiner in COLLECTORS:
        collector = COLLECTORS[settings.combiner](tile.w, tile.spp * np.full(pixels, shading_samples))
    stages = 1 if collector is None else collector.stages
    of_rounding = () if len(settings.techniques) == 2 else (len(settings.techniques) - 1,)
    offset = rng.random((*of_rounding, stages * pixels))
    picks = rng if settings.allocation == "random" else None
    tally = settings.sampler != "independent"
    seeing = None if scene.seeing is None else scene.seeing[top:bottom, left:right].reshape(-1)
    if seeing is not None and seeing.all():
        seeing = None
    w = _share(tile.w)
    later_w = None if tile.later is None else _share(tile.later)
    later_offset = None if later_w is None else rng.random(pixels)  # of its own, or the rounding of both would go along
    rays: Counter[str] = Counter()
    statistic = tile.statistic(pixels, shading_samples) if tile.statistic else None
    total: Moments | None = None
    for blocks in _batches(tile.spp, pixels, batch_size(settings)):
        pixel, number = (np.concatenate(a) for a in zip(*(block.samples() for block in blocks), strict=True))
        place = slot(pixel, number, tile.spp, pixels, stages)
        counts = allocate(
            w if stages == 1 or w.ndim == 0 else np.tile(w, stages),
            shading_samples,
            place,
            number,
            offset,
            picks,
            tally,
        )
        order = None if isinstance(counts.first, int) else _falling(counts.first)
        if order is not None:
            pixel, number, place = pixel.take(order), number.take(order), place.take(order)
            counts = counts.take(order)
        later = None
        if later_w is not None and later_offset is not None:
            later_counts = allocate(later_w, shading_samples, pixel, number, later_offset, picks, tally)
            later = take(later_w, pixel), later_counts
        sampler.start(pixel, number)
        u = sampler.draw("camera", None)
        if scene.camera.filter is not None:
            u = scene.camera.filter.offsets(u)
        direction = scene.camera.rays(x.take(pixel) + u[0], y.take(pixel) + u[1])
        origin = np.repeat(scene.camera.origin, direction.shape[1], axis=1)
        records: list[Record] | None = None if statistic is None and collector is None else []
        share = take(w, pixel)
        control = None if tile.control is None else tile.control.take(pixel, axis=1)
        batch = Batch(
            scene, caster or scene.intersector, settings, sampler, rng, share, counts, rays, records, control, later
        )
        visible = None if seeing is None else indices(seeing.take(pixel))
        values = radiance(batch, origin, direction, visible)
        if settings.clamp is not None:
            values = clamp(values, settings.clamp)
        if collector is not None:
            collector.add(records or [], place, np.broadcast_to(counts.first, len(pixel)), shading_samples)
        if order is not None:
            values = _back(order, values)
            records = [replace(record, sample=compose(order, record.sample)) for record in records or ()]
        if statistic is not None:
            statistic.add(records or [], values, blocks[0].count)
        begin = 0
        for block in blocks:
            end = begin + block.count * len(block.pixels)
            samples = values[:, begin:end].reshape(3, block.count, -1).swapaxes(0, 1)
            total = _merge(total, Moments.of(samples), block.pixels if np.ndim(tile.spp) else None, pixels)
            begin = end
    assert total is not None
    shape = bottom - top, right - left
    mean = total.mean if collector is None else total.mean + collector.correction()
    if not (np.isfinite(mean).all() and np.isfinite(total.m2).all()):
        bad = int(np.argmin(np.isfinite(mean + total.m2).all(axis=0)))
        raise ValueError(
            f"pixel at row {top + bad // (right - left)}, column {left + bad % (right - left)} must be finite; got "
            f"{mean[:, bad].tolist()} with squared deviations {total.m2[:, bad].tolist()}. Something there is beyond "
            f"what float32 holds, or a material divides by 0"
        )
    mean, m2 = (np.moveaxis(a.reshape(3, *shape), 0, -1) for a in (mean, total.m2))
    n = total.n if isinstance(total.n, int) else total.n.reshape(*shape, 1)
    found = statistic.sums() if statistic else {}
    sums = {name: patch_sum(a.reshape(*a.shape[:-1], *shape), BASE) for name, a in found.items()}
    return Rendered(tile.number, Moments(n, mean, m2), rays, sums)


@dataclass(frozen=True, eq=False)
class _Block:
    """Camera samples `first` to ``first + count`` of each of some pixels of the tile."""

    pixels: np.ndarray
    first: int
    count: int

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Pixel of each camera sample and its number within the pixel, sample-major."""
        numbers = np.arange(self.first, self.first + self.count)
        return np.tile(self.pixels, self.count), np.repeat(numbers, len(self.pixels))


def _share(w: Array | float) -> Array:
    """Shares of the pixels as an array, ``(P,)``, or of no dimension if they are all the same; ``(K, P)`` or
    ``(K, 1)``.
    """
    share = np.asarray(w, np.float32)
    if share.ndim == 0 or (share != share[..., :1]).any():
        return share
    return share[0] if share.ndim == 1 else share[:, :1]


def _falling(counts: np.ndarray) -> np.ndarray:
    """The stable order in which whole numbers, of which few differ, fall."""
    return np.concatenate([np.flatnonzero(counts == n) for n in range(counts.max(), counts.min() - 1, -1)])


def _back(order: np.ndarray, values: Array) -> Array:
    """Undo the selection of the columns in another `order`."""
    out = np.empty_like(values)
    for row, found in zip(out, values, strict=True):
        row[order] = found
    return out


def _batches(spp: np.ndarray | int, pixels: int, size: int) -> Iterator[list[_Block]]:
    """All camera samples of a tile in batches of nearly equal size, about `size`."""
    stops = [0, *np.unique(spp).tolist()]
    active = [np.flatnonzero(np.broadcast_to(spp, pixels) >= stop) for stop in stops[1:]]
    begins = np.cumsum([0, *(np.diff(stops) * [len(a) for a in active])])
    edges = np.linspace(0, begins[-1], max(1, round(begins[-1] / size)) + 1)
    cuts = [
        np.rint(np.clip((edges - begin) / len(of), 0, stop - start)).astype(int) + start
        for begin, of, (start, stop) in zip(begins[:-1], active, itertools.pairwise(stops), strict=True)
    ]
    for k in range(len(edges) - 1):
        blocks = [_Block(of, cut[k], cut[k + 1] - cut[k]) for of, cut in zip(active, cuts, strict=True)]
        if blocks := [block for block in blocks if block.count]:
            yield blocks


def _merge(total: Moments | None, block: Moments, active: np.ndarray | None, pixels: int) -> Moments:
    """`total` with a block of the pixels `active` (None: all) added."""
    if active is None:
        return block if total is None else total.merge(block)
    if total is None:
        total = Moments(np.zeros((1, pixels)), np.zeros((3, pixels)), np.zeros((3, pixels)))
    n, mean, m2 = total.n, total.mean, total.m2
    assert not isinstance(n, int)
    merged = Moments(n[:, active], mean[:, active], m2[:, active]).merge(block)
    n[:, active], mean[:, active], m2[:, active] = merged.n, merged.mean, merged.m2
    return total
