"""Tiles: the units of work, small and picklable, whose results do not depend on who renders them or when."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dmis.estimator import Batch, Settings, direct
from dmis.intersect import RayCaster
from dmis.mis import allocate
from dmis.samplers import Kind, make_sampler, stream
from dmis.scene import Scene
from dmis.variance import Moments
from dmis.vec import Array

CHUNK = 2**15
"""Camera samples per batch: the arrays of one batch stay in the cache."""


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
        Camera samples per pixel.
    w
        Share of the first technique, one number or ``(P,)``, P pixels in row order.
    """

    seed: int
    pass_: int
    number: int
    rows: tuple[int, int]
    columns: tuple[int, int]
    spp: int
    w: Array | float
    sampler: Kind
    settings: Settings


@dataclass(frozen=True, eq=False)
class Rendered:
    """What came out of a tile: moments of radiance ``(rows, columns, 3)``, and rays by kind."""

    number: int
    moments: Moments
    rays: Counter[str]


def split(resolution: tuple[int, int], spp: int) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Rows and columns of the tiles of an image: squares of 32, 64 or 128 pixels, so that `CHUNK` samples fill a
    batch.
    """
    side = 32
    while side < 128 and (2 * side) ** 2 * spp <= CHUNK:
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
    sampler = make_sampler(tile.sampler, rng, pixels, tile.spp, settings.shading_samples)
    offset = rng.random(pixels)
    rays: Counter[str] = Counter()
    total: Moments | None = None
    for first, count in _blocks(tile.spp, max(1, CHUNK // pixels)):
        sampler.start_block(first, count)
        u = sampler.draw("camera", None).reshape(2, count, pixels)
        direction = scene.camera.rays((x + u[0]).reshape(-1), (y + u[1]).reshape(-1))
        origin = np.repeat(scene.camera.origin, direction.shape[1], axis=1)
        picks = rng if settings.allocation == "random" else None
        counts = allocate(tile.w, settings.shading_samples, first, count, offset, picks)
        w = np.asarray(tile.w, np.float32)
        w = w if w.ndim == 0 else np.tile(w, count)
        batch = Batch(scene, caster or scene.intersector, settings, sampler, rng, w, counts, rays)
        radiance = direct(batch, origin, direction)
        block = Moments.of(radiance.reshape(3, count, pixels).swapaxes(0, 1))
        total = block if total is None else total.merge(block)
    assert total is not None
    shape = (3, bottom - top, right - left)
    mean, m2 = (np.moveaxis(a.reshape(shape), 0, -1) for a in (total.mean, total.m2))
    return Rendered(tile.number, Moments(total.n, mean, m2), rays)


def _blocks(spp: int, most: int) -> Iterator[tuple[int, int]]:
    """First sample and number of samples of each block of nearly equal size, at most `most`."""
    blocks = -(-spp // most)
    edges = [spp * k // blocks for k in range(blocks + 1)]
    for first, end in itertools.pairwise(edges):
        yield first, end - first
