"""The film of a pass: tiles merged in any order, with a checkpoint between or not."""

from itertools import permutations

import numpy as np
import pytest
from helpers import pixel_shares

from dmis import Settings
from dmis.base.patches import PATCH
from dmis.fit.round import Round
from dmis.pipeline.checkpoint import Store
from dmis.pipeline.film import FilmTile, PassFilm

RESOLUTION = (2 * PATCH, PATCH + 1)
ROUND = Round(2, pixel_shares(0.5), Settings())


@pytest.fixture
def tiles():
    """Three tiles of random moments and sums that cover an image whose last row is a patch of its own."""
    rng, areas = np.random.default_rng(1), [((0, 4), (0, 4)), ((0, 4), (4, 8)), ((4, 5), (0, 8))]
    tiles = []
    for number, (rows, columns) in enumerate(areas):
        shape = rows[1] - rows[0], columns[1] - columns[0]
        moments = rng.random((2, *shape, 3), np.float32)
        sums = {"curve": rng.random((2, *(-(-n // PATCH) for n in shape)))}
        tiles.append(FilmTile(3, number, rows, columns, *moments, {"camera": 10**number}, sums))
    return tiles


def test_tiles_are_merged_to_their_places_in_any_order(tiles):
    """Pixels, patches, rays and marks are those of the tiles, whatever the order in which these arrive."""
    for order in permutations(tiles):
        film = PassFilm(RESOLUTION, 3, ROUND)
        assert not film.done.any()
        for tile in order:
            film.merge_tile(tile)
        assert film.done.all() and film.rays == {"camera": 111}
        assert film.mean.dtype == film.root.dtype == np.float32
        for tile in tiles:
            area = slice(*tile.rows), slice(*tile.columns)
            np.testing.assert_array_equal(film.mean[area], tile.mean)
            np.testing.assert_array_equal(film.root[area], tile.root)
        top = np.concatenate([tile.sums["curve"] for tile in tiles[:2]], axis=-1)
        np.testing.assert_array_equal(film.sums["curve"], np.concatenate([top, tiles[2].sums["curve"]], axis=-2))


def test_tiles_of_a_checkpoint_are_those_that_were_appended(tiles, tmp_path):
    """Every field of a film tile comes back from the file, and only those of the pass that is asked for."""
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
