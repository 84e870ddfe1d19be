"""Weight rules: parabolas, degenerate patches, and the texts that name rules."""

import numpy as np
import pytest

from dmis.base.patches import patch_mean
from dmis.base.vectors import Array
from dmis.fit.fixed import Fixed
from dmis.fit.registry import Thesis, make_rule
from dmis.fit.rule import Rule
from dmis.fit.thesis import STATUS, parabola_minimum
from dmis.variance.moments import Film, Moments

PILOT = np.array([0.0, 0.5, 1.0])


def code(name: str) -> int:
    return next(k for k, v in STATUS.items() if v == name)


@pytest.mark.parametrize("minimum", [0.0, 0.1, 0.5, 0.77, 1.0])
@pytest.mark.parametrize("curvature, floor", [(1.0, 0.0), (1e-150, 0.0), (1e150, 1e150), (0.01, 1.0)])
def test_planted_minimum(minimum: float, curvature: float, floor: float) -> None:
    """The minimum of a parabola through three of its points is recovered to 1e-12, whatever its scale.

    But where the floor is a hundred times the curvature, the values lose two digits to it: 1e-12 is still kept.
    """
    variance = curvature * (PILOT - minimum) ** 2 + floor
    weight, status = parabola_minimum(PILOT, variance)
    assert weight == pytest.approx(minimum, abs=1e-12)
    assert status in (code("minimum"), code("clipped"))  # at the very ends rounding decides


def test_exact_parabola_of_a_monotone_curve_cannot_lose() -> None:
    """Of three variances that fall the weight is at least 3/4, or 1 without a minimum; alike of three that rise."""
    y = -np.sort(-(np.random.default_rng(3).exponential(size=(3, 10_000)) ** 4), axis=0)
    for curve, mirror in ((y, False), (y[::-1], True)):
        weight, status = parabola_minimum(PILOT, curve)
        weight = 1 - weight if mirror else weight
        assert set(np.unique(status)) == {0, 1, 2} and (weight[status == 2] == 1).all() and weight.min() > 0.75 - 1e-9


def test_least_squares_of_more_points() -> None:
    """With five weights the parabola is NumPy's least-squares fit; their order does not matter."""
    w = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    y = np.random.default_rng(2).random((5, 20)) + 4 * (w[:, None] - 0.4) ** 2
    a2, a1, _ = np.polyfit(w, y, 2)
    weight, _ = parabola_minimum(w, y)
    np.testing.assert_allclose(weight, np.clip(-a1 / (2 * a2), 0, 1), atol=1e-12)
    order = [3, 0, 4, 1, 2]
    np.testing.assert_allclose(parabola_minimum(w[order], y[order])[0], weight, atol=1e-12)


@pytest.mark.parametrize(
    "variance, weight, status",
    [
        ([1.0, 0.5, 1.0], 0.5, "minimum"),
        ([1.0, 0.5, 0.2], 1.0, "clipped"),
        ([0.2, 0.5, 1.0], 0.0, "clipped"),
        ([1.0, 2.0, 1.5], 0.0, "not convex"),
        ([3.0, 2.0, 1.0], 1.0, "not convex"),
        ([1.0, 1.0, 1.0], 0.5, "no signal"),
        ([0.0, 0.0, 0.0], 0.5, "no signal"),
        ([np.nan, 1.0, 1.0], 0.5, "no signal"),
        ([1.0, np.inf, 1.0], 0.5, "no signal"),
        ([1e-300, 0.0, 1e-300], 0.5, "minimum"),
    ],
)
def test_what_happened(variance: list[float], weight: float, status: str) -> None:
    """A minimum inside is used; one outside is clipped; without one, the best pilot weight; without a signal, 1/2."""
    got, number = parabola_minimum(PILOT, np.array(variance))
    assert got == pytest.approx(weight, abs=1e-12) and STATUS[int(number)] == status


# The thesis's rule --------------------------------------------------------------------------------------------------


def pilot(minimum: Array, n: int = 2) -> dict[float, Film]:
    """Moments whose variances are parabolas over w with the given minimum at each pixel, the same in each channel."""
    variances = {w: np.repeat(((w - minimum) ** 2 + 0.1)[..., None], 3, axis=2) for w in PILOT}
    return {w: Film.of(Moments(n, np.ones_like(v), v * (n - 1))) for w, v in variances.items()}


@pytest.mark.parametrize("shape", [(16, 16), (13, 21)])
@pytest.mark.parametrize("patch", [4, 8, 64])
def test_thesis_recovers_planted_weights(shape: tuple[int, int], patch: int) -> None:
    """Without the filter a patch gets the mean of its pixels' minima: parabolas of equal curvature average to that."""
    minimum = np.random.default_rng(4).uniform(0.1, 0.9, shape)
    fit = Thesis(patch, filter="none").fit(pilot(minimum))
    assert np.shape(fit.weight) == shape
    np.testing.assert_allclose(fit.maps["filtered"], patch_mean(minimum, patch), atol=1e-12)
    assert not fit.maps["status"].any()


def test_black_patches_get_one_half() -> None:
    """Where nothing was seen, w = 1/2, and no warning of a division."""
    black = {w: Film.of(Moments(2, np.zeros((8, 8, 3)), np.zeros((8, 8, 3)))) for w in PILOT}
    for no_signal in ("half", "skip"):
        fit = Thesis(4, no_signal=no_signal).fit(black)
        np.testing.assert_array_equal(fit.weight, 0.5)
        assert (fit.maps["status"] == code("no signal")).all()
    # two weights, however often, make no parabola
    with pytest.raises(ValueError, match="at least three distinct weights"):
        parabola_minimum(np.array([0.0, 1.0, 1.0]), np.ones((3, 2)))


def test_pilot_channels_and_filter() -> None:
    """A red patch whose minimum differs from the green one's: luminance follows green, rgb the plain mean."""
    minimum = np.array([0.2, 0.8, 0.8])  # of red, green, blue, at equal curvature
    variances = {w: np.broadcast_to((w - minimum) ** 2 + 0.1, (4, 4, 3)) for w in PILOT}
    moments = {w: Film.of(Moments(2, np.ones((4, 4, 3)), v)) for w, v in variances.items()}
    assert Thesis(4, channels="rgb").fit(moments).maps["raw"] == pytest.approx(0.6)
    assert Thesis(4, channels="luminance").fit(moments).maps["raw"] == pytest.approx(0.8 - 0.6 * 0.212671)
    # 2 + 2 + 2 camera samples at w = 0, 1/2, 1, or 4 each
    assert Thesis().pilot == {0.0: 2, 0.5: 2, 1.0: 2}
    assert Thesis(spp=4).pilot == {0.0: 4, 0.5: 4, 1.0: 4}
    # one tap is no filter; an impulse spreads over `size` patches on a side, no more
    minimum = np.full((36, 36), 0.4)
    minimum[16:20, 16:20] = 0.6
    for size in (1, 3, 5, 7):
        weight = Thesis(4, size=size).fit(pilot(minimum)).maps["filtered"]
        assert np.count_nonzero(np.abs(weight - 0.4) > 1e-9) == size**2


@pytest.mark.parametrize("sigma", [0.5, 1.0])
def test_patches_without_a_signal_may_be_left_out_of_the_filter(sigma: float) -> None:
    """Columns of patches of all four states, filtered by hand: ``skip`` leaves out only the one without a signal."""
    states = ["minimum", "clipped", "not convex", "no signal"]
    of_columns = np.array([(0.26, 1, 1, 1), (0.11, 0.5, 2, 1), (0.46, 0.2, 1.5, 1)]).repeat(4, axis=1)
    variance = {w: np.broadcast_to(y[:, None], (16, 16, 3)) for w, y in zip(PILOT, of_columns)}
    found = {w: Film.of(Moments(2, np.ones(v.shape), v)) for w, v in variance.items()}
    raw, g = np.array([0.4, 1, 0, 0.5]), np.exp(-(np.arange(-2, 3) ** 2) / (2 * sigma**2))
    for option, count in (("half", np.ones(4)), ("skip", np.array([1, 1, 1, 0]))):
        maps = Thesis(4, sigma=sigma, no_signal=option).fit(found).maps
        np.testing.assert_allclose(maps["raw"][1], raw, atol=1e-12)
        assert [STATUS[k] for k in maps["status"][1]] == states
        for k, filtered in enumerate(maps["filtered"][1]):
            near = np.clip(np.arange(k - 2, k + 3), 0, 3)  # the border is repeated
            assert filtered == pytest.approx((g * (count * raw)[near]).sum() / (g * count[near]).sum())


def test_ragged_patches_may_count_by_their_area() -> None:
    """A column of patches of one pixel's width counts a quarter of the others in the filter, and itself too."""
    minimum = np.where(np.arange(13) < 12, 0.3, 0.7)[None].repeat(12, 0)  # columns of patches: 4, 4, 4 and 1 pixels
    equal, area = (Thesis(4, ragged=option).fit(pilot(minimum)).maps for option in ("equal", "area"))
    np.testing.assert_allclose(equal["raw"][0], [0.3, 0.3, 0.3, 0.7], atol=1e-12)
    g = np.exp(-(np.arange(-2, 3) ** 2) / 2)
    column = np.clip(np.arange(1, 6), 0, 3)  # around the last patch, which is repeated beyond the border
    for maps, count in ((equal, 1.0), (area, 0.25)):
        counts = g * np.where(column == 3, count, 1)
        assert maps["filtered"][1, 3] == pytest.approx((counts * np.where(column == 3, 0.7, 0.3)).sum() / counts.sum())
    assert (area["filtered"][:, 2:] < equal["filtered"][:, 2:] - 0.02).all()
    whole = np.random.default_rng(1).uniform(0.1, 0.9, (16, 16))
    fits = [Thesis(4, ragged=option).fit(pilot(whole)).weight for option in ("equal", "area")]
    np.testing.assert_array_equal(*fits)


# Texts --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text, expected",
    [
        ("balance", Fixed(combiner="balance")),
        ("fixed:0.25", Fixed(0.25)),
        ("fixed:w=0.25", Fixed(0.25)),
        ("fixed:1,combiner=power", Fixed(1.0, "power")),
        (" balance ", Fixed(combiner="balance")),
        ("pbrt", Fixed(combiner="power")),
        ("one-sample:0.25", Fixed(0.25, allocation="random")),
        ("uniform", Fixed(1.0, techniques=("uniform", "brdf"))),
        ("thesis", Thesis()),
        ("thesis:8,filter=none", Thesis(8, filter="none")),
        ("thesis:patch=4,spp=4,sigma=0.5,combiner=power", Thesis(4, 4, sigma=0.5, combiner="power")),
        ("thesis:channels=rgb,size=3,reuse=no", Thesis(channels="rgb", size=3, reuse=False)),
        ("thesis:reuse=ON", Thesis(reuse=True)),
        ("thesis:no_signal=skip,ragged=area", Thesis(no_signal="skip", ragged="area")),
    ],
)
def test_rules_by_text(text: str, expected: Rule) -> None:
    """A name and options make the rule."""
    rule = make_rule(text)
    assert rule == expected and isinstance(rule, Rule)
