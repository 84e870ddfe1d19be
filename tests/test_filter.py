"""The Gaussian filter of share maps, and the joint filter of statistics."""

import numpy as np
import pytest

from dmis.filter import effective, gaussian, joint


@pytest.mark.parametrize("radius", [0, 1, 2, 3])
@pytest.mark.parametrize("sigma", [0.5, 1.0, 4.0])
def test_taps(radius: int, sigma: float) -> None:
    """An impulse becomes a normalised Gaussian of exactly (2 r + 1)^2 taps: 25 by default."""
    impulse = np.zeros((15, 15))
    impulse[7, 7] = 1
    filtered = gaussian(impulse, sigma, radius)
    x = np.arange(-radius, radius + 1)
    taps = np.exp(-(x**2) / (2 * sigma**2))
    taps /= taps.sum()
    expected = np.zeros((15, 15))
    expected[7 - radius : 8 + radius, 7 - radius : 8 + radius] = np.outer(taps, taps)
    np.testing.assert_allclose(filtered, expected, atol=1e-15)
    assert np.count_nonzero(filtered) == (2 * radius + 1) ** 2
    if radius == 2 and sigma == 1:
        np.testing.assert_array_equal(gaussian(impulse), filtered)


def test_weighted_means_by_hand() -> None:
    """Tap by tap: beyond edges the outermost entry is repeated, with its weight; absent ones have the weight 0."""
    values, weight = np.random.default_rng(1).random((2, 5, 7))
    values[2, 3], values[0, 0], values[2, 4] = np.nan, np.inf, -np.inf
    taps, expected = range(-2, 3), np.empty((5, 7))
    for y, x in np.ndindex(5, 7):
        at = [(np.clip(y + dy, 0, 4), np.clip(x + dx, 0, 6), dy * dy + dx * dx) for dy in taps for dx in taps]
        w = [np.exp(-r2 / (2 * 1.3**2)) * weight[i, j] * np.isfinite(values[i, j]) for i, j, r2 in at]
        expected[y, x] = np.average([np.nan_to_num(values[i, j], posinf=0, neginf=0) for i, j, _ in at], weights=w)
    before = values.copy()
    np.testing.assert_allclose(gaussian(values, 1.3, 2, weight), expected, rtol=1e-12)
    np.testing.assert_array_equal(values, before)


def test_nothing_to_fill_from() -> None:
    """Where no neighbour is finite the entry stays as it is."""
    values = np.full((11, 11), np.nan)
    values[0, 0] = 1.0
    filtered = gaussian(values)
    assert np.isfinite(filtered[:3, :3]).all() and np.isnan(filtered[3:]).all() and np.isnan(filtered[:, 3:]).all()


@pytest.mark.parametrize(
    "options, message",
    [
        ({"sigma": 0}, "sigma must be positive"),
        ({"sigma": np.inf}, "sigma must be positive"),
        ({"radius": -1}, "radius must be a whole number of at least 0"),
    ],
)
def test_bad_options(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        gaussian(np.ones((2, 2)), **options)


# Joint filter -------------------------------------------------------------------------------------------------------

FLAT = {"normal": np.zeros((3, 20, 17))}
ONE = {"normal": 1.0, "step": 0.1}


@pytest.mark.parametrize("radius", [0, 1, 2, 30])
def test_joint_of_equal_guides_is_a_gaussian(radius: int) -> None:
    """Of (2 r + 1)^2 taps, renormalised at the edges, any number of maps; checked against the definition."""
    values = np.random.default_rng(1).random((2, 20, 17))
    filtered, entries = joint(values, FLAT, ONE, 1.5, radius)
    for at in ((0, 0), (3, 9), (10, 8), (19, 1)):
        y, x = np.mgrid[:20, :17] - np.reshape(at, (2, 1, 1))
        w = np.exp(-(x * x + y * y) / (2 * 1.5**2)) * (np.maximum(abs(x), abs(y)) <= radius)
        np.testing.assert_allclose(filtered[:, *at], (w * values).sum(axis=(1, 2)) / w.sum(), rtol=1e-12)
        np.testing.assert_allclose(entries[at], w.sum() ** 2 / (w * w).sum(), rtol=1e-12)
    if radius <= 2:
        inside = slice(2, -2), slice(2, -2)
        np.testing.assert_allclose(filtered[0][inside], gaussian(values[0], 1.5, radius)[inside], rtol=1e-12)
        np.testing.assert_allclose(entries[inside], effective((20, 17), 1.5, radius)[inside], rtol=1e-12)


def test_joint_follows_the_definition() -> None:
    """Several features with scales of their own."""
    rng = np.random.default_rng(2)
    values, features = rng.random((6, 5)), {"normal": rng.random((3, 6, 5)), "step": rng.random((1, 6, 5))}
    filtered, _ = joint(values, features, {"normal": 0.5, "step": 0.2}, 2.0, 6)
    at = 4, 1
    y, x = np.mgrid[:6, :5] - np.reshape(at, (2, 1, 1))
    exponent = (x * x + y * y) / 8
    for guide, scale in zip(features.values(), (0.5, 0.2), strict=True):
        exponent = exponent + ((guide - guide[:, at[0], at[1], None, None]) ** 2).sum(axis=0) / (2 * scale**2)
    w = np.exp(-exponent)
    assert filtered[at] == pytest.approx((w * values).sum() / w.sum(), rel=1e-12)


def test_joint_reduces_noise_as_said() -> None:
    """The variance of white noise falls by the number of entries."""
    rng = np.random.default_rng(3)
    features = {"step": 0.1 * rng.integers(0, 3, (1, 20, 17))}
    filtered, entries = joint(rng.normal(size=(4000, 20, 17)), features, ONE)
    np.testing.assert_allclose(filtered.var(axis=0) * entries, 1, atol=0.15)
    assert np.ptp(entries) > 2


@pytest.mark.parametrize("shape", [(1, 1), (1, 8), (9, 11)])
def test_worth_of_a_gaussian(shape: tuple[int, int]) -> None:
    """One over the variance of an average of independent entries of variance 1, at the edge and in corners too."""
    unit = np.eye(shape[0] * shape[1]).reshape(-1, *shape)
    weights = np.stack([gaussian(one, 1.0, 2) for one in unit])
    np.testing.assert_allclose(effective(shape, 1.0, 2), 1 / (weights**2).sum(axis=0), rtol=1e-9)
