"""The sampler ``lowdiscrepancy``: nets of each pixel and dimension, shuffled, and what it does for an integral."""

import numpy as np
import pytest
from helpers import LEVEL

from dmis.base.vectors import Array
from dmis.samplers.lowdiscrepancy import LowDiscrepancy
from dmis.samplers.pixel_block import CONTINUE, PixelBlock
from dmis.samplers.streams import stream
from dmis.testing.statistics import chi2_p


def sampler(seed: int, pixels: int, spp: int, shading_samples: int = 2) -> LowDiscrepancy:
    """A sampler of which a batch of all samples of all pixels has begun, sample-major."""
    out = LowDiscrepancy(PixelBlock(stream(seed, 0, 0), seed, np.arange(pixels), [spp], shading_samples))
    out.start(np.tile(np.arange(pixels), spp), np.repeat(np.arange(spp), pixels))
    return out


def blocks(seed: int, pixels: int, spp: int, count: int, key: object = (0, 0)) -> Array:
    """Numbers of `count` samples of each camera sample, ``(2, spp, count, pixels)``."""
    source = sampler(seed, pixels, spp, 2 * count)
    draws = [source.draw_block(key, None, i, count).reshape(2, spp, pixels) for i in range(count)]
    return np.stack(draws, axis=2)


def is_net(u: Array) -> bool:
    """Whether 2^k points ``(2, 2^k)`` have one in each elementary interval, of 2^-a by 2^-(k-a)."""
    n = u.shape[1]
    return all(
        len(np.unique((u[0] * 2**a).astype(int) * (n >> a) + (u[1] * (n >> a)).astype(int))) == n
        for a in range(n.bit_length())
    )


@pytest.mark.parametrize("spp", [1, 2, 16, 128])
@pytest.mark.parametrize("key", ["camera", (0, 0, 0), (CONTINUE,), (CONTINUE, CONTINUE, 0, 1, 0)])
def test_camera_samples_of_a_pixel_are_a_net(spp: int, key: object) -> None:
    u = sampler(3, 5, spp).draw(key, None).reshape(2, spp, 5)
    assert all(is_net(u[..., pixel]) for pixel in range(5))


@pytest.mark.parametrize(("spp", "count"), [(8, 4), (16, 16), (1, 8)])
def test_blocks_are_nets(spp: int, count: int) -> None:
    """The samples of each camera sample are a net, and so are all of the pixel."""
    u = blocks(1, 4, spp, count)
    for pixel in range(4):
        assert is_net(u[..., pixel].reshape(2, -1))
        assert all(is_net(u[:, k, :, pixel]) for k in range(spp))


def test_counts_that_are_no_powers_of_two() -> None:
    """5 camera samples of 3 samples use distinct points of a net of 8 times 4, each camera sample one of its blocks."""
    u = blocks(2, 50, 5, 3)
    cell = (u[0] * 32).astype(int)  # elementary intervals of 1/32 by 1
    assert all(len(np.unique(cell[..., pixel])) == 15 for pixel in range(50))
    quarter = (u[0] * 4).astype(int)
    assert all(len(np.unique(quarter[k, :, pixel])) == 3 for k in range(5) for pixel in range(50))
    # numbers by their place in a technique's sequence: the first 2^k of a pixel are a net for every k
    for n in (2, 8, 32):
        source = LowDiscrepancy(PixelBlock(stream(4, 0, 0), 4, np.arange(3), [100], 2))
        source.start(np.tile(np.arange(3), n), np.repeat(np.arange(n), 3))
        u = source.draw((0, 1), None, np.repeat(np.arange(n), 3)).reshape(2, n, 3)
        assert all(is_net(u[..., pixel]) for pixel in range(3))


def test_orders_are_uniform() -> None:
    """Which two of four blocks, and which two of the four points of a block, come first: chi-square over 12 pairs.

    A block or point is known by the rank of its first coordinate among the four, which the order decides.
    """
    points = np.concatenate([blocks(seed, 100, 4, 4) for seed in range(40)], axis=-1)
    for order in (points[:, :, 0], points[:, 0]):
        rank = np.argsort(np.argsort(order[0], axis=0), axis=0)
        observed = np.bincount(rank[0] * 4 + rank[1], minlength=16).reshape(4, 4)
        observed = observed[~np.eye(4, dtype=bool)]
        assert chi2_p(observed, np.full(12, order.shape[-1] / 12)) > LEVEL


def test_late_bounces_have_random_numbers() -> None:
    """Vertices of a path from the fourth on are as uneven as random numbers: not one of 20 pixels has a net.

    Three have sequences, pbrt-v2's SAMPLE_DEPTH; `test_camera_samples_of_a_pixel_are_a_net` has the third.
    """
    spp = 64
    for key in ((*[CONTINUE] * 3, 0, 0), (*[CONTINUE] * 4,)):
        source = sampler(7, 20, spp)
        u = source.draw_block(key, None, 0, 1).reshape(2, spp, 20)
        assert not any(is_net(u[..., pixel]) for pixel in range(20))
        assert u.shape == source.draw(key, None, np.zeros(20 * spp, int)).reshape(2, spp, 20).shape
