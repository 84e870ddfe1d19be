"""MIS weights: heuristics and combiners."""

import numpy as np
import pytest
from helpers import pixel_shares

from dmis.base.vectors import Array
from dmis.estimator.mis import balance, combiner_by_name, cutoff, maximum, power

HEURISTICS = ["balance", "power", "power-1", "power-3", "power-0.5", "maximum", "cutoff", "cutoff-0.5", "cutoff-1"]
each_heuristic = pytest.mark.parametrize("name", HEURISTICS)


def weights(name: str, a: Array, b: Array) -> tuple[Array, Array]:
    """MIS weights of a sample with densities `a`, `b`, as the first and as the second technique's."""
    heuristic = combiner_by_name(name).heuristic
    return a.astype(float) * heuristic((a, b), 0), b.astype(float) * heuristic((a, b), 1)


@each_heuristic
@pytest.mark.parametrize("a, b", [(0, 1), (1, 0), (1e-25, 1), (1, 1e20), (1e30, 1e30), (0, 1e30), (1e30, 1e-30)])
def test_weights_of_extreme_densities(name: str, a: float, b: float) -> None:
    """No overflow, no NaN, and a sum of 1, where one density is 0 or enormous.

    A technique of density 0 has weight 0. The power heuristic caps the ratio at 1e18, whose weight no float sees.
    """
    first, second = weights(name, np.float32([a]), np.float32([b]))
    assert np.isfinite(first).all() and np.isfinite(second).all()
    np.testing.assert_allclose(first + second, 1, rtol=1e-6)
    if a == 0:
        assert first == 0
    if b == 0:
        assert second == 0


@each_heuristic
def test_vanishing_densities_are_finite(name: str) -> None:
    """Both 0 or 1e-30 (a float32 underflow away): finite factors."""
    for a, b in ((0, 0), (1e-30, 0), (0, 1e-30), (1e-30, 1e-30), (1e-38, 1e30)):
        for own in (0, 1):
            assert np.isfinite(combiner_by_name(name).heuristic((np.float32([a]), np.float32([b])), own)).all()


@each_heuristic
@pytest.mark.parametrize("techniques", [3, 4])
def test_weights_of_several_techniques_sum_to_one(name: str, techniques: int) -> None:
    """A partition of unity over twelve magnitudes, with ties of two and of all, and with densities of 0; and with a
    last density of 0 everywhere, the weights of one technique fewer.
    """
    a = 10 ** np.random.default_rng(1).uniform(-6, 6, (techniques, 1000)).astype(np.float32)
    a[1, :100], a[2:, :50], a[0, 100:200] = a[0, :100], a[0, :50], 0
    heuristic = combiner_by_name(name).heuristic
    found = np.stack([a[k].astype(float) * heuristic(tuple(a), k) for k in range(techniques)])
    np.testing.assert_allclose(found.sum(axis=0), 1, rtol=1e-6)
    assert (found >= 0).all() and not found[0, 100:200].any()
    a[-1] = 0
    fewer = [a[k] * heuristic(tuple(a[:-1]), k) for k in range(techniques - 1)]
    np.testing.assert_allclose([a[k] * heuristic(tuple(a), k) for k in range(techniques - 1)], fewer, rtol=1e-6)


def test_closed_forms_and_limits() -> None:
    """Densities 3 and 1: 3/4, 9/10, all, and whoever is above the threshold."""
    a, b = np.float32([3]), np.float32([1])
    powers = ("balance", 0.75), ("power", 0.9), ("power-3", 27 / 28), ("power-0.5", 3**0.5 / (3**0.5 + 1))
    for name, expected in (*powers, ("maximum", 1), ("cutoff-0.5", 1)):
        first, second = weights(name, a, b)
        np.testing.assert_allclose([first[0], second[0]], [expected, 1 - expected], atol=1e-6)
    np.testing.assert_allclose(weights("cutoff-0.2", a, b)[0], 0.75)
    # Power 1 and cutoff 0 are balance; cutoff 1 is maximum but for ties, which it shares; large powers are maximum
    a, b = np.random.default_rng(2).random((2, 100), dtype=np.float32)
    np.testing.assert_allclose(power(1)((a, b), 0), balance((a, b), 0), rtol=1e-6)
    np.testing.assert_allclose(cutoff(0)((a, b), 0), balance((a, b), 0), rtol=1e-6)
    np.testing.assert_allclose(cutoff(1)((a, b), 0), maximum((a, b), 0), rtol=1e-6)
    np.testing.assert_allclose(cutoff(1)((a, a), 0) * a, 0.5)
    for beta in (1e8, 1e10, 1e308):
        for k in (0, 1):
            np.testing.assert_allclose(power(beta)((a, b), k), maximum((a, b), k), rtol=1e-6, atol=1e-9)


# Combiners ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, message",
    [
        *((name, "combiner must be") for name in ("", "balance-2", "power-x")),
        *((f"power-{beta}", "exponent of the power heuristic must be positive and finite") for beta in ("inf", -1)),
        ("frozen", r"got 'frozen': write a rule whose final round has tilt=\(0.5, 0.5\)"),
        ("cutoff-2", "threshold of the cutoff heuristic must be a number from 0 to 1"),
    ],
)
def test_unknown_heuristics(name: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        combiner_by_name(name)


@pytest.mark.parametrize("name", [*HEURISTICS, "optimal"])
@pytest.mark.parametrize("w", [0.05, 0.3, 0.5])
def test_every_combiner_weighs_all_of_f(name: str, w: float) -> None:
    """``sum_k w_k p_k weight_k = 1`` in every direction, so that the estimate is unbiased before any correction."""
    pdf = 10 ** np.random.default_rng(4).uniform(-3, 3, (2, 1000))
    combiner = combiner_by_name(name)
    assert combiner.name == name
    total = sum(
        share * pdf[k] * combiner.heuristic([w * pdf[0], (1 - w) * pdf[1]], k) for k, share in enumerate((w, 1 - w))
    )
    np.testing.assert_allclose(total, 1, rtol=1e-6)


@pytest.mark.parametrize("name, corrects", [("balance", False), ("optimal", True)])
def test_combiners_that_correct_pixels(name: str, corrects: bool) -> None:
    """Only combiners that fit pixels collect records; what they add to pixels without samples is 0."""
    combiner = combiner_by_name(name)
    assert (combiner.collector is not None) == corrects
    if combiner.collector is not None:
        collector = combiner.collector(pixel_shares(0.5), np.full(4, 2))
        np.testing.assert_array_equal(collector.correction(), np.zeros((3, 4)))
