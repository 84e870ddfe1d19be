"""Textures: bilinear lookup, wrap modes, products."""

import pickle
from typing import Any

import numpy as np
import pytest

from dmis.base.vectors import Array
from dmis.brdf.texture import Image, Images, Wrap, scale

TEXELS = np.random.default_rng(4).random((3, 4, 3)).astype(np.float32)


def at(image: Image, s: float, t: float) -> Array:
    return image(np.array([[s], [t]], np.float32))[:, 0]


def centre(j: int, i: int) -> tuple[float, float]:
    return (j + 0.5) / 4, (i + 0.5) / 3


@pytest.mark.parametrize("wrap", ["repeat", "black", "clamp"])
def test_texel_centres_are_exact(wrap: str) -> None:
    """Texel (i, j) is centred at ((j+.5)/W, (i+.5)/H), row 0 at t = 0; 1e-6 is a few float32 roundings."""
    for i in range(3):
        for j in range(4):
            np.testing.assert_allclose(at(Image(TEXELS, wrap=wrap), *centre(j, i)), TEXELS[i, j], atol=1e-6)


def test_lookups_between_and_beyond_centres() -> None:
    """Between centres the lookup is bilinear."""
    image = Image(TEXELS)
    np.testing.assert_allclose(at(image, 0.25, 0.5 / 3), (TEXELS[0, 0] + TEXELS[0, 1]) / 2, atol=1e-6)
    np.testing.assert_allclose(at(image, 0.5, 1 / 3), TEXELS[:2, 1:3].mean(axis=(0, 1)), atol=1e-6)
    # outside, clamp is the nearest edge texel and black is 0; at the edge black is half of it
    for s, t, texel in ((-0.5, 0.5, TEXELS[1, 0]), (7.0, 0.5, TEXELS[1, 3]), (0.5 / 4, 9.0, TEXELS[2, 0])):
        np.testing.assert_allclose(at(Image(TEXELS, wrap="clamp"), s, t), texel, atol=1e-6)
        assert not at(Image(TEXELS, wrap="black"), s, t).any()
    np.testing.assert_allclose(at(Image(TEXELS, wrap="black"), 0.0, 0.5), TEXELS[1, 0] / 2, atol=1e-6)
    # ``(s, t) = uv * scale + offset``
    moved = Image(TEXELS, scale=(2.0, -3.0), offset=(0.3, 0.1))
    np.testing.assert_allclose(at(moved, 0.2, 0.4), at(Image(TEXELS), 0.7, -1.1), atol=1e-5)


@pytest.mark.parametrize("wrap", ["repeat", "black", "clamp"])
@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 5, 1), (4, 1, 3)])
def test_thin_images(wrap: str, shape: tuple[int, int, int]) -> None:
    """One texel wide or high works in every mode, with values between 0 and the largest, anywhere."""
    texels = np.random.default_rng(5).random(shape).astype(np.float32)
    image = Image(texels, wrap=wrap)
    uv = np.random.default_rng(6).uniform(-3, 3, (2, 500)).astype(np.float32)
    uv[:, :4] = [[0, 1, -1, 1 - 2**-24], [1, 0, 1, 1 - 2**-24]]
    out = image(uv)
    assert out.shape == (image.texels.shape[2], 500) and out.dtype == np.float32
    assert (out >= 0).all() and (out <= texels.max() + 1e-6).all()


def test_grey_and_products() -> None:
    """Constants and images multiply in either order; colour times grey image is a colour image."""
    assert scale(2.0, (0.1, 0.2, 0.3)) == pytest.approx((0.2, 0.4, 0.6))
    assert scale(0.5, 0.5) == pytest.approx((0.25,))
    grey = Image(TEXELS[..., :1], offset=(0.1, 0.2), wrap="clamp")
    for product in (scale(grey, (1.0, 2.0, 3.0)), scale((1.0, 2.0, 3.0), grey)):
        np.testing.assert_allclose(product.texels, TEXELS[..., :1] * np.float32([1, 2, 3]), rtol=1e-6)
        assert (product.offset, product.wrap) == (grey.offset, grey.wrap)
    with pytest.raises(ValueError, match="product of two image textures"):
        scale(grey, grey)
    # three equal channels become one
    assert Image(np.repeat(TEXELS[..., :1], 3, axis=2)).texels.shape == (3, 4, 1)
    assert Image(TEXELS).texels.shape == (3, 4, 3)


@pytest.mark.parametrize("across", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("down", ["repeat", "mirror", "clamp"])
def test_wrap_of_each_axis(across: Wrap, down: Wrap) -> None:
    """An image is the same as one that holds its neighbours, also between texels; a pair of one is that one."""
    texels = np.random.default_rng(3).random((3, 4, 1))

    def neighbours(n: int, wrap: Wrap) -> Array:
        k = np.arange(-n, 2 * n)
        return {"repeat": k % n, "mirror": np.where((k < 0) | (k >= n), -k - 1, k) % n, "clamp": k.clip(0, n - 1)}[wrap]

    large = Image(texels[neighbours(3, down)][:, neighbours(4, across)], (1 / 3, 1 / 3), (1 / 3, 1 / 3))
    uv = (2.6 * np.random.default_rng(4).random((2, 200)) - 0.8).astype(np.float32)
    image = Image(texels, wrap=(across, down))
    np.testing.assert_allclose(image(uv), large(uv), atol=2e-5)
    assert (image.wrap == across) == (across == down)


@pytest.mark.parametrize(
    "texels, options, message",
    [
        (np.ones((2, 2)), {}, "texels must have shape"),
        (np.full((2, 2, 3), 200, np.uint8), {}, "texels must be linear values"),
        (["wood.png"], {}, "texels must be an array of numbers"),
        (np.ones((0, 2, 3)), {}, "texels must have shape"),
        (np.full((1, 1, 1), np.nan), {}, "texels must be finite"),
        (np.ones((1, 1, 1)), {"wrap": "mirrored"}, "wrap must be repeat or mirror or black or clamp; got 'mirrored'"),
        (np.ones((1, 1, 1)), {"scale": (1e39, 1)}, r"scale must be within 1e\+15"),
        (np.ones((1, 1, 1)), {"offset": (0, np.nan)}, r"offset must be within 1e\+15"),
    ],
)
def test_bad_images(texels: Any, options: dict[str, Any], message: str) -> None:
    """Errors name the argument and the constraint."""
    with pytest.raises(ValueError, match=message):
        Image(texels, **options)


@pytest.mark.parametrize("wrap", ["repeat", "black", "clamp"])
def test_farthest_coordinates(wrap: Any) -> None:
    """The farthest coordinates that a mesh may have, scaled as far as may be, are texels as well."""
    uv = np.array([[1e18, -1e18, 0.3], [0.2, 1e18, -1e18]], np.float32)
    far = Image(np.ones((4, 2**12, 1)), scale=(1e15, -1e15), offset=(-1e15, 1e15), wrap=wrap)
    assert np.isin(far(uv), (0, 1)).all()


def test_pickles_leave_out_what_can_be_made_again() -> None:
    """A scene is sent to each worker: the copy of its texels that lookups read is not, and lookups are the same."""
    image = Image(np.random.default_rng(1).random((64, 64, 3)))
    uv = np.random.default_rng(2).random((2, 100), np.float32)
    values = image(uv)
    pickled = pickle.dumps(image)
    assert len(pickled) < image.texels.nbytes + 1000
    np.testing.assert_array_equal(pickle.loads(pickled)(uv), values)
    # images of several materials
    values = Image(np.full((1, 1, 1), 0.2)), (1.0, 2.0, 3.0)
    np.testing.assert_allclose(Images(values)(np.array([1, 0]), np.zeros((2, 2))).T, [(1, 2, 3), [0.2] * 3], rtol=1e-6)
