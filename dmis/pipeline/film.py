"""The film of a pass: moments of all pixels, accumulated tile by tile as tiles arrive or are read from a checkpoint."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dmis.base.patches import PATCH
from dmis.base.vectors import Array
from dmis.fit.round import Round
from dmis.pipeline.tile import Rendered, Tile
from dmis.variance.moments import Film, join


@dataclass(frozen=True, eq=False)
class FilmTile:
    """A rendered tile as the film and a checkpoint keep it.

    Attributes
    ----------
    pass_, number, rows, columns
        As in `Tile`.
    mean, root
        As in `dmis.variance.moments.Film`, ``(rows, columns, 3)`` float32.
    rays, sums
        As in `Rendered`.
    """

    pass_: int
    number: int
    rows: tuple[int, int]
    columns: tuple[int, int]
    mean: Array
    root: Array
    rays: Mapping[str, int]
    sums: Mapping[str, Array]

    @classmethod
    def of(cls, tile: Tile, rendered: Rendered) -> FilmTile:
        """Return the film tile of a rendered tile, its moments rounded to float32."""
        with np.errstate(over="ignore"):  # infinite pixels are refused once the image is complete
            mean, root = (a.astype(np.float32) for a in (rendered.moments.mean, np.sqrt(rendered.moments.m2)))
        return cls(tile.pass_, tile.number, tile.rows, tile.columns, mean, root, dict(rendered.rays), rendered.sums)


@dataclass(eq=False)
class PassFilm:
    """The film of one pass over the image.

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

    round: Round
    mean: np.ndarray
    root: np.ndarray
    done: np.ndarray
    rays: Counter[str]
    sums: dict[str, np.ndarray]

    @classmethod
    def empty(cls, resolution: tuple[int, int], tiles: int, round_: Round) -> PassFilm:
        """Return a film of `resolution` (width, height) into which none of its `tiles` is merged."""
        shape, before = (resolution[1], resolution[0], 3), round_.before
        mean, root = (before.mean, before.root) if before else np.zeros((2, *shape), np.float32)
        return cls(round_, mean, root, np.zeros(tiles, bool), Counter(), {})

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

    def rays_of_all_pixels(self) -> dict[str, int]:
        """Return the rays by kind, without those that are counted once more by colour."""
        return {kind: number for kind, number in self.rays.items() if " of colour " not in kind}


def average_films(parts: list[tuple[Film, int]], gain: float) -> tuple[Array, Array]:
    """Return the average of images with weights fixed beforehand, their budgets of samples, and its deviation.

    The results overwrite the arrays of the first part, row by row, because images are large. Both are in the
    units of the scene that was given, which has `gain` times the radiance of the one that was rendered.
    The actual numbers of adaptive samples depend on the pilot, and must not be weights: that would be biased.
    """
    total = sum(n for _, n in parts)
    image, deviation = parts[0][0].mean, parts[0][0].root
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
