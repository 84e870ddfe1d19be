"""Camera samples of a tile: every sample in one batch, descending counts, and the way back to the order of blocks."""

import numpy as np
import pytest
from helpers import pixel_shares

from dmis import Settings
from dmis.estimator.records import Record
from dmis.pipeline.camera_samples import SampleAllocation, sample_batches
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import make_sampler

PIXELS = 12
UNEVEN = np.random.default_rng(3).integers(1, 40, PIXELS)


@pytest.mark.parametrize("spp", [1, 7, 100, UNEVEN], ids=["1", "7", "100", "uneven"])
@pytest.mark.parametrize("size", [5, 64, 10**6])
def test_batches_have_every_camera_sample_once(spp, size):
    """Each pixel has its numbers 0, 1, .. in ascending order, and no batch is larger than twice the size asked for."""
    numbers = [[] for _ in range(PIXELS)]
    for blocks in sample_batches(spp, np.arange(PIXELS), size):
        pixel, number = (np.concatenate(a) for a in zip(*(block.camera_samples() for block in blocks), strict=True))
        assert len(pixel) <= max(2 * size, 2 * PIXELS)
        for p, n in zip(pixel, number, strict=True):
            numbers[p].append(n)
    for pixel, expected in enumerate(np.broadcast_to(spp, PIXELS)):
        assert numbers[pixel] == list(range(expected))


def allocation_of(shares, spp, settings):
    """Allocation of a tile with the sampler of the settings."""
    rng = np.random.default_rng(2)
    block = PixelBlock(rng, 1, np.arange(PIXELS), np.unique(spp).tolist(), settings.shading_samples)
    return SampleAllocation(shares, 0, PIXELS, settings, rng, make_sampler(settings.sampler, block))


@pytest.mark.parametrize("sampler", ["independent", "sobol"])
@pytest.mark.parametrize("allocation", ["systematic", "random"])
def test_order_of_counts_and_back(allocation, sampler):
    """Counts for the first technique descend, and values and records of the samples return to the blocks' order."""
    shares = pixel_shares(np.random.default_rng(1).random(PIXELS))
    settings = Settings(allocation=allocation, shading_samples=4, sampler=sampler)
    allocation = allocation_of(shares, UNEVEN, settings)
    for blocks in sample_batches(UNEVEN, np.arange(PIXELS), 64):
        samples = allocation.camera_samples(blocks)
        assert (np.diff(samples.counts.first.astype(int)) <= 0).all() and np.ptp(samples.counts.first) > 0
        values = np.stack([samples.pixel, samples.number, samples.counts.first]).astype(np.float32)
        record = Record(0, (0,), 0, np.array([2, 0]), values[:, [2, 0]], values[:2, [2, 0]])
        restored, (moved,) = samples.restore_order(values, [record])
        pixel, number = (np.concatenate(a) for a in zip(*(block.camera_samples() for block in blocks), strict=True))
        np.testing.assert_array_equal(restored[:2], [pixel, number])
        np.testing.assert_array_equal(restored[:, moved.sample], record.value)


def test_equal_counts_keep_the_order():
    """At w = 1/2 and two shading samples nothing is sorted."""
    allocation = allocation_of(pixel_shares(0.5), 4, Settings(sampler="independent"))
    (blocks,) = sample_batches(4, np.arange(PIXELS), 64)
    samples = allocation.camera_samples(blocks)
    values = np.ones((3, 4 * PIXELS), np.float32)
    assert samples.order is None and samples.restore_order(values, None) == (values, [])
