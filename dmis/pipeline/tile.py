"""Tiles: the units of work, small and picklable; what a tile renders does not depend on the machine or the order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmis.base.patches import COLOURS, PATCH, by_colour, patch_sum
from dmis.base.selection import indices, take
from dmis.base.vectors import Array
from dmis.estimator.batch import Batch
from dmis.estimator.combiner import combiner_by_name
from dmis.estimator.patterns import PatternMap
from dmis.estimator.records import Statistic
from dmis.estimator.settings import Settings, resolve_auto
from dmis.estimator.trace import radiance
from dmis.intersect import RayCaster, TimedCaster
from dmis.pipeline.camera_samples import SampleAllocation, SampleBlock, sample_batches
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import Sampler, is_sequence, make_sampler, stream
from dmis.scene.pinhole import ray_origins
from dmis.scene.scene import Scene
from dmis.variance.moments import Moments, PixelMoments
from dmis.variance.sub_blocks import SubBlocks

# CHUNK, `batch_size`, MIN_SIDE, MAX_SIDE and `PATCH` decide which tiles an image is cut into, and which batches a tile.
# A tile's number seeds its random stream (`dmis.samplers.streams.stream`), and its batches draw from that in turn. So
# all images and checkpoints depend on them: whoever tunes one changes every image. `layout` is in the key of a
# checkpoint, which is refused if they differ.
CHUNK = 2**16
"""Camera samples per batch: the arrays of one batch stay in the cache. All images depend on it. See `batch_size`."""
MIN_SIDE, MAX_SIDE = 32, 128
"""Least and largest side of a tile in pixels, a multiple of `PATCH` each. All images depend on them."""


@dataclass(frozen=True, eq=False)
class Tile:
    """A rectangle of P pixels to be rendered in one pass.

    Attributes
    ----------
    seed, pass_, number
        Seed, number of the pass and number of the tile: the random stream is made from them.
    rows, columns
        ``(begin, end)`` in the image.
    spp
        Camera samples per pixel, one number or ``(P,)`` in row order.
    shares
        Shares of samples of the K techniques, ``(K, P)``, or ``(K, 1)`` if those of all pixels are the same; float32.
    statistic
        Makes the `Statistic` that gathers the shading samples; None: there is none.
    control
        Coefficient of the control variate, ``(3, P)``, see `dmis.fit.control_variate`; None: there is none.
    patterns
        Patterns of the pixels, and where in their sequences they go on, so that `spp` are the samples from there on;
        None: `shares` divide the samples, and all pixels begin their sequences.
    """

    seed: int
    pass_: int
    number: int
    rows: tuple[int, int]
    columns: tuple[int, int]
    spp: np.ndarray | int
    shares: Array
    settings: Settings
    statistic: Callable[[int, int], Statistic] | None = None
    control: Array | None = None
    patterns: PatternMap | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.rows[1] - self.rows[0], self.columns[1] - self.columns[0]

    @property
    def pixels(self) -> int:
        """P, number of pixels."""
        return self.shape[0] * self.shape[1]

    @property
    def camera_samples(self) -> int:
        """Number of camera samples of all pixels."""
        return self.pixels * self.spp if isinstance(self.spp, int) else int(self.spp.sum())

    @property
    def begin(self) -> np.ndarray:
        """Numbers of the first camera samples in the sequences of the pixels, ``(P,)``, or ``(1,)`` if all are 0."""
        return np.zeros(1, np.int64) if self.patterns is None else self.patterns.begin

    def sampler(self, settings: Settings, width: int, rng: np.random.Generator) -> Sampler:
        """Return the sampler of the pixels, in an image of `width` pixels."""
        rows, columns = np.arange(*self.rows), np.arange(*self.columns)
        pixels = (rows[:, None] * width + columns).reshape(-1)
        stops = np.unique(self.spp + self.begin).tolist()
        return make_sampler(settings.sampler, PixelBlock(rng, self.seed, pixels, stops, settings.shading_samples))

    def groups(self) -> Iterator[tuple[np.ndarray, Array, Settings]]:
        """Yield the pixels ``(A,)`` that are rendered together, with their shares and their settings."""
        every = np.arange(self.pixels)
        if self.patterns is None:
            yield every, self.shares, self.settings
            return
        for number, (n_l, n_b) in enumerate(self.patterns.patterns):
            pixels = every[(self.patterns.pattern == number) & (self.spp > 0)]
            if len(pixels):
                shares = np.array([[n_l], [n_b]], np.float32) / np.float32(n_l + n_b)
                yield pixels, shares, replace(self.settings, shading_samples=n_l + n_b)


@dataclass(frozen=True, eq=False)
class Rendered:
    """The result of rendering a tile.

    Attributes
    ----------
    number
        Number of the tile.
    moments
        Moments of radiance, ``(rows, columns, 3)``.
    rays
        Rays traced, by kind.
    sums
        Sums of the statistic over patches of `PATCH` pixels, ``(..., ceil(rows / PATCH), ceil(columns / PATCH))``.
    embree_seconds
        CPU seconds of its ray queries.
    """

    number: int
    moments: Moments
    rays: Counter[str]
    sums: Mapping[str, Array]
    embree_seconds: float = 0.0


def batch_size(settings: Settings) -> int:
    """Return the number of camera samples per batch: `CHUNK`, or four times as many for paths of several surfaces.

    Paths end one by one, and a call of NumPy takes longer than its work if only few are left. It decides the tiles, and
    so all images depend on it, see `CHUNK`.
    """
    return 4 * CHUNK if settings.integrator == "path" and settings.deepest > 1 else CHUNK


def layout(settings: Settings) -> dict[str, int]:
    """Return the constants that decide the tiles of an image and the batches of a tile, for the key of a checkpoint."""
    sides = {"min_side": MIN_SIDE, "max_side": MAX_SIDE}
    return {"chunk": CHUNK, "base": PATCH, "batch": batch_size(settings), **sides}


def make_tiles(
    resolution: tuple[int, int],
    seed: int,
    pass_: int,
    spp: np.ndarray | int,
    shares: Array,
    settings: Settings,
    statistic: Callable[[int, int], Statistic] | None = None,
    control: Array | None = None,
    patterns: PatternMap | None = None,
) -> list[Tile]:
    """Return the tiles of one pass over an image, in row order.

    Parameters
    ----------
    resolution
        Width and height of the image.
    seed, pass_, settings, statistic
        As in `Tile`.
    spp
        Camera samples per pixel, one number or ``(H, W)``.
    shares
        Shares of samples of the K techniques, ``(K,)`` or ``(K, H, W)`` float32, see `dmis.fit.rule.Fit.shares`.
    control
        Coefficient of the control variate, ``(H, W, 3)``; None: there is none.
    patterns
        Patterns of the pixels, ``(H, W)``, see `Tile`.
    """
    tiles = []
    areas = _tile_areas(resolution, int(np.mean(spp)), not isinstance(spp, int), batch_size(settings))
    for number, (rows, columns) in enumerate(areas):
        area = slice(*rows), slice(*columns)
        tile_spp = spp if isinstance(spp, int) else spp[area].reshape(-1)
        tile_control = None if control is None else control[area].reshape(-1, 3).T.astype(np.float32)
        tile_shares = _shares_of_area(shares, area)
        ours = None if patterns is None else patterns.of_area(area)
        tile = Tile(seed, pass_, number, rows, columns, tile_spp, tile_shares, settings, statistic, tile_control, ours)
        tiles.append(tile)
    return tiles


def _tile_areas(
    resolution: tuple[int, int], spp: int, uneven: bool, batch: int
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return rows and columns of the tiles of an image.

    Tiles are `MIN_SIDE` to `MAX_SIDE` pixels a side, so that `batch` samples fill a batch; twice as large where the
    numbers of samples are `uneven`, because pixels of different patterns or numbers are in batches of their own.
    """
    across = down = MIN_SIDE
    while down < MAX_SIDE and 2 * across * down * spp <= (2 * batch if uneven else batch):
        across, down = (2 * across, down) if across == down else (across, 2 * down)
    width, height = resolution
    return [
        ((y, min(y + down, height)), (x, min(x + across, width)))
        for y in range(0, height, down)
        for x in range(0, width, across)
    ]


def _shares_of_area(shares: Array, area: tuple[slice, slice]) -> Array:
    """Return the shares of the pixels of an area of the image, ``(K, P)``, or ``(K, 1)`` if all are equal."""
    if shares.ndim == 1:
        return shares[:, None]
    of_pixels = shares[:, *area].reshape(len(shares), -1)
    return of_pixels if (of_pixels != of_pixels[:, :1]).any() else of_pixels[:, :1].copy()


def render_tile(scene: Scene, tile: Tile, caster: RayCaster | None = None) -> Rendered:
    """Render one tile: camera samples in batches, the radiance of each, and the moments of each pixel.

    Parameters
    ----------
    caster
        Answers ray queries; None: the scene's Embree handle.

    Raises
    ------
    ValueError
        If a pixel is not finite.
    """
    tile = replace(tile, settings=resolve_auto(tile.settings, scene))
    settings, pixels, shading_samples = tile.settings, tile.pixels, tile.settings.shading_samples
    rng = stream(tile.seed, tile.pass_, tile.number)
    collector = combiner_by_name(settings.combiner).collector(tile.shares, tile.spp * np.full(pixels, shading_samples))
    statistic = tile.statistic(pixels, shading_samples) if tile.statistic else None
    colour = _pixel_colours(tile) if getattr(statistic, "by_colour", False) else None
    stages = 1 if collector is None else collector.stages
    corners, covered = _pixel_corners(tile), _covered_pixels(scene, tile)
    rays: Counter[str] = Counter()
    timed = TimedCaster(caster or scene.intersector)
    moments = SubBlocks(tile.spp, pixels) if is_sequence(settings.sampler) else PixelMoments(pixels)
    for group, shares, settings in tile.groups():
        sampler = tile.sampler(settings, scene.camera.resolution[0], rng)
        allocation = SampleAllocation(shares, tile.spp, pixels, settings, stages, rng, sampler)
        spp = tile.spp if isinstance(tile.spp, int) else tile.spp.take(group)
        for blocks in sample_batches(spp, group, batch_size(settings)):
            # n_1 of the S shading samples of a camera sample to the first technique, w S on average
            samples = allocation.camera_samples(blocks)
            sampler.start(samples.pixel, samples.number + take(tile.begin, samples.pixel))
            origin, direction = _camera_rays(scene, sampler, corners, samples.pixel)
            # L_i, the radiance of camera sample i
            batch = Batch(
                scene,
                timed,
                settings,
                sampler,
                rng,
                take(shares, samples.pixel),
                samples.counts,
                rays,
                None if statistic is None and collector is None else [],
                None if colour is None else colour.take(samples.pixel),
                None if tile.control is None else tile.control.take(samples.pixel, axis=1),
            )
            values = radiance(
                batch, origin, direction, None if covered is None else indices(covered.take(samples.pixel))
            )
            if collector is not None:
                first = np.broadcast_to(samples.counts.first, len(samples.pixel))
                collector.add(batch.records or [], samples.slot, first, shading_samples)
            values, records = samples.restore_order(values, batch.records)
            if statistic is not None:
                statistic.add(records, values, blocks[0].count)
            # mean = sum_i L_i / n,  m2 = sum_i (L_i - mean)^2
            _add_blocks(moments, blocks, values)
    total = moments.total() if tile.camera_samples else Moments(0, *np.zeros((2, 3, pixels)))
    if collector is not None:
        total = replace(total, mean=total.mean + collector.correction())
    _check_finite(total, tile)
    return Rendered(tile.number, _image_moments(total, tile), rays, _patch_sums(statistic, tile), timed.seconds)


def _covered_pixels(scene: Scene, tile: Tile) -> np.ndarray | None:
    """Return whether each pixel of the tile may see something, ``(P,)`` bool; None if all of them may."""
    if scene.covered_pixels is None:
        return None
    covered: np.ndarray = scene.covered_pixels[slice(*tile.rows), slice(*tile.columns)].reshape(-1)
    return None if covered.all() else covered


def _pixel_corners(tile: Tile) -> tuple[Array, Array]:
    """Return the raster coordinates x and y of the top left corners of the pixels of a tile, ``(P,)`` float32 each."""
    y, x = (a.reshape(-1).astype(np.float32) for a in np.mgrid[slice(*tile.rows), slice(*tile.columns)])
    return x, y


def _pixel_colours(tile: Tile) -> np.ndarray:
    """Return the number of the colour of each pixel of a tile, see `COLOURS`, ``(P,)`` uint8."""
    colour = np.empty(tile.shape, np.uint8)  # tiles begin at multiples of two
    for number, at in enumerate(COLOURS):
        colour[at] = number
    return colour.reshape(-1)


def _camera_rays(
    scene: Scene, sampler: Sampler, corners: tuple[Array, Array], pixel: np.ndarray
) -> tuple[Array, Array]:
    """Return origins and directions of camera rays through random points of pixels, ``(3, N)`` each."""
    u = sampler.draw("camera", None)
    if scene.camera.filter is not None:
        u = scene.camera.filter.offsets(u)
    x, y = corners
    direction = scene.camera.rays(x.take(pixel) + u[0], y.take(pixel) + u[1])
    return ray_origins(scene.camera.origin, scene.plan.pinhole_offsets, direction), direction


def _add_blocks(moments: PixelMoments | SubBlocks, blocks: Sequence[SampleBlock], values: Array) -> None:
    """Add the radiance ``(3, N)`` of the camera samples of `blocks` to the moments of their pixels."""
    begin = 0
    for block in blocks:
        end = begin + block.count * len(block.pixels)
        moments.add(values[:, begin:end].reshape(3, block.count, -1).swapaxes(0, 1), block.pixels, block.first)
        begin = end


def _check_finite(total: Moments, tile: Tile) -> None:
    """Raise a `ValueError` that names the first pixel whose mean or squared deviations are not finite."""
    if np.isfinite(total.mean).all() and np.isfinite(total.m2).all():
        return
    bad = int(np.argmin(np.isfinite(total.mean + total.m2).all(axis=0)))
    row, column = divmod(bad, tile.shape[1])
    raise ValueError(
        f"pixel at row {tile.rows[0] + row}, column {tile.columns[0] + column} must be finite; got "
        f"{total.mean[:, bad].tolist()} with squared deviations {total.m2[:, bad].tolist()}. Something there is beyond "
        f"what float32 holds, or a material divides by 0"
    )


def _image_moments(total: Moments, tile: Tile) -> Moments:
    """Return moments ``(3, P)`` of the pixels of a tile as an image ``(rows, columns, 3)``."""
    mean, m2 = (np.moveaxis(a.reshape(3, *tile.shape), 0, -1) for a in (total.mean, total.m2))
    return Moments(total.n if isinstance(total.n, int) else total.n.reshape(*tile.shape, 1), mean, m2)


def _patch_sums(statistic: Statistic | None, tile: Tile) -> dict[str, Array]:
    """Return the sums of a statistic over patches of `PATCH` pixels, by name; none if there is no statistic."""
    sums = {} if statistic is None else statistic.sums()
    images = {name: a.reshape(*a.shape[:-1], *tile.shape) for name, a in sums.items()}
    if getattr(statistic, "by_colour", False):
        images = {name: by_colour(image) for name, image in images.items()}
    return {name: patch_sum(image, PATCH) for name, image in images.items()}
