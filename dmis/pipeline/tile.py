"""Tiles: the units of work, small and picklable; what a tile renders does not depend on the machine or the order."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from threading import Event

import numpy as np

from dmis.base.patches import PATCH, by_colour, patch_sum, pixels_apart
from dmis.base.plugins import checked, guarded, is_shipped
from dmis.base.vectors import Array, distinct, indices
from dmis.estimator.allocation import SampleBlock, allocate, restore_order, sample_batches
from dmis.estimator.batch import Batch
from dmis.estimator.mis import combiner_by_name
from dmis.estimator.records import PIXEL_SUMS, Record, Records, Statistic, Wants, wants_of
from dmis.estimator.settings import Settings
from dmis.estimator.trace import radiance
from dmis.fit.round import Round
from dmis.intersect import CountingCaster, RayCaster
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import Numbers, is_sequence, stream
from dmis.scene.scene import Scene
from dmis.variance.moments import Film, Moments, PixelMoments, SubBlocks

# CHUNK, `batch_size`, MIN_SIDE, MAX_SIDE, UNEVEN and `PATCH` decide which tiles an image is cut into, and which batches
# a tile. A tile's number seeds its random stream (`dmis.samplers.streams.stream`), and its batches draw from that in
# turn. So all images and checkpoints depend on them: whoever tunes one changes every image. `layout` is in the key of
# a checkpoint, which is refused if they differ.
CHUNK = 2**16
"""Camera samples per batch: the arrays of one batch stay in the cache. All images depend on it. See `batch_size`."""
MIN_SIDE, MAX_SIDE = 32, 128
"""Least and largest side of a tile in pixels, multiples of `PATCH`, see `make_tiles`. All images depend on them."""
UNEVEN = 4
"""How many times as large tiles are whose pixels are in several batches. Images of rules with pilots depend on it."""


@dataclass(frozen=True, eq=False)
class Tile:
    """A rectangle of P pixels to be rendered in one round.

    Attributes
    ----------
    seed, pass_, number
        Seed, number of the round and number of the tile: the random stream is made from them.
    area
        Rows and columns in the image.
    round
        The round of these pixels, see `dmis.fit.round.Round.of_area`.
    """

    seed: int
    pass_: int
    number: int
    area: tuple[slice, slice]
    round: Round

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        rows, columns = self.area
        return rows.stop - rows.start, columns.stop - columns.start

    @property
    def camera_samples(self) -> int:
        """Number of camera samples of all pixels."""
        spp = self.round.spp
        return math.prod(self.shape) * spp if isinstance(spp, int) else int(spp.sum())


def batch_size(settings: Settings) -> int:
    """Return the number of camera samples per batch: `CHUNK`, or four times as many for paths of several surfaces.

    Paths end one by one, and a call of NumPy takes longer than its work if only few are left. It decides the tiles, and
    so all images depend on it, see `CHUNK`.
    """
    return 4 * CHUNK if settings.integrator == "path" and settings.deepest > 1 else CHUNK


def layout(settings: Settings) -> dict[str, int]:
    """Return the constants that decide the tiles of an image and the batches of a tile, for the key of a checkpoint."""
    sides = {"min_side": MIN_SIDE, "max_side": MAX_SIDE, "uneven": UNEVEN}
    return {"chunk": CHUNK, "base": PATCH, "batch": batch_size(settings), **sides}


def make_tiles(resolution: tuple[int, int], seed: int, pass_: int, round_: Round) -> list[Tile]:
    """Return the tiles of one round over an image of `resolution` (width, height), in row order.

    Tiles are `MIN_SIDE` to `MAX_SIDE` pixels a side, so that their samples fill a batch; `UNEVEN` times as many where
    numbers or patterns of samples differ, because pixels of different patterns are in batches of their own. They are up
    to 256 where most pixels have no sample, and the mean is below 1.
    """
    spp = float(np.mean(round_.spp))
    uneven = not isinstance(round_.spp, int) or round_.patterns is not None
    samples = batch_size(round_.settings) * (UNEVEN if uneven else 1)
    most = MAX_SIDE if spp >= 1 else 2 * MAX_SIDE
    across = down = MIN_SIDE
    while down < most and 2 * across * down * spp <= samples:
        across, down = (2 * across, down) if across == down else (across, 2 * down)
    width, height = resolution
    corners = itertools.product(range(0, height, down), range(0, width, across))
    areas = [(slice(y, min(y + down, height)), slice(x, min(x + across, width))) for y, x in corners]
    return [Tile(seed, pass_, number, area, round_.of_area(area)) for number, area in enumerate(areas)]


def render_tile(scene: Scene, tile: Tile, caster: RayCaster | None = None, stop: Event | None = None) -> Film:
    """Return the film of one tile: its camera samples in batches, the radiance of each, and what these add up to.

    Parameters
    ----------
    caster, stop
        Answers ray queries, None: the scene's Embree handle; once set, ends the tile at the next by a CancelledError.

    Raises
    ------
    ValueError
        If a pixel is not finite.
    """
    size = batch_size(tile.round.settings)
    statistic = None if tile.round.statistic is None else TileStatistic(tile, tile.round.statistic)
    count = math.prod(tile.shape)
    covered = None if scene.covered_pixels is None else scene.covered_pixels[tile.area].reshape(-1)
    in_blocks = tile.round.halvings is not None or is_sequence(tile.round.settings.sampler)
    round_, shading_samples = tile.round.in_row_order(), tile.round.settings.shading_samples
    moments = SubBlocks(round_.spp, count) if in_blocks else PixelMoments(count)
    techniques, combiner = round_.mixture, combiner_by_name(round_.settings.combiner)
    collector = None
    if combiner.collector is not None:
        collector = combiner.collector(round_.shares, round_.spp * np.full(count, shading_samples))
    counting = CountingCaster(caster or scene.intersector, None if statistic is None else statistic.pixel_sums, stop)
    rng = stream(tile.seed, tile.pass_, tile.number)
    y, x = np.mgrid[tile.area].reshape(2, -1)
    corners = x.astype(np.float32), y.astype(np.float32)
    in_image = y * scene.camera.resolution[0] + x
    stops = distinct(round_.spp + round_.begin).tolist()
    for pixels, spp, shares, settings in round_.groups(count):
        numbers = Numbers(settings.sampler, PixelBlock(rng, tile.seed, in_image, stops, settings.shading_samples))
        offsets = numbers.rounding_offsets(len(shares) - 1, count)
        batches = sample_batches(spp, pixels, size)
        of_round = round_.spp, round_.begin, round_.tilt, round_.halvings
        # n_1 of the S shading samples of a camera sample to the first technique, w S on average
        for blocks, samples in allocate(batches, shares, offsets, settings, numbers, *of_round):
            numbers.start(samples.pixel, samples.number)
            rays = _camera_rays(scene, numbers, corners, samples.pixel)
            counting.pixel = samples.pixel
            records = None if collector is None else Records()
            if statistic is not None and statistic.wants.records:
                records = Records(statistic.wants.directions)
            batch = Batch(scene, counting, settings, techniques, combiner, samples, numbers, records)
            # L_i, the radiance of camera sample i
            may_see = None if covered is None else indices(covered.take(samples.pixel))
            values = radiance(batch, *rays, may_see)
            if collector is not None:
                first = np.broadcast_to(samples.counts[0], len(samples.pixel))
                collector.add(records or [], samples.pixel, first, shading_samples)
            values, ordered = restore_order(samples.order, values, records or [])
            if statistic is not None:
                statistic.add(blocks, values, ordered)
            # mean = sum_i L_i / n,  m2 = sum_i (L_i - mean)^2
            moments.add(blocks, values, None if samples.subsets is None else samples.subsets.radiance)
    total = moments.total()
    if collector is not None:
        total = replace(total, mean=total.mean + collector.correction())
    sums = {} if statistic is None else statistic.sums()
    return replace(_film_of(total, tile), rays=counting.rays, sums=sums, embree_seconds=counting.seconds)


class TileStatistic:
    """The statistic of a round, made for the pixels of a tile that have samples.

    Attributes
    ----------
    wants
        What the statistic wants.
    pixel_sums
        Closest hits, occlusion rays, and squared samples of each pixel, ``(3, P)``, those of halved lights left out;
        None: the statistic does not want them.
    """

    def __init__(self, tile: Tile, make: Callable[[int, int], Statistic]) -> None:
        self._shape = tile.shape
        self._observed = np.flatnonzero(np.broadcast_to(tile.round.spp, tile.shape))
        # without the shading samples of `Round.patterns`
        statistic = guarded("", make)(len(self._observed), tile.round.settings.shading_samples)
        self._statistic: Statistic = checked(statistic, {"add": None, "sums": None}, in_place=True)
        self.wants = wants_of(self._statistic)
        self.pixel_sums = np.zeros((3, math.prod(tile.shape))) if self.wants.pixel_sums else None

    def add(self, blocks: Sequence[SampleBlock], values: Array, records: Sequence[Record]) -> None:
        """Add the radiance ``(3, N)`` of the camera samples of one batch, and the records of their shading samples."""
        self._statistic.add(records, values, blocks[0].count)
        if self.pixel_sums is not None:
            for block in blocks:
                squares = np.square(values[:, block.columns].reshape(3, block.count, -1)).mean(axis=0)
                self.pixel_sums[2, block.pixels] += squares.sum(axis=0, dtype=np.float64)

    def sums(self) -> dict[str, Array]:
        """Return the sums of the statistic over the patches, and the rays of their pixels if it wants them.

        A ValueError unless sums of a statistic that is not shipped are finite, one for each pixel with samples.
        """
        sums = dict(self._statistic.sums())
        count = len(self._observed)
        if not is_shipped(type(self._statistic)):
            for name, values in sums.items():
                if np.shape(values)[-1:] != (count,) or not np.isfinite(values).all():
                    must = f"of shape (..., {count}) and finite, one for each pixel"
                    call = f"{type(self._statistic).__name__}.sums"
                    raise ValueError(f"{call}: {name} must be {must}; got shape {np.shape(values)}")
        if count < math.prod(self._shape):
            for name, values in sums.items():
                sums[name] = np.zeros((*values.shape[:-1], math.prod(self._shape)), values.dtype)
                sums[name][..., self._observed] = values
        if self.pixel_sums is not None:
            sums |= dict(zip(PIXEL_SUMS, self.pixel_sums, strict=True))
        return patch_sums(sums, self._shape, self.wants)


def patch_sums(sums: Mapping[str, Array], shape: tuple[int, int], wants: Wants) -> dict[str, Array]:
    """Return sums of pixels ``(..., P)``, by name, over the patches of an area, as a statistic wants them."""
    images = {name: a.reshape(*a.shape[:-1], *shape) for name, a in sums.items()}
    if wants.sums == "pixels":
        return {name: pixels_apart(image) for name, image in images.items()}
    if wants.sums == "colours":
        images = {name: by_colour(image) for name, image in images.items()}
    return {name: patch_sum(image, PATCH) for name, image in images.items()}


def _camera_rays(
    scene: Scene, numbers: Numbers, corners: tuple[Array, Array], pixel: np.ndarray
) -> tuple[Array, Array]:
    """Return origins and directions of camera rays through random points of pixels, ``(3, N)`` each.

    `corners` are the raster coordinates x and y of the top left corners of the tile's pixels, ``(P,)`` float32 each.
    """
    u = numbers.camera()
    if scene.camera.filter is not None:
        u = scene.camera.filter.offsets(u)
    x, y = corners
    place = x.take(pixel) + u[0], y.take(pixel) + u[1]
    if not scene.camera.is_pinhole:
        return scene.camera.lens_rays(*place, numbers.camera(lens=True))
    direction = scene.camera.rays(*place)
    return np.repeat(scene.camera.origin, direction.shape[1], axis=1), direction


def _film_of(total: Moments, tile: Tile) -> Film:
    """Return the film of a tile, in float32, from the moments of its pixels ``(3, P)``.

    A ValueError if a pixel is not finite; the message names the first one.
    """
    finite = np.isfinite(total.mean + total.m2).all(axis=0)
    if not finite.all():
        bad = int(np.argmin(finite))
        row, column = divmod(bad, tile.shape[1])
        raise ValueError(
            f"pixel at row {tile.area[0].start + row}, column {tile.area[1].start + column} must be finite; got "
            f"{total.mean[:, bad].tolist()} with squared deviations {total.m2[:, bad].tolist()}. Something there is "
            f"beyond what float32 holds, or a material divides by 0"
        )
    with np.errstate(over="ignore"):  # infinite pixels are refused once the image is complete
        mean, root = (a.astype(np.float32).reshape(3, *tile.shape) for a in (total.mean, np.sqrt(total.m2)))
    n = tile.round.spp
    number = n if isinstance(n, int) else n.reshape(*tile.shape, 1)
    return Film(number, np.moveaxis(mean, 0, -1), np.moveaxis(root, 0, -1))
