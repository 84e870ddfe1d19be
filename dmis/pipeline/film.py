"""The film: what camera samples add up to in a tile, tiles in a pass, and passes in the image.

Observers gather the samples of a tile, batch by batch. Tiles are merged as they arrive or are read from a checkpoint.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmis.base.patches import PATCH, by_colour, patch_sum, pixels_apart
from dmis.base.plugins import checked, guarded, is_shipped
from dmis.base.vectors import Array
from dmis.estimator.allocation import CameraSamples, SampleBlock
from dmis.estimator.mis import combiner_by_name
from dmis.estimator.records import PIXEL_SUMS, Records, Statistic
from dmis.fit.round import Round
from dmis.samplers.streams import is_sequence
from dmis.variance.moments import Film, Moments, PixelMoments, SubBlocks, join


class Observers:
    """All that observes the P camera samples of a tile.

    Parameters
    ----------
    round_
        The round of the tile's pixels. It says which statistic is gathered, and by its combiner, from which sums pixels
        are corrected.
    shape
        Rows and columns of the tile.

    Attributes
    ----------
    statistic
        The statistic of the round; None: there is none.
    pixel_sums
        Closest hits, occlusion rays, and squared samples of each pixel, ``(3, P)``, those of halved lights left out;
        None: the statistic does not ask for them.
    """

    def __init__(self, round_: Round, shape: tuple[int, int]) -> None:
        pixels, settings = shape[0] * shape[1], round_.settings
        self._shape, self._shading_samples = shape, settings.shading_samples  # without those of `Round.patterns`
        in_blocks = round_.halvings is not None or is_sequence(settings.sampler)
        self._moments = SubBlocks(round_.spp, pixels) if in_blocks else PixelMoments(pixels)
        # pixels that a statistic leaves out have no samples
        self._observed = np.flatnonzero(np.broadcast_to(round_.spp, pixels))
        self.statistic: Statistic | None = None
        if round_.statistic is not None:
            statistic = guarded("", round_.statistic)(len(self._observed), self._shading_samples)
            self.statistic = checked(statistic, {"add": None, "sums": None}, in_place=True)
        samples = round_.spp * np.full(pixels, self._shading_samples)
        self._collector = combiner_by_name(settings.combiner).collector(round_.shares, samples)
        self.pixel_sums = np.zeros((3, pixels)) if asks(self.statistic, "pixel_sums") else None

    def new_records(self) -> Records | None:
        """Return what the shading samples of a batch are written into, or None if nobody reads them."""
        reads = self.statistic is not None and getattr(self.statistic, "needs_records", True)
        if not reads and self._collector is None:
            return None
        return Records(asks(self.statistic, "directions"))

    def add(
        self, blocks: Sequence[SampleBlock], samples: CameraSamples, values: Array, records: Records | None
    ) -> None:
        """Add the camera samples of one batch, their radiance ``(3, N)`` and the records of their shading samples.

        What subsets of them see of lights is added to the sub-blocks, see `dmis.estimator.patterns.LightSubsets`.
        """
        if self._collector is not None:
            first = np.broadcast_to(samples.counts.first, len(samples.pixel))
            self._collector.add(records or [], samples.pixel, first, self._shading_samples)
        values, ordered = samples.restore_order(values, records)
        if self.statistic is not None:
            self.statistic.add(ordered, values, blocks[0].count)
        # mean = sum_i L_i / n,  m2 = sum_i (L_i - mean)^2
        begin = 0
        for block in blocks:
            end = begin + block.count * len(block.pixels)
            of_block = values[:, begin:end].reshape(3, block.count, -1).swapaxes(0, 1)
            self._moments.add(of_block, block.pixels, block.first)
            if self.pixel_sums is not None:
                self.pixel_sums[2, block.pixels] += np.square(of_block).mean(axis=1).sum(axis=0, dtype=np.float64)
            if samples.subsets is not None:
                assert isinstance(self._moments, SubBlocks)
                radiance = samples.subsets.radiance[..., begin:end]
                by_block = radiance.reshape(*radiance.shape[:2], block.count, -1)
                sums = by_block.sum(axis=2, dtype=np.float64)
                self._moments.add_sums(sums, block.pixels)
            begin = end

    def sums(self) -> dict[str, Array]:
        """Return the sums of the statistic over the patches, and the rays of their pixels if it asks for them."""
        sums = {} if self.statistic is None else dict(self.statistic.sums())
        if not is_shipped(type(self.statistic)):
            _check_sums(f"{type(self.statistic).__name__}.sums", sums, len(self._observed))
        if len(self._observed) < self._shape[0] * self._shape[1]:
            sums = {name: self._spread(a) for name, a in sums.items()}
        if self.pixel_sums is not None:
            sums |= dict(zip(PIXEL_SUMS, self.pixel_sums, strict=True))
        if asks(self.statistic, "by_pixel"):
            return {name: pixels_apart(a.reshape(-1, *self._shape)) for name, a in sums.items()}
        return patch_sums(sums, self._shape, asks(self.statistic, "by_colour"))

    def _spread(self, values: Array) -> Array:
        """Return values of the observed pixels in their places, 0 elsewhere, ``(..., P)``."""
        spread = np.zeros((*values.shape[:-1], self._shape[0] * self._shape[1]), values.dtype)
        spread[..., self._observed] = values
        return spread

    def moments(self) -> Moments:
        """Return the moments of the pixels ``(3, P)``, corrected by the combiner; 0 where there were no samples."""
        total = self._moments.total()
        return total if self._collector is None else replace(total, mean=total.mean + self._collector.correction())


def _check_sums(call: str, sums: Mapping[str, Array], pixels: int) -> None:
    """Raise a ValueError unless the sums of a statistic are finite, and have a value for each pixel."""
    for name, values in sums.items():
        if np.shape(values)[-1:] != (pixels,) or not np.isfinite(values).all():
            must = f"of shape (..., {pixels}) and finite, one for each pixel"
            raise ValueError(f"{call}: {name} must be {must}; got shape {np.shape(values)}")


def asks(statistic: Statistic | None, wish: str) -> bool:
    """Return whether a statistic, if there is one, has a true class attribute `wish`: it need not have it."""
    return bool(getattr(statistic, wish, False))


def patch_sums(sums: Mapping[str, Array], shape: tuple[int, int], of_colours: bool = False) -> dict[str, Array]:
    """Return sums of pixels ``(..., P)``, by name, over the patches of an area; with colours in the first axis."""
    images = {name: a.reshape(*a.shape[:-1], *shape) for name, a in sums.items()}
    if of_colours:
        images = {name: by_colour(image) for name, image in images.items()}
    return {name: patch_sum(image, PATCH) for name, image in images.items()}


@dataclass(frozen=True, eq=False)
class FilmTile:
    """A rendered tile as the film and a checkpoint keep it.

    Attributes
    ----------
    pass_, number, rows, columns
        As in `dmis.pipeline.tile.Tile`.
    mean, root
        As in `dmis.variance.moments.Film`, ``(rows, columns, 3)`` float32.
    rays
        Rays traced, by kind.
    sums
        Sums of the statistic over patches of `PATCH` pixels, ``(..., ceil(rows / PATCH), ceil(columns / PATCH))``.
    embree_seconds
        CPU seconds of its ray queries; 0 if it was not rendered now.
    worker_seconds
        CPU seconds of all of it, if another process has rendered it now; else 0.
    """

    pass_: int
    number: int
    rows: tuple[int, int]
    columns: tuple[int, int]
    mean: Array
    root: Array
    rays: Mapping[str, int]
    sums: Mapping[str, Array]
    embree_seconds: float = 0.0
    worker_seconds: float = 0.0


class PassFilm:
    """The film of one pass over the image, of `resolution` (width, height); none of its `tiles` is merged at first.

    Attributes
    ----------
    round
        The round of the pass; if it goes on from the film of an earlier one, `mean` and `root` are the arrays of that.
    mean, root
        As in `dmis.variance.moments.Film`, ``(H, W, 3)`` float32.
    done
        Whether each tile was merged, by its number, ``(tiles,)``.
    rays
        Rays traced in the merged tiles, by kind.
    sums
        Sums of the pass's statistic over patches of `PATCH` pixels, ``(..., ceil(H / PATCH), ceil(W / PATCH))``.
    """

    def __init__(self, resolution: tuple[int, int], tiles: int, round_: Round) -> None:
        before, shape = round_.before, (resolution[1], resolution[0], 3)
        mean, root = unlocked(before) if before else np.zeros((2, *shape), np.float32)
        self.mean: np.ndarray = mean
        self.root: np.ndarray = root
        self.round, self.done = round_, np.zeros(tiles, bool)
        self.rays, self.sums = Counter[str](), dict[str, np.ndarray]()

    def merge_tile(self, tile: FilmTile) -> None:
        """Write the pixels and sums of a tile to their places, joined to those before, and count its rays."""
        area = slice(*tile.rows), slice(*tile.columns)
        mean, root = tile.mean, tile.root
        if self.round.before is not None:
            numbers = (np.broadcast_to(n, self.mean.shape[:2])[area] for n in (self.round.begin, self.round.spp))
            n_first, n_more = (n[..., None] for n in numbers)
            film = join(Film(n_first, self.mean[area], self.root[area]), Film(n_more, mean, root))
            mean, root = film.mean, film.root
        self.mean[area], self.root[area] = mean, root
        corner = tile.rows[0] // PATCH, tile.columns[0] // PATCH
        for name, values in tile.sums.items():
            if name not in self.sums:
                shape = (-(-n // PATCH) for n in self.mean.shape[:2])
                self.sums[name] = np.zeros((*values.shape[:-2], *shape))
            rows, columns = (slice(c, c + n) for c, n in zip(corner, values.shape[-2:], strict=True))
            self.sums[name][..., rows, columns] = values
        self.rays.update(tile.rays)
        self.done[tile.number] = True


def unlocked(film: Film) -> tuple[Array, Array]:
    """Return mean and root of a film, which a rule must not write into, to be overwritten."""
    film.mean.flags.writeable = film.root.flags.writeable = True
    return film.mean, film.root


def average_films(parts: list[tuple[Film, int]], gain: float) -> tuple[Array, Array]:
    """Return the average of images with weights fixed beforehand, their budgets of samples, and its deviation.

    The results overwrite the arrays of the first part, row by row, because images are large. Both are in the
    units of the scene that was given, which has `gain` times the radiance of the one that was rendered.
    The actual numbers of adaptive samples depend on the pilot, and must not be weights: that would be biased.
    """
    total = sum(n for _, n in parts)
    image, deviation = unlocked(parts[0][0])
    shape = image.shape
    for row in range(len(image)):
        mean, variance = np.zeros((2, *shape[1:]))
        for part, n in parts:
            share = n / total
            mean += part.mean[row] * share
            n_each = np.broadcast_to(part.n, (*shape[:2], 1))[row].astype(np.float64)
            freedom = np.where(n_each > 1, n_each - 1, np.nan)  # one sample has no variance
            variance += np.square(part.root[row], dtype=np.float64) / (freedom * n_each) * share**2
        mean *= gain
        if not (np.abs(mean) <= np.finfo(np.float32).max).all():
            most = np.abs(mean).max()
            raise ValueError(f"radiance must be below 3.4e38, the largest float32; the image has {most:g}")
        with np.errstate(over="ignore"):  # a deviation may be beyond float32 where the mean is not
            image[row], deviation[row] = mean, np.sqrt(variance) * gain
    return image, deviation


def pilot_shares(parts: list[tuple[Film, int]]) -> dict[str, float]:
    """Return the shares that all images but the first, those of pilots, have of the average with these weights.

    ``pilot_samples`` is that of the weights, ``pilot_variance`` that of the variance, where this is known.
    """
    total = sum(n for _, n in parts)
    variances = []
    for film, n in parts:
        freedom = np.where(np.asarray(film.n) > 1, film.n - 1, np.nan)  # one sample has no variance
        # (n_k / n)^2 V_k, the variance of the average due to image k
        variances.append(np.square(film.root * (n / total), dtype=np.float64) / (freedom * film.n))
    known = np.isfinite(sum(variances))
    of_parts = [float(v.sum(where=known)) for v in variances]
    of_pilots = sum(of_parts[1:]) / max(sum(of_parts), 1e-300)
    return {"pilot_samples": 1 - parts[0][1] / total, "pilot_variance": of_pilots}
