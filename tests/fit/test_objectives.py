"""Objectives of the literature: planted 1-D problems whose answers are known by quadrature."""

import numpy as np
import pytest
from scipy.optimize import brentq

import dmis
from dmis.base.vectors import Array
from dmis.estimator.records import Record
from dmis.fit.objectives import OBJECTIVE_NAMES, objective

N = 400_000
X = (np.arange(200_000) + 0.5) / 200_000
P_L, P_B = 2 * X, 2 * (1 - X)
Q = (P_L + P_B) / 2


def f(x: Array) -> Array:
    """Follows p_l a little more than p_b; its ratio to either is bounded."""
    return 6 * x * (1 - x) * (1 + 0.4 * x)


def integral(g: Array) -> float:
    return float(np.mean(g))


def variance(g: Array, p: Array) -> float:
    """Of g(x) with x from p."""
    return integral(p * g**2) - integral(p * g) ** 2


def means(name: str, gamma: float = 2.0, pixels: int = 1) -> dict[str, Array]:
    """What the objective gathers from N camera samples, in one patch."""
    rng = np.random.default_rng(1)
    statistic = objective(name, gamma).statistic(pixels, 2)
    records = []
    for side in (0, 1):
        x = np.sqrt(rng.random(N))
        x = x if side == 0 else 1 - x
        pdf = np.stack([2 * x, 2 * (1 - x)]).astype(np.float32)
        records.append(Record(side, (0,), 0, None, np.repeat(f(x)[None], 3, axis=0).astype(np.float32), pdf))
    statistic.add(records, np.zeros((3, N), np.float32), N // pixels)
    return {key: a.mean(axis=-1).reshape(*a.shape[:-1], 1, 1) for key, a in statistic.sums().items()}


def weight(name: str, gamma: float = 2.0, cost: tuple[float, float] = (1.0, 1.0)) -> float:
    return float(objective(name, gamma).solve(means(name, gamma), cost)[0, 0])


def test_taylor() -> None:
    """``1/2 - M2'(1/2) / M2''(1/2)``."""
    d = (P_L - P_B) / Q
    slope, bend = (integral(f(X) ** 2 / Q * d**k) for k in (1, 2))
    assert weight("taylor") == pytest.approx(0.5 + slope / (2 * bend), abs=5e-3)


@pytest.mark.parametrize("cost", [(1.0, 1.0), (1.0, 4.0)])
def test_inverse_variance(cost: tuple[float, float]) -> None:
    """``w / (1 - w) = c_b v_b / (c_l v_l)``."""
    light, brdf = cost[1] * variance(f(X) / P_L, P_L), cost[0] * variance(f(X) / P_B, P_B)
    assert weight("inverse-variance", cost=cost) == pytest.approx(brdf / (light + brdf), abs=5e-3)


@pytest.mark.parametrize("cost", [(1.0, 1.0), (1.0, 4.0)])
def test_neyman(cost: tuple[float, float]) -> None:
    """``w / (1 - w) = s_l sqrt(c_b) / (s_b sqrt(c_l))``."""
    light = np.sqrt(variance(f(X) / Q, P_L) / cost[1])
    brdf = np.sqrt(variance(f(X) / Q, P_B) / cost[0])
    assert weight("neyman", cost=cost) == pytest.approx(light / (light + brdf), abs=5e-3)


def test_representativity() -> None:
    """``E[f / p]^2 / E[(f / p)^2]`` of each."""
    light, brdf = (integral(f(X)) ** 2 / integral(f(X) ** 2 / p) for p in (P_L, P_B))
    assert weight("representativity") == pytest.approx(light / (light + brdf), abs=5e-3)


@pytest.mark.parametrize("name, gamma", [("kl", 1.0), ("tsallis", 1.5), ("tsallis", 2.0), ("tsallis", 3.0)])
def test_divergences(name: str, gamma: float) -> None:
    """The root of xi; for gamma = 2 the minimum of the second moment.

    Between the weights of the grid xi is interpolated, hence 0.01.
    """

    def expected(w: float) -> float:
        p_w = w * P_L + (1 - w) * P_B
        return integral(f(X) ** gamma * (P_L - P_B) / p_w**gamma)

    root = brentq(expected, 0.01, 0.99)
    assert weight(name, gamma) == pytest.approx(root, abs=0.01)


def test_linear() -> None:
    """Least squares in the metric 1 / q, by quadrature."""
    densities = np.stack([P_L, P_B])
    a = np.linalg.solve(densities * (1 / Q) @ densities.T, densities @ (f(X) / Q))
    assert weight("linear") == pytest.approx(a[0] / a.sum(), abs=5e-3)


@pytest.mark.parametrize(
    "light, brdf, expected", [(3, 5, 3 / 8), (1, 0, 1), (0, 2, 0), (2, -0.3, 1), (-0.3, 2, 0), (0, 0, 0.5)]
)
def test_linear_recovers_combinations(light: float, brdf: float, expected: float) -> None:
    """Exactly, from few samples; negative shares become 0."""
    rng = np.random.default_rng(2)
    n = 64
    records = []
    for side in (0, 1):
        x = np.sqrt(rng.random(n))
        x = x if side == 0 else 1 - x
        pdf = np.stack([2 * x, 2 * (1 - x)])
        value = (light * pdf[0] + brdf * pdf[1]) / pdf.mean(axis=0)
        records.append(Record(side, (0,), 0, None, value[None].repeat(3, 0), pdf))
    assert _linear(records, n) == pytest.approx(expected, abs=1e-5)


def test_linear_counts_what_meets_no_light() -> None:
    """A BRDF technique of which three in four samples meet no light: they are part of its mean, with f = 0.

    ``p_b`` has a quarter of its mass where p_l is, with the same density there, so the fit of ``f = p_l`` has
    ``P = [[1.6, 0.4], [0.4, 1.6]]``, ``F = [1.6, 0.4]``: a = (1, 0). Leaving the wasted samples out would make the
    matrix singular.
    """
    n = 40_000
    pdf = np.repeat(np.array([[1.0], [0.25]]), n, axis=1)
    value = pdf[:1].repeat(3, 0) / pdf.mean(axis=0)
    hit = np.arange(0, n, 4)
    records = [Record(0, (0,), 0, None, value, pdf), Record(1, (0,), 0, hit, value[:, hit], pdf[:, hit])]
    assert _linear(records, n) == pytest.approx(1, abs=1e-5)
    np.testing.assert_allclose(_sums(records, n)["matrix"], [1.6, 0.4, 1.6], rtol=1e-4)


def test_linear_leaves_out_where_there_is_nothing() -> None:
    """Pixels beside the object, where neither sample meets a light, do not move the weight of its patch."""
    rng = np.random.default_rng(3)
    n = 50
    seen = np.arange(n)
    records = []
    for side in (0, 1):
        x = rng.uniform(0.1, 0.9, n)
        pdf = np.stack([2 * x, 2 * (1 - x)])
        records.append(Record(side, (0,), 0, seen, (f(x) / pdf.mean(axis=0))[None].repeat(3, 0), pdf))
    assert _linear(records, 10 * n) == pytest.approx(_linear(records, n), rel=1e-4)


def test_linear_stays_where_it_is_not_unique() -> None:
    """Equal densities: every weight is as good."""
    pdf, value = np.ones((2, 8)), np.ones((3, 8))
    assert _linear([Record(side, (0,), 0, None, value, pdf) for side in (0, 1)], 8) == 0.5


def _sums(records: list[Record], n: int) -> dict[str, Array]:
    """What ``linear`` gathers from n camera samples of one pixel."""
    statistic = objective("linear").statistic(1, 2)
    statistic.add(records, np.zeros((3, n), np.float32), n)
    return {key: a[..., 0] for key, a in statistic.sums().items()}


def _linear(records: list[Record], n: int) -> float:
    return float(objective("linear").solve(_sums(records, n), (1.0, 1.0)))


@pytest.mark.parametrize("name", OBJECTIVE_NAMES)
def test_nothing_seen(name: str) -> None:
    """Black patches stay at 1/2."""
    statistic = objective(name).statistic(4, 2)
    statistic.add([], np.zeros((3, 8), np.float32), 2)
    black = {key: a.mean(axis=-1).reshape(*a.shape[:-1], 1, 1) for key, a in statistic.sums().items()}
    assert objective(name).solve(black, (1.0, 1.0))[0, 0] == 0.5


@pytest.mark.parametrize("name", OBJECTIVE_NAMES)
def test_rules_render(box: dmis.Scene, name: str) -> None:
    """Each is a rule: weights within [0, 1], not all at 1/2, where all have an opinion."""
    result = dmis.render(box, name, 16, seed=1)
    assert result.weight.min() >= 0 and result.weight.max() <= 1
    assert (result.weight != 0.5).any()
    assert np.isfinite(result.image).all()


def test_unknown_objective() -> None:
    """The error lists what there is."""
    with pytest.raises(ValueError, match=r"objective must be second-moment, taylor, .*; got 'best'"):
        objective("best")
