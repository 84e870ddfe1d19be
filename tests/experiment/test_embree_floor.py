"""Embree floor: the recorder records all queries and changes no result."""

import numpy as np

import dmis
from dmis.experiment.speed.embree_floor import Recorder, embree_seconds
from dmis.pipeline.tile import render_tile


def test_recorder_sees_every_ray_and_changes_nothing(box):
    """Recorded rays equal counted rays, tile by tile, and the image of the tile stays the same."""
    result = dmis.render(box, "thesis", 12)
    recorded = 0
    for tile in result.tiles:
        recorder = Recorder(box.intersector)
        kept, plain = render_tile(box, tile, recorder), render_tile(box, tile)
        np.testing.assert_array_equal(kept.moments.mean, plain.moments.mean)
        recorded += sum(origin.shape[1] for origin, _, _ in recorder.queries)
    assert recorded == sum(result.rays.values())


def test_floor_is_part_of_the_whole(box):
    """Embree alone takes some time."""
    result = dmis.render(box, "balance", 16, parallel=1)
    assert embree_seconds(box, result.tiles, 1) > 0
