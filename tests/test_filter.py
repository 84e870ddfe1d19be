"""The Gaussian filter of weight maps."""

import numpy as np
import pytest

from dmis.filter import gaussian


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (20, 9)])
def test_constants_are_kept(shape: tuple[int, int]) -> None:
    """The taps sum to 1 at the edges too; float64 rounding."""
    np.testing.assert_allclose(gaussian(np.full(shape, 0.3)), 0.3, rtol=1e-14)


@pytest.mark.parametrize("radius", [0, 1, 2, 3])
@pytest.mark.parametrize("sigma", [0.5, 1.0, 4.0])
def test_taps(radius: int, sigma: float) -> None:
    """An impulse becomes a normalised Gaussian of exactly (2 r + 1)^2 taps: 25 by default."""
    impulse = np.zeros((15, 15))
    impulse[7, 7] = 1
    out = gaussian(impulse, sigma, radius)
    x = np.arange(-radius, radius + 1)
    taps = np.exp(-(x**2) / (2 * sigma**2))
    taps /= taps.sum()
    expected = np.zeros((15, 15))
    expected[7 - radius : 8 + radius, 7 - radius : 8 + radius] = np.outer(taps, taps)
    np.testing.assert_allclose(out, expected, atol=1e-15)
    assert np.count_nonzero(out) == (2 * radius + 1) ** 2
    if radius == 2 and sigma == 1:
        np.testing.assert_array_equal(gaussian(impulse), out)


def test_missing_entries_are_filled_from_their_neighbours() -> None:
    """NaN and infinity count as absent: a constant around them stays constant, and they become it."""
    values = np.full((9, 9), 0.7)
    values[4, 4], values[0, 0], values[4, 5] = np.nan, np.inf, -np.inf
    np.testing.assert_allclose(gaussian(values), 0.7, rtol=1e-12)


def test_missing_entries_spoil_nothing() -> None:
    """Entries out of reach of an absent one are as without it, and its neighbours are means of what is there."""
    values = np.random.default_rng(1).random((12, 12))
    holed = values.copy()
    holed[6, 6] = np.nan
    out = gaussian(holed)
    far = np.ones((12, 12), bool)
    far[4:9, 4:9] = False
    np.testing.assert_allclose(out[far], gaussian(values)[far], rtol=1e-14)
    near = values[4:9, 4:9]
    assert np.isfinite(out).all() and values.min() <= out[6, 6] <= near.max()


def test_nothing_to_fill_from() -> None:
    """Where no neighbour is finite the entry stays as it is."""
    values = np.full((11, 11), np.nan)
    values[0, 0] = 1.0
    out = gaussian(values)
    assert np.isfinite(out[:3, :3]).all() and np.isnan(out[3:]).all() and np.isnan(out[:, 3:]).all()


def test_argument_stays() -> None:
    """The input is not changed, integers are welcome, the result is float64."""
    values = np.arange(12).reshape(3, 4)
    before = values.copy()
    assert gaussian(values).dtype == np.float64
    np.testing.assert_array_equal(values, before)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"sigma": 0}, "sigma must be positive"),
        ({"sigma": np.nan}, "sigma must be positive"),
        ({"sigma": np.inf}, "sigma must be positive"),
        ({"radius": -1}, "radius must not be negative"),
    ],
)
def test_bad_options(options: dict[str, float], message: str) -> None:
    """Errors name the option."""
    with pytest.raises(ValueError, match=message):
        gaussian(np.ones((2, 2)), **options)
