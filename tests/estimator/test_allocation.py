"""Division of shading samples, and the batches of camera samples of a tile."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import LEVEL, Z_LIMIT, pixel_shares

from dmis import Settings
from dmis.base.vectors import Array
from dmis.estimator.allocation import (
    allocate,
    random_counts,
    restore_order,
    sample_batches,
    shares_of,
    systematic_counts,
    whole_counts,
)
from dmis.estimator.cost import camera_sample_cost, pattern_costs, relative_costs
from dmis.estimator.mis import BRDF
from dmis.estimator.patterns import PATTERNS
from dmis.estimator.records import Record
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import Numbers
from dmis.testing.statistics import chi2_p

PIXELS = 12
UNEVEN = np.random.default_rng(3).integers(1, 40, PIXELS)


def in_blocks(blocks):
    pixels = [np.tile(block.pixels, block.count) for block in blocks]
    numbers = [np.repeat(np.arange(block.first, block.first + block.count), len(block.pixels)) for block in blocks]
    return np.concatenate(pixels), np.concatenate(numbers)


@pytest.mark.parametrize("spp", [1, 7, 100, UNEVEN], ids=["1", "7", "100", "uneven"])
@pytest.mark.parametrize("size", [5, 64, 10**6])
def test_batches_have_every_camera_sample_once(spp, size):
    """Each pixel has its numbers 0, 1, .. in ascending order, at the columns of its blocks.

    No batch is larger than twice the size asked for.
    """
    numbers = [[] for _ in range(PIXELS)]
    for blocks in sample_batches(spp, np.arange(PIXELS), size):
        pixel, number = in_blocks(blocks)
        assert len(pixel) <= max(2 * size, 2 * PIXELS)
        places = [pixel[block.columns].reshape(block.count, -1) for block in blocks]
        assert all((at == block.pixels).all() for at, block in zip(places, blocks, strict=True))
        for p, n in zip(pixel, number, strict=True):
            numbers[p].append(n)
    for pixel, expected in enumerate(np.broadcast_to(spp, PIXELS)):
        assert numbers[pixel] == list(range(expected))


def allocated(batches, shares, spp, settings):
    """Blocks and camera samples of a tile with the sampler of the settings."""
    rng = np.random.default_rng(2)
    block = PixelBlock(rng, 1, np.arange(PIXELS), np.unique(spp).tolist(), settings.shading_samples)
    numbers = Numbers(settings.sampler, block)
    return allocate(batches, shares, numbers.rounding_offsets(len(shares) - 1, PIXELS), settings, numbers)


@pytest.mark.parametrize("sampler", ["independent", "sobol"])
@pytest.mark.parametrize("allocation", ["systematic", "random"])
def test_order_of_counts_and_back(allocation, sampler):
    """Counts for the first technique descend, and values and records of the samples return to the blocks' order."""
    shares = pixel_shares(np.random.default_rng(1).random(PIXELS))
    settings = Settings(allocation=allocation, shading_samples=4, sampler=sampler)
    batches = sample_batches(UNEVEN, np.arange(PIXELS), 64)
    for blocks, samples in allocated(batches, shares, UNEVEN, settings):
        assert (np.diff(samples.counts[0].astype(int)) <= 0).all() and np.ptp(samples.counts[0]) > 0
        assert (samples.samples_before is None) == (settings.allocation == "random" or sampler == "independent")
        values = np.stack([samples.pixel, samples.number, samples.counts[0]]).astype(np.float32)
        record = Record(0, (0,), 0, np.array([2, 0]), values[:, [2, 0]], values[:2, [2, 0]])
        restored, (moved,) = restore_order(samples.order, values, [record])
        pixel, number = in_blocks(blocks)
        np.testing.assert_array_equal(restored[:2], [pixel, number])
        np.testing.assert_array_equal(restored[:, moved.sample], record.value)


# Division of shading samples -----------------------------------------------------------------------------------


def divide(w, shading_samples: int, start: int, count: int, offset: Array):
    """Counts and samples before, of samples `start` to ``start + count`` of all pixels, sample-major.

    `w` is all shares, or the first of two.
    """
    pixels = offset.shape[-1]
    pixel, number = np.tile(np.arange(pixels), count), np.repeat(np.arange(start, start + count), pixels)
    shares = w if np.ndim(w) == 2 else pixel_shares(w)
    return systematic_counts(shares, shading_samples, pixel, number, np.atleast_2d(offset))


@pytest.mark.parametrize("w", [0.0, 0.25, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("shading_samples", [1, 2, 4])
def test_a_number_is_the_same_as_a_map(w: float, shading_samples: int) -> None:
    offset = np.random.default_rng(6).random(50)
    (one, *_), _ = divide(w, shading_samples, 3, 6, offset)
    (many, *_), _ = divide(np.full(50, w), shading_samples, 3, 6, offset)
    np.testing.assert_array_equal(one, many)
    if whole := whole_counts(pixel_shares(w), shading_samples):
        assert (one == whole[0]).all()


def test_blocks_continue() -> None:
    """Samples 0 to 9 in one block, or in blocks of 4 and 6, are divided alike."""
    offset, w = np.random.default_rng(7).random(20), np.random.default_rng(8).random(20)
    whole = divide(w, 2, 0, 10, offset)
    parts = zip(divide(w, 2, 0, 4, offset), divide(w, 2, 4, 6, offset), strict=True)
    for expected, part in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(np.concatenate(part, axis=1), expected)


@pytest.mark.parametrize("w", [0.25, 0.5])
@pytest.mark.parametrize("shading_samples", [1, 3])
def test_random_allocation_is_binomial(w: float, shading_samples: int) -> None:
    """The one-sample model: counts are binomial, whatever the neighbours have."""
    from scipy.stats import binom

    rng, count = np.random.default_rng(11), 40000
    first, _ = random_counts(pixel_shares(w), rng.random((shading_samples, count)), np.zeros(count, int))
    observed = np.bincount(first, minlength=shading_samples + 1)
    expected = binom.pmf(np.arange(shading_samples + 1), shading_samples, w) * count
    assert chi2_p(observed, expected) > LEVEL


# Shares of any number of techniques --------------------------------------------------------------------------------

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


@pytest.mark.parametrize("weight", [0.3, 1.0, np.linspace(0, 1, 6).reshape(2, 3)])
def test_shares_of_the_first_of_two(weight: float | Array) -> None:
    """A number or a map w becomes ``(w, 1 - w)``, of sum 1 in float32, too; shares of all techniques stay."""
    shares = shares_of(weight)
    assert shares.dtype == np.float32 and shares.shape == (2, *np.shape(weight))
    np.testing.assert_array_equal(shares[0], np.float32(weight))
    np.testing.assert_allclose(shares[1], 1 - np.asarray(weight), atol=1e-7)
    np.testing.assert_array_equal(shares.sum(axis=0), np.ones(np.shape(weight)))
    np.testing.assert_array_equal(shares_of(shares), shares)


@each_shares
@pytest.mark.parametrize("shading_samples", [1, 2, 3, 6])
def test_totals_of_techniques(w: tuple[float, ...], shading_samples: int) -> None:
    """All samples are divided, none to a share of 0, and a pixel's totals are ``n w_k``, within 1 for the first, and
    within as many as there are roundings for the others; `samples_before` is the running total.
    """
    pixels, spp = 300, 37
    offset = np.random.default_rng(14).random((len(w) - 1, pixels))
    counts, running = divide(np.repeat(np.array(w)[:, None], pixels, axis=1), shading_samples, 0, spp, offset)
    each = np.array([n.reshape(spp, pixels) for n in counts], int)
    assert each.min() >= 0 and (each.sum(axis=0) == shading_samples).all()
    off = np.abs(each.sum(axis=1) - spp * shading_samples * np.array(w)[:, None])
    assert (off[0] < 1).all() and (off < len(w) - 1 + 1e-6).all() and not each[np.array(w) == 0].any()
    before = np.concatenate([np.zeros((len(w), 1, pixels), int), np.cumsum(each, axis=1)[:, :-1]], axis=1)
    np.testing.assert_array_equal(running.reshape(before.shape), before)


@each_shares
@pytest.mark.parametrize("random", [False, True])
def test_slots_have_the_shares_as_probabilities(w: tuple[float, ...], random: bool) -> None:
    """Over the offset, every slot of 12 goes to technique k with probability w_k: what unbiasedness rests on.

    With S = 1 a camera sample is a slot.
    """
    count = 20_000
    rng = np.random.default_rng(15)
    offset = rng.random((len(w) - 1, count))
    shares = np.repeat(np.array(w)[:, None], count, axis=1)
    counts, _ = divide(shares, 1, 0, 12, offset)
    if random:
        counts = random_counts(shares, rng.random((1, 12 * count)), np.tile(np.arange(count), 12))
    for share, each in zip(w, counts, strict=True):
        off = each.reshape(12, count).sum(axis=1) - count * share
        assert (np.abs(off) <= Z_LIMIT * np.sqrt(count * share * (1 - share))).all()


# Costs ----------------------------------------------------------------------------------------------------------------

RAYS = {"camera": 80, "untraced": 20, "shadow": 300, "brdf": 60, "costly": 450, "delta": 100, "guide": 7}
COSTLY = replace(BRDF, name="costly", rays="costly", cost=2.3)


@pytest.mark.parametrize(("lights", "expected"), [(1, [10.97, 46.65]), (3, [23.17, 120.25])])
@pytest.mark.parametrize("onward", [{"bounce 1": 70, "bounce 2": 30}, {"specular": 100}])
def test_cost_by_hand(lights: int, expected: list[float], onward: dict[str, int]) -> None:
    """100 camera samples of 2 points each: a point costs 1, and its delta rays .25 + .4 per camera sample, 2.65 in all.

    In the pilot each technique took 100 * 2 * 6 / 3 = 400 samples. Before its ray one costs .25 for each light (the
    costly one 2.3), its ray .4 * 300 / 400 (light), .4 * 60 / 400 (BRDF), .4 * 450 / 400 (costly): of one light .55,
    .31 and 2.75, of three 1.05, .81 and 7.35. A final camera sample has 4 of all three, or 8 costly ones, per point:
    2.65 + 8 (.5 * .55 + .25 * .31 + .25 * 2.75), and 2.65 + 16 * 2.75.
    """
    shares, techniques = np.array([[0.5, 0], [0.25, 0], [0.25, 1]]), ("light", "brdf", COSTLY)
    cost = camera_sample_cost(RAYS | onward, shares, 6, np.array([4, 8]), techniques, lights)
    np.testing.assert_allclose(cost, expected)


def test_costs_of_lights_by_hand() -> None:
    """In the other colours 300 camera samples of 8 shading samples of two lights, and 120 rays to delta lights.

    The pattern n_l : n_b is of 2 n_l and 2 n_b samples, which cost .5 + .4 * 900 / 1200 and .5 + .4 * 180 / 1200.
    """
    rays = {"camera": 100, "shadow": 300, "brdf": 60, "delta": 40}
    cost, of_lights = pattern_costs({kind: 3 * n for kind, n in rays.items()}, 8, ("light", "brdf"), 2)
    n_l, n_b = np.transpose(PATTERNS)
    samples, deltas = 2 * n_l * 0.8 + 2 * n_b * 0.56, 0.65 * 120 / 300
    np.testing.assert_allclose(cost, (1 + deltas + samples) / (1 + deltas + 2.72))
    expected = np.array([samples / 2, samples / 2, deltas + 0 * samples]) / (1 + deltas + 2.72)
    np.testing.assert_allclose(of_lights, expected)


def test_costs_of_pixels_by_hand() -> None:
    """A surface costs 1, and .25 for each of 4 samples of 3 lights; an occlusion ray .4."""
    np.testing.assert_allclose(relative_costs(np.array([1.0, 2]), np.array([5.0, 0]), 4, 3), [1 + 3 + 2, 8])
