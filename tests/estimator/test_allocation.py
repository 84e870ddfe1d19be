"""Division of shading samples, and the batches of camera samples of a tile."""

import numpy as np
import pytest
from helpers import LEVEL, Z_LIMIT, pixel_shares

from dmis import Settings
from dmis.base.vectors import Array
from dmis.estimator.allocation import Counts, SampleAllocation, allocate, sample_batches, shares_of
from dmis.estimator.records import Record
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import SAMPLERS, Independent, Numbers
from dmis.testing.statistics import chi2_p

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
    return SampleAllocation(shares, PIXELS, settings, Numbers(SAMPLERS[settings.sampler](block), rng))


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


# Division of shading samples ------------------------------------------------------------------------------------


def divide(w, shading_samples: int, start: int, count: int, offset: Array, rng=None) -> Counts:
    """Samples `start` to ``start + count`` of all pixels, sample-major; `w` is all shares, or the first of two."""
    pixels = offset.shape[-1]
    pixel, number = np.tile(np.arange(pixels), count), np.repeat(np.arange(start, start + count), pixels)
    shares = w if np.ndim(w) == 2 else pixel_shares(w)
    at_random = None if rng is None else Numbers(Independent(PixelBlock(rng, 1, pixel, [count], 1)), rng)
    return allocate(shares, shading_samples, pixel, number, np.atleast_2d(offset), at_random)


@pytest.mark.parametrize("w", [0.0, 0.25, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("shading_samples", [1, 2, 4])
def test_a_number_is_the_same_as_a_map(w: float, shading_samples: int) -> None:
    """One share for all pixels gives what a constant map of it gives."""
    offset = np.random.default_rng(6).random(50)
    one = divide(w, shading_samples, 3, 6, offset)
    many = divide(np.full(50, w), shading_samples, 3, 6, offset)
    np.testing.assert_array_equal(np.broadcast_to(one.first, 300), many.first)


def test_blocks_continue() -> None:
    """Samples 0 to 9 in one block, or in blocks of 4 and 6, are divided alike."""
    offset, w = np.random.default_rng(7).random(20), np.random.default_rng(8).random(20)
    whole = divide(w, 2, 0, 10, offset)
    parts = [divide(w, 2, 0, 4, offset), divide(w, 2, 4, 6, offset)]
    np.testing.assert_array_equal(np.concatenate([p.first for p in parts]), whole.first)
    np.testing.assert_array_equal(np.concatenate([p.samples_before for p in parts], axis=1), whole.samples_before)


def test_counts_do_not_depend_on_track_sequence() -> None:
    """Counts are the same whether or not the samples before are counted, too."""
    offset, w = np.random.default_rng(7).random(20), np.random.default_rng(8).random(20)
    pixel, number = np.tile(np.arange(20), 5), np.repeat(np.arange(5), 20)
    shares = pixel_shares(w)
    tracked, plain = (allocate(shares, 3, pixel, number, offset[None], None, track) for track in (True, False))
    assert tracked.samples_before is not None and plain.samples_before is None
    np.testing.assert_array_equal(tracked.first, plain.first)


@pytest.mark.parametrize("w", [0.0, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("shading_samples", [1, 3])
def test_random_allocation_is_binomial(w: float, shading_samples: int) -> None:
    """The one-sample model: counts are binomial, whatever the neighbours have."""
    from scipy.stats import binom

    rng, count = np.random.default_rng(11), 40000
    first = divide(w, shading_samples, 0, 4, np.zeros(count // 4), rng).first
    if w in (0, 1):
        assert (np.asarray(first) == w * shading_samples).all()
        return
    observed = np.bincount(first, minlength=shading_samples + 1)
    expected = binom.pmf(np.arange(shading_samples + 1), shading_samples, w) * count
    assert chi2_p(observed, expected) > LEVEL


# Shares of any number of techniques ---------------------------------------------------------------------------------

SHARES = [
    (0.1, 0.9),
    (1 / 3, 2 / 3),
    (0.77, 0.23),
    (0.0, 1.0),
    (1.0, 0.0),
    (0.5, 0.3, 0.2),
    (1 / 3, 1 / 3, 1 / 3),
    (0.94, 0.03, 0.03),
    (0.0, 0.6, 0.4),
    (0.5, 0.5, 0.0),
    (0.1, 0.2, 0.3, 0.4),
]
each_shares = pytest.mark.parametrize("w", SHARES)


@pytest.mark.parametrize("weight", [0.0, 0.3, 1.0, np.linspace(0, 1, 6).reshape(2, 3)])
def test_shares_of_the_first_of_two(weight: float | Array) -> None:
    """A number or a map w becomes ``(w, 1 - w)``, of sum 1 in float32, too."""
    shares = shares_of(weight)
    assert shares.dtype == np.float32 and shares.shape == (2, *np.shape(weight))
    np.testing.assert_array_equal(shares[0], np.float32(weight))
    np.testing.assert_allclose(shares[1], 1 - np.asarray(weight), atol=1e-7)
    np.testing.assert_array_equal(shares.sum(axis=0), np.ones(np.shape(weight)))


@pytest.mark.parametrize("weight", [(0.3, 0.7), (0.2, 0.3, 0.5), np.full((3, 2, 4), 1 / 3)])
def test_shares_of_all_techniques(weight: tuple[float, ...] | Array) -> None:
    """Shares of all techniques stay what they are, for the image and for each pixel."""
    np.testing.assert_array_equal(shares_of(weight), np.float32(weight))


@each_shares
@pytest.mark.parametrize("shading_samples", [1, 2, 3, 6])
def test_totals_of_techniques(w: tuple[float, ...], shading_samples: int) -> None:
    """All samples are divided, none to a share of 0, and a pixel's totals are ``n w_k``, within 1 for the first, and
    within as many as there are roundings for the others; `samples_before` is the running total.
    """
    pixels, spp = 300, 37
    offset = np.random.default_rng(14).random((len(w) - 1, pixels))
    counts = divide(np.repeat(np.array(w)[:, None], pixels, axis=1), shading_samples, 0, spp, offset)
    each = np.array([n.reshape(spp, pixels) for n in counts.of_technique], int)
    assert each.min() >= 0 and (each.sum(axis=0) == shading_samples).all()
    off = np.abs(each.sum(axis=1) - spp * shading_samples * np.array(w)[:, None])
    assert (off[0] < 1).all() and (off < len(w) - 1 + 1e-6).all() and not each[np.array(w) == 0].any()
    before = np.concatenate([np.zeros((len(w), 1, pixels), int), np.cumsum(each, axis=1)[:, :-1]], axis=1)
    np.testing.assert_array_equal(counts.samples_before.reshape(before.shape), before)


@each_shares
@pytest.mark.parametrize("random", [False, True])
def test_slots_have_the_shares_as_probabilities(w: tuple[float, ...], random: bool) -> None:
    """Over the offset, every slot of 12 goes to technique k with probability w_k: what unbiasedness rests on.

    With S = 1 a camera sample is a slot.
    """
    count = 20_000
    rng = np.random.default_rng(15)
    offset = rng.random((len(w) - 1, count))
    counts = divide(np.repeat(np.array(w)[:, None], count, axis=1), 1, 0, 12, offset, rng if random else None)
    for share, each in zip(w, counts.of_technique, strict=True):
        off = each.reshape(12, count).sum(axis=1) - count * share
        assert (np.abs(off) <= Z_LIMIT * np.sqrt(count * share * (1 - share))).all()


def test_whole_shares_are_numbers() -> None:
    """Where all counts are whole, they are the same for all camera samples; in float32, too."""
    thirds = np.full((3, 1), np.float32(1 / 3))
    for n in (3, 6):
        assert divide(thirds, n, 0, 4, np.zeros((2, 5))).of_technique == (n // 3,) * 3
    assert divide(0.5, 2, 0, 4, np.zeros(5)).of_technique == (1, 1)
    assert divide(np.array([[0.5], [0.25], [0.25]]), 4, 0, 4, np.zeros((2, 5))).of_technique == (2, 1, 1)
    only_first = np.array([[1.0], [0.0], [0.0]])
    assert divide(only_first, 2, 0, 4, np.zeros((2, 5)), np.random.default_rng(1)).of_technique == (2, 0, 0)
