"""The film of a pass: tiles merged in any order, with a checkpoint between or not."""

from collections import Counter
from itertools import permutations

import numpy as np
import pytest
from helpers import pixel_shares

from dmis import Settings
from dmis.base.patches import PATCH
from dmis.fit.round import Round
from dmis.pipeline.checkpoint import Store
from dmis.pipeline.film import FilmTile, PassFilm
from dmis.pipeline.tile import Rendered, Tile
from dmis.variance.moments import Moments

RESOLUTION = (2 * PATCH, PATCH + 1)


@pytest.fixture
def rendered():
    """Three tiles of random moments and sums that cover an image whose last row is a patch of its own."""
    rng, areas = np.random.default_rng(1), [((0, 4), (0, 4)), ((0, 4), (4, 8)), ((4, 5), (0, 8))]
    tiles = []
    for number, (rows, columns) in enumerate(areas):
        shape = rows[1] - rows[0], columns[1] - columns[0]
        moments = Moments(2, rng.random((*shape, 3)), rng.random((*shape, 3)))
        sums = {"curve": rng.random((2, *(-(-n // PATCH) for n in shape)))}
        tile = Tile(7, 3, number, rows, columns, Round(2, pixel_shares(0.5), Settings()))
        tiles.append((tile, Rendered(number, moments, Counter(camera=10**number), sums)))
    return tiles


def test_tiles_are_merged_to_their_places_in_any_order(rendered):
    """Pixels, patches, rays and marks are those of the tiles, whatever the order in which these arrive."""
    for order in permutations(rendered):
        film = PassFilm.empty(RESOLUTION, 3, order[0][0].round)
        assert not film.done.any()
        for tile, result in order:
            film.merge_tile(FilmTile.of(tile, result))
        assert film.done.all() and film.rays == {"camera": 111}
        assert film.mean.dtype == film.root.dtype == np.float32
        for tile, result in rendered:
            area = slice(*tile.rows), slice(*tile.columns)
            np.testing.assert_array_equal(film.mean[area], result.moments.mean.astype(np.float32))
            np.testing.assert_array_equal(film.root[area], np.sqrt(result.moments.m2).astype(np.float32))
        top = np.concatenate([result.sums["curve"] for _, result in rendered[:2]], axis=-1)
        np.testing.assert_array_equal(film.sums["curve"], np.concatenate([top, rendered[2][1].sums["curve"]], axis=-2))


def test_tiles_of_a_checkpoint_are_those_that_were_appended(rendered, tmp_path):
    """Every field of a film tile comes back from the file, and only those of the pass that is asked for."""
    tiles = [FilmTile.of(tile, result) for tile, result in rendered]
    store = Store(tmp_path / "c", {"seed": 1})
    for tile in tiles:
        store.append(tile)
    store = Store(tmp_path / "c", {"seed": 1})
    assert not list(store.finished_tiles(2))
    for tile, read in zip(tiles, store.finished_tiles(3), strict=True):
        for name in ("pass_", "number", "rows", "columns", "rays"):
            assert getattr(read, name) == getattr(tile, name)
        for name in ("mean", "root"):
            np.testing.assert_array_equal(getattr(read, name), getattr(tile, name))
        np.testing.assert_array_equal(read.sums["curve"], tile.sums["curve"])
