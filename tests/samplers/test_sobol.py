"""The sampler ``sobol``: evenness of each pair and of pairs together, the same bits however an image is cut, errors."""

import itertools

import numpy as np
import pytest
from helpers import LEVEL, pixel_shares

import dmis
from dmis.base.vectors import Array
from dmis.brdf.materials import matte
from dmis.estimator.allocation import allocate, sample_batches
from dmis.estimator.settings import Settings
from dmis.fit.round import Round
from dmis.light.area import DiskLight
from dmis.pipeline import tile as tiles
from dmis.samplers.pixel_block import CONTINUE, LENS, MORE, ROUNDING, PixelBlock
from dmis.samplers.sobol import Sobol, order_of
from dmis.samplers.streams import Numbers, stream
from dmis.testing.scenes import box_scene
from dmis.testing.statistics import chi2_p

LIGHT, NEXT, NEXT_LIGHT = (0, 0), (CONTINUE,), (CONTINUE, 0, 0)
PATH = ("camera", LIGHT, NEXT_LIGHT, (CONTINUE, CONTINUE, 0, 0), (CONTINUE, CONTINUE, CONTINUE, 0, 0))
"""Pairs of which each meets those before it in the product along a path."""


def sampler(pixels: Array | int, seed: int = 3) -> Sobol:
    """A sampler of some pixels of an image, or of the first ones."""
    return Sobol(block_of(pixels, seed))


def block_of(pixels: Array | int, seed: int = 3) -> PixelBlock:
    pixels = np.arange(pixels) if isinstance(pixels, int) else pixels
    return PixelBlock(stream(seed, 0, 0), seed, pixels, [16], 2)


DIGITS = 24
"""Of float32 numbers below 1."""


def draws(keys: tuple, n: int, pixels: int, seed: int = 3) -> Array:
    """The pairs of the first n camera samples, ``(2 keys, n, pixels)`` float64."""
    source = sampler(pixels, seed)
    source.start(np.tile(np.arange(pixels), n), np.repeat(np.arange(n), pixels))
    return np.concatenate([source.draw(key, None).reshape(2, n, pixels) for key in keys]).astype(float)


def digits(u: Array) -> np.ndarray:
    """The binary digits of numbers in [0, 1), as whole numbers."""
    return (u * 2.0**DIGITS).astype(np.int64)


def compositions(k: int, parts: int) -> list[tuple[int, ...]]:
    """All ways to write k as a sum of so many whole numbers."""
    if parts == 1:
        return [(k,)]
    return [(a, *rest) for a in range(k + 1) for rest in compositions(k - a, parts - 1)]


def evenness_by_counting(u: Array) -> int:
    """The largest k such that all boxes of volume 2^-k, with sides of 2^-d, hold as many of the points ``(s, 2^m)``."""
    s, n = u.shape
    for k in itertools.count():
        for widths in compositions(k + 1, s):
            cell = np.zeros(n, np.int64)
            for row, d in zip(digits(u), widths, strict=True):
                cell = (cell << d) | (row >> (DIGITS - d))
            if n < 2 ** (k + 1) or np.ptp(np.bincount(cell, minlength=2 ** (k + 1))):
                return k


def evenness_by_rank(columns: list[list[int]], limits: list[int]) -> int:
    """The same from generator matrices: ``columns[j][c]`` has the digits of coordinate j of point 2^c.

    All points of a digital net are sums of them, and boxes are equally filled where the first digits of the coordinates
    are linearly independent functions of the index. `limits` ends the digits of single coordinates.
    """
    rows = [[sum((v >> (DIGITS - 1 - r) & 1) << c for c, v in enumerate(a)) for r in range(DIGITS)] for a in columns]

    def independent(k: int, j: int, basis: dict[int, int]) -> bool:
        if j == len(rows):
            return True
        for d in range(min(k, limits[j]) + 1):
            if d:
                row = rows[j][d - 1]
                while row and (row & -row) in basis:
                    row ^= basis[row & -row]
                if not row:
                    return False
                basis = {**basis, row & -row: row}
            if not independent(k - d, j + 1, basis):
                return False
        return True

    k = 0
    while k < len(columns[0]) and independent(k + 1, 0, {}):
        k += 1
    return k


def generator_columns(keys: tuple, m: int, samples: int = 1) -> list[list[int]]:
    """Columns of the generator matrices of `keys`, of which those after the first have several points per sample."""
    source = sampler(1)
    extra = samples.bit_length() - 1
    out: list[list[int]] = []
    for which, key in enumerate(keys):
        index = np.concatenate([[0], 2 ** np.arange(m + extra)]) >> (0 if which else extra)
        source.start(np.zeros(len(index), int), index)
        points = digits(source.draw(key, None))
        out += (points[:, 1:] ^ points[:, :1]).tolist()
    return out


# One pair ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", [*PATH, (LENS,), NEXT, (0, MORE, 0), (ROUNDING, 0), (CONTINUE,) * 12])
def test_each_pair_is_a_sequence_of_nets(key: object) -> None:
    """2^m points from a multiple of 2^m on have one in each elementary interval, in every pixel, m up to 10."""
    u = draws((key,), 2**11, 3)
    for m, pixel in itertools.product(range(11), range(3)):
        for begin in (0, 2**m, 2**11 - 2**m):
            assert evenness_by_counting(u[:, begin : begin + 2**m, pixel]) == m


def test_indices_beyond_one_table() -> None:
    """Point i is the sum modulo 2 of the points of its digits, up to 2^23 (a million camera samples with 8 each)."""
    source = sampler(1)
    for key in PATH:
        columns = np.array(generator_columns((key,), 23))
        index = np.random.default_rng(1).integers(2**23, size=500)
        source.start(np.zeros(501, int), np.append(0, index))
        points = digits(source.draw(key, None))
        bits = (index[:, None] >> np.arange(23) & 1).astype(bool)
        expected = np.bitwise_xor.reduce(np.where(bits, columns[:, None], 0), axis=-1)
        np.testing.assert_array_equal(points[:, 1:] ^ points[:, :1], expected)


# Pairs together ------------------------------------------------------------------------------------------------------


NETS = [(("camera", LIGHT), 3), (("camera", NEXT_LIGHT), 4), ((LIGHT, NEXT_LIGHT), 4)]
NETS += [(("camera", (LENS,)), 4), (((LENS,), LIGHT), 5)]


@pytest.mark.parametrize(("keys", "t"), NETS)
def test_two_pairs_are_a_net(keys: tuple, t: int) -> None:
    """t of the first 2^m points in four dimensions: by counting to 2^10, where it is that by rank, and so to 2^16."""
    columns = generator_columns(keys, 16)
    by_rank = [m - evenness_by_rank([a[:m] for a in columns], [m] * 4) for m in range(1, 17)]
    assert max(by_rank) <= t and max(by_rank[:10]) <= 3
    u = draws(keys, 2**10, 2)
    for m in range(1, 11):
        assert [m - evenness_by_counting(u[:, : 2**m, pixel]) for pixel in range(2)] == [by_rank[m - 1]] * 2


@pytest.mark.parametrize("samples", [2, 4])
def test_light_samples_of_a_camera_sample_are_neighbours(samples: int) -> None:
    """2^m camera samples with 2 or 4 light samples each are even together to 2^-(m-3), m up to 14."""
    for m in range(4, 15):
        columns = generator_columns(("camera", LIGHT), m, samples)
        assert evenness_by_rank(columns, [m] * 4) >= m - 3


def test_orders_along_a_path() -> None:
    """Pairs that meet in a product have orders of their own; those of one vertex share one."""
    assert [order_of(key) for key in ((), *PATH[1:])] == [0, 1, 2, 3, 4]
    assert order_of((1, 0)) == order_of((0, 1)) == order_of(NEXT) == 1
    assert order_of((0, MORE, 0)) == order_of((CONTINUE, CONTINUE)) == 2
    # also keys of zeros, which a hash may not tell apart
    first = draws(("camera", (0,), (0, 0), (0, 0, 0), (1, 0), (0, 1)), 1, 50)
    assert len(np.unique(first)) == first.size and len(np.unique(digits(first) % 256)) > 200


# The same bits -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["camera", LIGHT, NEXT])
def test_numbers_depend_on_nothing_else(key: object) -> None:
    """A sample's numbers are the same in another tile, batch and pass, and of another seed or pixel they are others."""
    whole = draws((key,), 32, 20)
    source = Sobol(PixelBlock(stream(9, 9, 9), 3, np.arange(15, 4, -1), [16, 17], 8))
    source.start(np.tile(np.arange(11), 7), np.repeat(np.arange(16, 23), 11))
    np.testing.assert_array_equal(source.draw(key, None).reshape(2, 7, 11), whole[:, 16:23, 15:4:-1])
    assert (draws((key,), 32, 20, seed=4) != whole).mean() > 0.99
    assert (np.diff(whole, axis=-1) != 0).mean() > 0.99


def test_images_do_not_depend_on_tiles_and_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles of two sizes in two passes, at shares that need rounding."""
    light = DiskLight((0, 0, 3), (0, 0, -1), 1.0, (1, 1, 1))
    scene = box_scene(matte(0.5), (light,), eye=(0, 0, 4), resolution=(20, 12), fov=10, target=(0, 1e-4, 0))
    settings = Settings(sampler="sobol", integrator="direct", max_depth=5)
    round_ = Round(8, np.array([0.3, 0.7], np.float32), settings)
    images = []
    for side, pass_ in ((32, 0), (4, 3)):
        monkeypatch.setattr(tiles, "MIN_SIDE", side)
        monkeypatch.setattr(tiles, "MAX_SIDE", side)
        image = np.zeros((12, 20, 3), np.float32)
        for tile in tiles.make_tiles((20, 12), 5, pass_, round_):
            image[tile.area] = tiles.render_tile(scene, tile).mean
        images.append(image)
    np.testing.assert_array_equal(*images)


# Pixels and the hash -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["camera", LIGHT])
def test_shifts_are_uniform_and_independent(key: object) -> None:
    """Over pixels, seeds and pairs a sample is in each of 8 by 8 cells as often as chance has it, and so are two
    neighbours, two seeds and two pairs.
    """
    u = draws((key,), 4, 40_000)[:, 2]
    other_seed, other_key = draws((key,), 4, 40_000, seed=4)[:, 2], draws(((3, 1),), 4, 40_000)[:, 2]
    couples = [u, *(np.stack([u[0], a]) for a in (np.roll(u[0], 1), np.roll(u[1], 200), other_seed[0], other_key[0]))]
    for a, b in couples:
        assert chi2_p(np.histogram2d(a, b, 8, [[0, 1], [0, 1]])[0], np.full((8, 8), 40_000 / 64)) > LEVEL


# Errors --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bounces", range(5))
def test_lights_are_picked_evenly(bounces: int) -> None:
    """Of 128 points 64 pick each of two lights, and 16 each of eight; those of one have their points on it in 2x2."""
    pixels, spp = 20, 128
    source = sampler(pixels)
    numbers = Numbers("sobol", block_of(pixels))
    pixel, number = np.tile(np.arange(pixels), spp), np.repeat(np.arange(spp), pixels)
    numbers.start(pixel, number)
    path = (CONTINUE,) * bounces
    source.start(pixel, number)
    u = numbers.light((*path, 0), None).reshape(spp, pixels)
    for lights in (2, 8):
        picked = (u * lights).astype(int)
        assert (np.array([np.count_nonzero(picked == k, axis=0) for k in range(lights)]) == spp // lights).all()
    x, y = (source.draw((*path, 0, 0, 0), None).reshape(2, spp, pixels) * 2).astype(int)
    cell = 4 * (u >= 0.5) + 2 * x + y
    counts = np.array([np.count_nonzero(cell == k, axis=0) for k in range(8)])
    assert (counts == spp // 8).all()


# Counts that need rounding -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("w", "shading_samples"), [(0.25, 1), (0.3, 4), (0.8, 2)])
def test_rounded_counts_are_even(w: float, shading_samples: int) -> None:
    """2^k camera samples give w S 2^k samples to the light, within one, in each half of the pixel nearly half of them,
    and no two samples of a technique have the same number.
    """
    pixels, spp = 50, 64
    settings = Settings(sampler="sobol", shading_samples=shading_samples)
    source = sampler(pixels)
    shares = pixel_shares(np.full(pixels, w))
    batches = sample_batches(spp, np.arange(pixels), 10**6)
    numbers = Numbers("sobol", block_of(pixels))
    ((_, samples),) = allocate(batches, shares, numbers.rounding_offsets(1, pixels), settings, numbers)
    first, before = np.asarray(samples.counts[0]).astype(int), samples.samples_before
    assert before is not None
    source.start(samples.pixel, samples.number)
    left = source.draw("camera", None)[0] < 0.5
    for pixel in range(pixels):
        mine = samples.pixel == pixel
        assert abs(first[mine].sum() - w * shading_samples * spp) <= 1
        assert abs(first[mine & left].sum() - w * shading_samples * spp / 2) <= 2
        for count, place in ((first[mine], before[0][mine]), (shading_samples - first[mine], before[1][mine])):
            numbers = np.concatenate([np.arange(a, a + n) for a, n in zip(place, count, strict=True)])
            assert len(np.unique(numbers)) == len(numbers)


def test_each_technique_goes_on_in_its_own_sequence(monkeypatch: pytest.MonkeyPatch) -> None:
    """At w = 1/4 and S = 2 the last of 16 camera samples has some 7 light and 23 BRDF samples before it."""
    largest, direction = {0: 0, 1: 0}, Numbers.direction

    def spied(self, key, i, sample, count, before, numbers=2):
        largest[key[-1]] = max(largest[key[-1]], int(before.max()))
        return direction(self, key, i, sample, count, before, numbers)

    monkeypatch.setattr(Numbers, "direction", spied)
    dmis.render(box_scene(resolution=(8, 6)), "fixed:0.25", 16, sampler="sobol", integrator="direct", parallel=1)
    assert 6 <= largest[0] <= 8 and 22 <= largest[1] <= 24
