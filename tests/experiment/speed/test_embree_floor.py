"""Embree floor: the recorder records all queries and changes no result."""

import numpy as np

import dmis
from dmis.experiment.speed.bench import Recorder, embree_seconds
from dmis.pipeline.job import resolve
from dmis.pipeline.render import render_job
from dmis.pipeline.tile import render_tile


def test_recorder_sees_every_ray_and_changes_nothing(box):
    """Recorded rays equal counted rays, tile by tile, and the image of the tile stays the same."""
    tiles = []
    result = render_job(resolve(box, "thesis", 12, 0, dmis.Settings()), observer=tiles.extend)
    recorded = 0
    for tile in tiles:
        recorder = Recorder(box.intersector)
        kept, plain = render_tile(box, tile, recorder), render_tile(box, tile)
        np.testing.assert_array_equal(kept.mean, plain.mean)
        recorded += sum(query.args[0].shape[1] for query in recorder.queries)
    assert recorded == sum(result.rays.values())


def test_floor_is_part_of_the_whole(box):
    """Embree alone takes some time."""
    tiles = []
    render_job(resolve(box, "balance", 16, 0, dmis.Settings()), 1, observer=tiles.extend)
    assert embree_seconds(box, tiles, 1) > 0
