"""Images averaged over footprints: levels, means, and a Gaussian by brute force."""

from typing import Any

import numpy as np
import pytest

from dmis.brdf.mipmap import MOST_LOOKUPS, averaged
from dmis.brdf.texture import Image

RNG = np.random.default_rng(7)
NOISE = RNG.random((64, 64, 3)).astype(np.float32)


def steps(x: Any, y: Any, n: int) -> tuple[np.ndarray, np.ndarray]:
    a, b = (np.repeat(np.array(v, np.float32).reshape(2, 1), n, axis=1) for v in (x, y))
    return a, b


@pytest.mark.parametrize("shape", [(64, 64), (5, 7), (1, 9), (3, 1), (1, 1)])
@pytest.mark.parametrize("channels", [1, 3])
def test_every_level_has_the_same_mean(shape: tuple[int, int], channels: int) -> None:
    """Also of odd sizes; 1e-5 is the rounding of float32 texels."""
    image = Image(RNG.random((*shape, channels)).astype(np.float32))
    for level in image.levels:
        np.testing.assert_allclose(level.texels.mean(axis=(0, 1)), image.texels.mean(axis=(0, 1)), rtol=1e-5)
    assert image.levels[-1].texels.shape[:2] == (1, 1)


def test_no_footprint_is_the_bilinear_lookup() -> None:
    uv = RNG.random((2, 50)).astype(np.float32)
    got = averaged(Image(NOISE), uv, steps((0, 0), (0, 0), 50))
    np.testing.assert_allclose(got, Image(NOISE)(uv), atol=1e-6)


def test_a_footprint_of_the_whole_image_is_its_mean() -> None:
    """So is a larger one, one without bounds, and one of a grey image's last level."""
    uv = RNG.random((2, 20)).astype(np.float32)
    for size in (1, 3, 1e20):
        got = averaged(Image(NOISE), uv, steps((size, 0), (0, size), 20))
        np.testing.assert_allclose(got, NOISE.mean(axis=(0, 1))[:, None] * np.ones((1, 20)), atol=1e-5)


@pytest.mark.parametrize("x, y", [((0.1, 0), (0, 0.1)), ((0.3, 0.3), (-0.06, 0.06)), ((0.01, 0.02), (0.25, 0))])
def test_a_ramp_stays_a_ramp(x: tuple[float, float], y: tuple[float, float]) -> None:
    """A footprint is even around its middle: a linear image keeps its values, but for texels' steps of 1 / 64."""
    ramp = Image(np.broadcast_to(np.arange(64, dtype=np.float32)[:, None, None] / 64, (64, 64, 1)), wrap="clamp")
    uv = np.float32([[0.5] * 9, np.linspace(0.45, 0.55, 9)])
    got = averaged(ramp, uv, steps(x, y, 9))[0]
    np.testing.assert_allclose(got, ramp(uv)[0], atol=1 / 64)


@pytest.mark.parametrize("x, y", [((8, 0), (0, 8)), ((3, 0), (0, 12)), ((16, 16), (-3, 3)), ((11, 0), (0, 11))])
def test_noise_falls_as_under_the_weights(x: tuple[float, float], y: tuple[float, float]) -> None:
    """White texels keep the variance that ``exp(-2 r^2) - exp(-2)`` over the ellipse leaves, to 30 %."""
    image, uv = Image(RNG.standard_normal((512, 512, 1)).astype(np.float32)), RNG.random((2, 20_000)).astype(np.float32)
    got = averaged(image, uv, steps(np.array(x) / 512, np.array(y) / 512, uv.shape[1])).var()
    r2, end = (np.arange(1000) + 0.5) / 1000, np.exp(-2)
    weight = np.exp(-2 * r2) - end
    expected = (weight**2).mean() / weight.mean() ** 2 / (np.pi * abs(x[0] * y[1] - x[1] * y[0]))
    assert got == pytest.approx(expected, rel=0.3)


def test_four_lookups_by_hand() -> None:
    """Of a footprint 4 texels long and less than one wide, whichever of its axes is the longer one."""
    uv, radii = RNG.random((2, 20)).astype(np.float32), np.array([-0.75, -0.25, 0.25, 0.75])
    weights = np.exp(-2 * radii**2) - np.exp(-2)
    along, across = (3.8 / 64, 1 / 64), (0, 0.5 / 64)
    places = [uv + np.float32(along)[:, None] * np.float32(r) for r in radii]
    expected = np.average([Image(NOISE)(place) for place in places], axis=0, weights=weights)
    for axes in ((along, across), (across, along)):
        np.testing.assert_allclose(averaged(Image(NOISE), uv, steps(*axes, 20)), expected, atol=1e-5)


def test_a_thin_footprint_is_as_wide_as_the_lookups_need() -> None:
    """Along an axis of 64 texels they are 8 texels wide: stripes of 2 texels across it are gone."""
    stripes = Image(np.tile(np.float32([0, 0, 1, 1]), 64)[None, :, None] * np.ones((256, 1, 1), np.float32))
    uv = RNG.random((2, 30)).astype(np.float32)
    got = averaged(stripes, uv, steps((0, 8 * MOST_LOOKUPS / 256), (0, 0), 30))
    np.testing.assert_allclose(got, 0.5, atol=0.02)
