"""Tiles: the units of work, small and picklable, whose results do not depend on who renders them or when."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dmis.combine import Optimal
from dmis.estimator import Batch, Record, direct
from dmis.intersect import RayCaster
from dmis.mis import allocate
from dmis.samplers import make_sampler, stream
from dmis.scene import Scene
from dmis.settings import Settings
from dmis.variance import Moments, patch_sum
from dmis.vec import Array, Index, take

CHUNK = 2**15
"""Camera samples per batch: the arrays of one batch stay in the cache."""
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
        Share of the first technique, one number or ``(P,)``.
    statistic
        What is gathered from the shading samples, see `Statistic`; None: nothing.
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


def split(resolution: tuple[int, int], spp: int, uneven: bool = False) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Rows and columns of the tiles of an image: squares of 32, 64 or 128 pixels, so that `CHUNK` samples fill a
    batch; of 32 where the numbers of samples are `uneven`, so that no tile has most of them.
    """
    side = 32
    while not uneven and side < 128 and (2 * side) ** 2 * spp <= CHUNK:
        side *= 2
    width, height = resolution
    return [
        ((y, min(y + side, height)), (x, min(x + side, width)))
        for y in range(0, height, side)
        for x in range(0, width, side)
    ]


def render_tile(scene: Scene, tile: Tile, caster: RayCaster | None = None) -> Rendered:
    """Render one tile.

    Parameters
    ----------
    caster
        What answers ray queries; None: the scene's Embree handle.
    """
    (top, bottom), (left, right) = tile.rows, tile.columns
    y, x = (a.reshape(-1).astype(np.float32) for a in np.mgrid[top:bottom, left:right])
    pixels = len(x)
    rng = stream(tile.seed, tile.pass_, tile.number)
    settings = tile.settings
    stops = np.unique(tile.spp).tolist()
    sampler = make_sampler(settings.sampler, rng, pixels, stops, settings.shading_samples)
    offset = rng.random(pixels)
    rays: Counter[str] = Counter()
    optimal = settings.combiner == "optimal"
    statistic = tile.statistic(pixels, settings.shading_samples) if tile.statistic else None
    collector = Optimal(tile.w, tile.spp * np.full(pixels, settings.shading_samples)) if optimal else None
    total: Moments | None = None
    for start, stop in itertools.pairwise((0, *stops)):
        active = np.flatnonzero(tile.spp >= stop) if len(stops) > 1 else None
        for first, count in _blocks(start, stop, max(1, CHUNK // (pixels if active is None else len(active)))):
            sampler.start_block(first, count, active)
            u = sampler.draw("camera", None).reshape(2, count, -1)
            direction = scene.camera.rays((take(x, active) + u[0]).reshape(-1), (take(y, active) + u[1]).reshape(-1))
            origin = np.repeat(scene.camera.origin, direction.shape[1], axis=1)
            picks = rng if settings.allocation == "random" else None
            w = np.asarray(tile.w, np.float32)
            w = w if w.ndim == 0 else take(w, active)
            counts = allocate(w, settings.shading_samples, first, count, take(offset, active), picks)
            w = w if w.ndim == 0 else np.tile(w, count)
            records: list[Record] | None = None if statistic is None and collector is None else []
            batch = Batch(scene, caster or scene.intersector, settings, sampler, rng, w, counts, rays, records)
            radiance = direct(batch, origin, direction)
            if statistic is not None:
                statistic.add(records or [], radiance, count)
            if collector is not None:
                pixel = np.tile(np.arange(pixels) if active is None else active, count)
                first_side = np.broadcast_to(counts.first, len(pixel))
                collector.add(records or [], pixel, first_side, settings.shading_samples)
            block = Moments.of(radiance.reshape(3, count, -1).swapaxes(0, 1))
            total = _merge(total, block, active, pixels)
    assert total is not None
    shape = bottom - top, right - left
    mean = total.mean if collector is None else total.mean + collector.correction()
    mean, m2 = (np.moveaxis(a.reshape(3, *shape), 0, -1) for a in (mean, total.m2))
    n = total.n if isinstance(total.n, int) else total.n.reshape(*shape, 1)
    found = statistic.sums() if statistic else {}
    sums = {name: patch_sum(a.reshape(*a.shape[:-1], *shape), BASE) for name, a in found.items()}
    return Rendered(tile.number, Moments(n, mean, m2), rays, sums)


def _merge(total: Moments | None, block: Moments, active: Index | None, pixels: int) -> Moments:
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


def _blocks(start: int, stop: int, most: int) -> Iterator[tuple[int, int]]:
    """First sample and number of samples of each block of nearly equal size, at most `most`."""
    blocks = -(-(stop - start) // most)
    edges = [start + (stop - start) * k // blocks for k in range(blocks + 1)]
    for first, end in itertools.pairwise(edges):
        yield first, end - first
