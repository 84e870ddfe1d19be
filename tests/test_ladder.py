"""Ladder of bounds: closed forms on planted curves, order, scale, noise that does not flatter, and its measurement."""

import numpy as np
import pytest
from ladder import RUNGS, Evenness, HalvedOracle, Ladder, halved_oracle, make_ladder, measure_evenness, rung_text
from scipy.optimize import minimize_scalar

import dmis
from dmis.base.vectors import Array
from dmis.fit.curve_minimum import PatchCurves
from dmis.variance.curves import GRID, HALF, share_variance

S, BASE_COST = 2, 1.3
COST_PER_SAMPLE = np.linspace(0.4, 0.7, len(GRID))


def planted(position: Array, shading: Array, pattern: Array | float = 0.0) -> PatchCurves:
    """Return the curves of patches ``(r, c)`` with known P, A(w) ``(G, r, c)`` and Var_y(D)."""
    zero, pattern = np.zeros_like(shading), np.broadcast_to(pattern, shading.shape)
    curve = shading / S + share_variance(S)[:, None, None] * pattern
    return PatchCurves(curve, zero, position, np.full(position.shape, 16.0), pattern=pattern)


def oracle_of(first: PatchCurves, second: PatchCurves | None = None, unit: float = 1.0) -> HalvedOracle:
    """Return an oracle with these halves; costs are in units of `unit`."""
    second = second or first
    cost = (BASE_COST + S * COST_PER_SAMPLE) * unit
    variance = (first.variance + second.variance) / 2
    return HalvedOracle(variance, cost, 4, 64, None, (first, second), S, BASE_COST * unit)


def ladder_of(oracle: HalvedOracle, evenness: Evenness | None = None) -> Ladder:
    """Return the ladder of an oracle that has one."""
    ladder = make_ladder(oracle, evenness)
    assert ladder is not None
    return ladder


def test_closed_forms() -> None:
    """Two patches, of which one has no use for weights: every rung by its formula."""
    position, half, best = np.array([[0.5, 2.0]]), np.array([[1.5, 0.4]]), np.array([[0.6, 0.4]])
    shading = np.broadcast_to(half, (len(GRID), 1, 2)).copy()
    shading[8, 0, 0] = best[0, 0]
    oracle = oracle_of(planted(position, shading))
    # c1 of the best shares: the second patch takes the cheapest
    c1 = COST_PER_SAMPLE[[8, 0]]
    c_half, c_best = BASE_COST + S * COST_PER_SAMPLE[HALF], BASE_COST + S * c1
    v_half, v_best = position + half / S, position + best / S
    base = v_half.mean() * c_half
    expected = {
        "B0": 1.0,
        "B1": v_best.mean() * c_best.mean() / base,
        "B2": np.sqrt(v_half).mean() ** 2 * c_half / base,
        "B2'": np.sqrt(v_best * c_best).mean() ** 2 / base,
        "B2''": np.sqrt((position + best) * (BASE_COST + c1)).mean() ** 2
        / base,  # S = 1, less rounding: w = 0 needs none
        "B3": (np.sqrt(position * BASE_COST) + np.sqrt(best * c1)).mean() ** 2 / base,
        "B6": (np.sqrt(position * BASE_COST)).mean() ** 2 / base,
    }
    ladder = ladder_of(oracle)
    assert list(ladder.rungs) == list(expected)
    for name, value in expected.items():
        assert ladder.rungs[name] == pytest.approx(value, rel=1e-9), name
        assert ladder.flattered[name] == pytest.approx(value, rel=1e-9), name
    assert ladder.position == pytest.approx(position.mean() / v_half.mean())


def test_rounding_of_numbers_counts_where_they_are_whole() -> None:
    """Var_y(D) raises rungs with a whole number of light samples, and not where S is any number."""
    position, shading = np.ones((1, 2)), np.linspace(2, 1, len(GRID) - 1)
    shading = np.broadcast_to(np.append(shading, 3)[:, None, None], (len(GRID), 1, 2))
    without, rounded = (ladder_of(oracle_of(planted(position, shading, d))).rungs for d in (0.0, 2.0))
    assert rounded["B3"] == pytest.approx(without["B3"]) and rounded["B0"] == 1
    assert rounded["B1"] > 1.01 * without["B1"]


def test_noise_does_not_flatter() -> None:
    """Weights and numbers that save nothing: noise lowers a choice judged by its own samples only."""
    rng = np.random.default_rng(5)

    def noisy() -> PatchCurves:
        shape = len(GRID), 30, 30
        return planted(1 + 0.3 * rng.standard_normal(shape[1:]), 2 + 0.6 * rng.standard_normal(shape))

    oracle = oracle_of(noisy(), noisy())
    flat = HalvedOracle(
        oracle.variance, np.full(len(GRID), 2.0), 4, 64, None, oracle.halves, S, 1.0
    )  # with costs of its own the cheapest share would save something
    ladder = ladder_of(flat)
    for name in ("B1", "B2", "B2'"):
        assert ladder.rungs[name] > 0.99, name
    assert ladder.flattered["B1"] < 0.8 and ladder.flattered["B2'"] < 0.8


def test_ends_that_miss_light_are_not_chosen() -> None:
    """A patch without the rare samples that make an end of the grid fail in the image does not choose it."""
    position, shading = np.ones((2, 2)), np.ones((len(GRID), 2, 2))
    shading[0] = 0.1
    shading[0, 1, 1] = 1e6
    assert ladder_of(oracle_of(planted(position, shading))).rungs["B2'"] > 0.8


def test_even_points() -> None:
    """B7 is B6 for independent points, and the best allocation by brute force for others."""
    position = np.array([[0.2, 3.0]])
    oracle = oracle_of(planted(position, np.ones((len(GRID), 1, 2))))
    rungs = ladder_of(oracle, Evenness(1.0, 1.0)).rungs
    assert rungs["B7"] == pytest.approx(rungs["B6"])
    even = Evenness(0.25, 1.4)
    c_half = float(oracle.cost[HALF])
    mean_count = 128 * c_half / BASE_COST

    def error(share: float) -> float:
        """Mean over both patches of e(n) P / n, where the first has this share of the samples.

        e(n) = e(N) (n / N)^(1 - a) is the ratio to the error of independent points.
        """
        counts = 2 * mean_count * np.array([share, 1 - share])
        return float(
            np.mean([even.ratio * (n / 128) ** (1 - 1.4) * p / n for n, p in zip(counts, position[0], strict=True)])
        )

    least = minimize_scalar(error, bounds=(0.001, 0.999), method="bounded").fun
    baseline = oracle.variance[HALF].mean() / 128
    assert ladder_of(oracle, even).rungs["B7"] == pytest.approx(least / baseline, rel=1e-4)


def test_standard_errors() -> None:
    """Estimates of 150 pairs of halves scatter as their standard errors say; the mean is not below the true rung."""
    rng = np.random.default_rng(8)
    position = rng.uniform(0.02, 0.3, (8, 8))
    shading = np.full((len(GRID), 8, 8), 2.0)

    def noisy() -> PatchCurves:
        return planted(position + 0.1 * rng.standard_normal((8, 8)), shading)

    def rung(first: PatchCurves, second: PatchCurves) -> tuple[float, float]:
        ladder = ladder_of(oracle_of(first, second))
        return ladder.rungs["B6"], ladder.standard_errors["B6"]

    exact, _ = rung(planted(position, shading), planted(position, shading))
    values, errors = np.array([rung(noisy(), noisy()) for _ in range(150)]).T
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(values.std(), rel=0.25)
    assert values.mean() > exact - 3 * values.std() / np.sqrt(150)


def test_a_rung_that_is_noise_is_shown_as_a_limit() -> None:
    """A rung whose interval reaches 0 is not printed as a number."""
    texts = [rung_text(value, interval) for value, interval in ((1.0, 0.0), (0.5, 0.2), (0.02, 0.039), (-0.01, 0.059))]
    assert texts == ["1", "0.5 ± 0.2", "< 0.059", "< 0.059"]


def test_ladder_of_a_scene(box: dmis.Scene, tmp_path) -> None:
    """Rungs of rendered curves are in order, and Sobol points are more even."""
    oracle = halved_oracle(box, 512, folder=tmp_path)
    curve, position = (
        np.mean([getattr(half, name) for half in oracle.halves], axis=0) for name in ("curve", "position")
    )
    np.testing.assert_allclose(oracle.variance, curve + np.maximum(position, 0), rtol=1e-9, atol=0)
    assert "B7" not in ladder_of(oracle).rungs
    evenness = measure_evenness(box, oracle)
    assert evenness.ratio < 0.8 and 1 < evenness.exponent < 2.5
    ladder = ladder_of(oracle, evenness)
    assert set(ladder.rungs) == set(RUNGS)
    rungs = ladder.rungs
    assert rungs["B0"] > rungs["B1"] > rungs["B2'"] > rungs["B3"] > rungs["B6"] > rungs["B7"] > 0
    # by the curves of all samples
    assert rungs["B1"] == pytest.approx(oracle.limit(costly=True), rel=0.02)
    assert rungs["B2'"] == pytest.approx(oracle.limit_with_counts(), rel=0.05)
