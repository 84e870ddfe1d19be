"""Uniform numbers: reproducible, in range, uniform, stratified."""

import itertools
from typing import Any

import numpy as np
import pytest
from helpers import LEVEL, Z_LIMIT, image_tile, mean_and_error, pixel_shares
from scipy.stats import kstest

from dmis import render
from dmis.base.vectors import Array, take
from dmis.brdf.materials import matte
from dmis.brdf.models import rough_glass
from dmis.estimator.settings import Settings
from dmis.fit.round import Round
from dmis.geometry.shapes import quad, sphere
from dmis.geometry.transforms import translate
from dmis.light.area import DiskLight, QuadLight
from dmis.light.environment import EnvironmentLight
from dmis.pipeline.tile import render_tile
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import SAMPLERS, Independent, Sampler, register_sampler, stream
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.testing.scenes import box_scene
from dmis.testing.statistics import chi2_p

each_kind = pytest.mark.parametrize("kind", tuple(SAMPLERS))


def start(sampler: Sampler, first: int, count: int, pixels: int) -> None:
    """A batch of samples ``first`` to ``first + count`` of all pixels, sample-major."""
    sampler.start(np.tile(np.arange(pixels), count), np.repeat(np.arange(first, first + count), pixels))


def sampler_of(kind: str, pixels: int, spp: int, seed: int = 0, pass_: int = 0, tile: int = 0) -> Sampler:
    """The sampler of the first pixels of an image, with two shading samples."""
    return SAMPLERS[kind](PixelBlock(stream(seed, pass_, tile), seed, np.arange(pixels), [spp], 2))


def numbers(
    kind: str, seed: int = 0, pass_: int = 0, tile: int = 0, pixels: int = 7, spp: int = 16, key: object = "camera"
) -> Array:
    """Draws ``(2, spp, pixels)`` of one key in one block."""
    sampler = sampler_of(kind, pixels, spp, seed, pass_, tile)
    start(sampler, 0, spp, pixels)
    return sampler.draw(key, None).reshape(2, spp, pixels)


@each_kind
@pytest.mark.parametrize("spp", [1, 5, 64])
def test_marginals_are_uniform(kind: str, spp: int) -> None:
    """Each sample number of a pixel is uniform over pixels and seeds: no sample is special.

    Kolmogorov-Smirnov of the first, the second and the last sample of single pixels over 300 seeds, both coordinates.
    """
    u = np.stack([numbers(kind, seed, pixels=2, spp=spp) for seed in range(300)])
    for sample, pixel, axis in itertools.product({0, spp // 2, spp - 1}, (0, 1), (0, 1)):
        assert kstest(u[:, axis, sample, pixel], "uniform").pvalue > LEVEL


@each_kind
@pytest.mark.parametrize("keys", [("camera", (0, 0)), ((-2,), (-2, 0, 0)), ((0, 0), (0, -1, 0)), ("camera", (-3, 0))])
def test_two_draws_fill_four_dimensions(kind: str, keys: tuple[object, object]) -> None:
    """Within one pixel, two draws together reach each of 4^4 cells as often as chance would have them; and what
    depends on both is known the better the more samples there are. Points in the same order for all keys would lie on
    a plane, and 4,096 of them reach 16 cells.
    """
    spp, pixels = 4096, 40
    sampler = sampler_of(kind, pixels, spp, 1)
    start(sampler, 0, spp, pixels)
    u = np.concatenate([sampler.draw(key, None).reshape(2, spp, pixels) for key in keys])
    digits = (u * 4).astype(int)
    for pixel in range(0, pixels, 8):
        observed = np.bincount(np.ravel_multi_index(tuple(digits[:, :, pixel]), (4,) * 4), minlength=256)
        assert chi2_p(observed, np.full(256, spp / 256)) > LEVEL
    product = np.prod(2 * u[[0, 2]] - 1, axis=0)  # mean 0, variance 1/9
    for n in (64, 512, 4096):
        error = np.sqrt(np.mean(product[:n].mean(axis=0) ** 2))
        assert error < 1.6 / (3 * np.sqrt(n))  # of 40 pixels: 1 +- 0.11


@pytest.mark.parametrize("spp", [4, 16, 49])
@pytest.mark.parametrize("key", ["camera", (0, 0, 0)])
def test_stratified_fills_the_grid(spp: int, key: object) -> None:
    """n^2 samples have exactly one in each of n by n cells: the camera's, and those of a technique in every sample."""
    side = int(np.sqrt(spp))
    u = numbers("stratified", spp=spp, pixels=5, key=key)
    cell = (u[0] * side).astype(int) * side + (u[1] * side).astype(int)
    for pixel in range(5):
        np.testing.assert_array_equal(np.sort(cell[:, pixel]), np.arange(spp))


@pytest.mark.parametrize("key", ["camera", (0, 1, 0)])
def test_blocks_of_stratified_numbers_continue_the_sequence(key: object) -> None:
    """Blocks of 5 and 11, jittered by numbers of their own, use the same cells as one block of 16."""
    whole = numbers("stratified", key=key)
    sampler = sampler_of("stratified", 7, 16)
    parts = []
    for first, count in ((0, 5), (5, 11)):
        start(sampler, first, count, 7)
        parts.append(sampler.draw(key, None).reshape(2, count, 7))
    np.testing.assert_array_equal((np.concatenate(parts, axis=1) * 4).astype(int), (whole * 4).astype(int))


# The technique pattern and the camera's sequence -------------------------------------------------------------------


@each_kind
@pytest.mark.parametrize("w", [0.0, 0.25, 0.5, 1.0])
def test_edge_pixel_is_unbiased(kind: str, w: float) -> None:
    """A pixel that is half floor and half black paper has the same mean for every sampler and share, by a z-test.

    So is each of 100 pixels of an image, under stripes of paper, with four seeds. The truth is the integral of a closed
    form over the image, by a midpoint rule whose cells end at the edges of the paper.
    """
    light = DiskLight((0, 0, 3), (0, 0, -1), 1.0, (1, 1, 1))
    half = 4 * np.tan(np.radians(5))
    stripe = half / 10
    paper = [Part(quad((x, -2, 0.0001), (stripe, 0, 0), (0, 4, 0)), matte(0)) for x in stripe * (2 * np.arange(10) - 9)]
    scene = box_scene(matte(0.5), (light,), tuple(paper), (10, 10), eye=(0, 0, 4), fov=10, target=(0, 1e-4, 0))
    round_ = Round(8, pixel_shares(w), Settings(sampler=kind))
    tiles = [image_tile(scene, seed, round_) for seed in range(4)]
    mean, error = mean_and_error([render_tile(scene, tile).mean for tile in tiles])
    middles = half * ((np.arange(200) + 0.5) / 100 - 1)
    x, y = np.meshgrid(middles, middles)
    open_floor = np.floor((x + half) / stripe) % 2 == 0
    expected = 0.5 / np.pi * (_disk_irradiance(np.hypot(x, y), 3.0, 1.0) * open_floor).mean()
    assert abs(mean - expected) < Z_LIMIT * error


def _disk_irradiance(r: Array, height: float, radius: float) -> Array:
    """Irradiance of a point at distance r from the axis under a parallel disk of radiance 1 (configuration factor)."""
    h, k = height / np.maximum(r, 1e-9), radius / np.maximum(r, 1e-9)
    z = 1 + h * h + k * k
    return np.pi / 2 * (1 - (1 + h * h - k * k) / np.sqrt(z * z - 4 * k * k))


@pytest.mark.usefixtures("literature")
@pytest.mark.parametrize("rule, integrator", [("balance", "path"), ("resampled:0.5", "direct")])
@pytest.mark.parametrize("kind", [kind for kind in SAMPLERS if kind != "independent"])
def test_integrands_of_several_draws_converge(kind: str, rule: str, integrator: Any) -> None:
    """A path's light depends on the draws of all its surfaces, a resampled direction on two: with every sampler the
    mean of 1,024 samples scatters over seeds no more than independent samples say that it does.
    """
    light = QuadLight((-1, -1, 4), (0, 2, 0), (2, 0, 0), (6, 5, 4))
    glass = Part(sphere(1.0).transformed(translate((0, 0, 1.1))), rough_glass(alpha=0.3))
    floor = Part(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), matte(0.6))
    camera = Camera.look_at((5, -5, 4), (0, 0, 0.6), (0, 0, 1), fov=35, resolution=(12, 9))
    scene, settings = Scene(camera, (floor, glass), (light,)), Settings(integrator=integrator, max_depth=4)
    results = [render(scene, rule, 1024, seed=k, sampler=kind, settings=settings) for k in range(6)]
    variance = np.var([result.image for result in results], axis=0, ddof=1).mean()
    assert variance < 1.4 * np.mean([result.variance for result in results])


def test_streams_of_long_seeds() -> None:
    """A seed of several words is not the beginning of another's seed and pass; shorter ones are what they were."""
    numbers = [stream(*key).random() for key in ((5, 1, 0), (2**32 + 5, 0, 0), (2**32 + 5, 1, 0), (2**64 + 5, 0, 0))]
    assert len(set(numbers)) == 4


@each_kind
def test_errors_of_pixels_are_independent(kind: str) -> None:
    """Pixels that see the same have errors of their own: the mean of a tile is as much better as it has pixels."""
    camera = Camera.look_at((0, -0.5, 1.2), (0, 0.3, 0), fov=2, resolution=(32, 8))
    floor = Part(quad((-50, -50, 0), (100, 0, 0), (0, 100, 0)), matte(0.8))
    wall = Part(quad((-50, 1.5, -1), (100, 0, 0), (0, 0, 50)), matte(0.8))
    scene = Scene(camera, (floor, wall), (QuadLight((-1, -1, 1.5), (0, 2, 0), (2, 0, 0), (3, 3, 3)),))
    settings = Settings(integrator="path", max_depth=3)
    images = np.array([render(scene, "balance", 16, seed=k, sampler=kind, settings=settings).image for k in range(60)])
    images = images[..., 0].astype(float)
    assert images.mean(axis=(1, 2)).var(ddof=1) * 256 < 2 * images.var(axis=0, ddof=1).mean()


def test_no_number_is_drawn_twice() -> None:
    """Both sides of a sheet of rough glass, and all lights, take numbers of their own, and so do pixels and samples."""
    drawn: list[tuple[object, int]] = []

    class Noted(Independent):
        def start(self, pixel, number):
            self.pixel = pixel
            super().start(pixel, number)

        def draw(self, key, index, number=None):
            place = np.arange(self._size) if number is None else 100 * self.pixel
            drawn.extend((key, n) for n in (take(place, index) + (0 if number is None else number)).tolist())
            return super().draw(key, index, number)

    register_sampler("noted", Noted)
    lights = (QuadLight((-1, -1, 3), (0, 2, 0), (2, 0, 0), (8, 8, 8)), EnvironmentLight(1.0))
    render(box_scene(rough_glass(alpha=0.3), lights), "balance", 1, sampler="noted", parallel=1)
    # place in the pixel; for each side, light and technique a direction
    assert len({key for key, _ in drawn}) == 1 + 2 * 2 * 2 and len(set(drawn)) == len(drawn)
    drawn.clear()
    render(box_scene(lights=lights, resolution=(8, 3)), "fixed:0.3", 4, sampler="noted", parallel=1)
    assert len(set(drawn)) == len(drawn)
