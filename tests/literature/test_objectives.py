"""Objectives of the literature: planted 1-D problems whose answers are known by quadrature."""

from dataclasses import replace

import numpy as np
import pytest
from planted import pilot_of_curves
from scipy.optimize import brentq

import dmis
from dmis.base.vectors import Array
from dmis.estimator.records import Record
from dmis.fit.registry import about
from dmis.variance.curves import GRID

pytestmark = pytest.mark.usefixtures("literature")
NAMES = ("taylor", "inverse-variance", "neyman", "representativity", "kl", "tsallis")
N = 400_000
X = (np.arange(200_000) + 0.5) / 200_000
P_L, P_B = 2 * X, 2 * (1 - X)
Q = (P_L + P_B) / 2


def f(x: Array) -> Array:
    """Follows p_b more than p_l; its ratio to either is bounded, and all divergences have roots of their own."""
    return 6 * x * (1 - x) ** 2 * (1 + 3 * x**4)


def integral(g: Array) -> float:
    return float(np.mean(g))


def variance(g: Array, p: Array) -> float:
    """Of g(x) with x from p."""
    return integral(p * g**2) - integral(p * g) ** 2


def weight(rule: str, cost: tuple[float, float] = (1.0, 1.0)) -> float:
    """The share that follows from what the rule gathers from N camera samples, in one patch."""
    rng = np.random.default_rng(1)
    made = dmis.make_rule(rule)
    statistic = made.statistic(1, 2)
    records = []
    for side in (0, 1):
        x = np.sqrt(rng.random(N))
        x = x if side == 0 else 1 - x
        pdf = np.stack([2 * x, 2 * (1 - x)]).astype(np.float32)
        records.append(Record(side, (0,), 0, None, np.repeat(f(x)[None], 3, axis=0).astype(np.float32), pdf))
    statistic.add(records, np.zeros((3, N), np.float32), N)
    sums = statistic.sums()["values"]
    return float(made.solve(sums[..., None], cost)[0, 0])


def test_moments_of_taylor_and_representativity() -> None:
    """``1/2 - M2'(1/2) / M2''(1/2)``."""
    d = (P_L - P_B) / Q
    slope, bend = (integral(f(X) ** 2 / Q * d**k) for k in (1, 2))
    assert weight("taylor") == pytest.approx(0.5 + slope / (2 * bend), abs=5e-3)
    # ``E[f / p]^2 / E[(f / p)^2]`` of each
    light, brdf = (integral(f(X)) ** 2 / integral(f(X) ** 2 / p) for p in (P_L, P_B))
    assert weight("representativity") == pytest.approx(light / (light + brdf), abs=5e-3)
    # a technique that misses half of f: 1 / 2 against .5^2 / 1
    of_patch = np.array([[1.0, 0.5], [2.0, 1.0]])[..., None, None]
    assert dmis.make_rule("representativity").solve(of_patch, (1.0, 1.0)) == pytest.approx(0.5 / 0.75)


@pytest.mark.parametrize("cost", [(1.0, 1.0), (1.0, 4.0)])
def test_inverse_variance(cost: tuple[float, float]) -> None:
    """``w / (1 - w) = c_b v_b / (c_l v_l)``."""
    light, brdf = cost[1] * variance(f(X) / P_L, P_L), cost[0] * variance(f(X) / P_B, P_B)
    assert weight("inverse-variance", cost) == pytest.approx(brdf / (light + brdf), abs=5e-3)


@pytest.mark.parametrize("cost", [(1.0, 1.0), (1.0, 4.0)])
def test_neyman(cost: tuple[float, float]) -> None:
    """``w / (1 - w) = s_l sqrt(c_b) / (s_b sqrt(c_l))``."""
    light = np.sqrt(variance(f(X) / Q, P_L) / cost[1])
    brdf = np.sqrt(variance(f(X) / Q, P_B) / cost[0])
    assert weight("neyman", cost) == pytest.approx(light / (light + brdf), abs=5e-3)


@pytest.mark.parametrize(
    "rule, gamma", [("kl", 1.0), ("tsallis:gamma=1.5", 1.5), ("tsallis", 2.0), ("tsallis:gamma=3", 3.0)]
)
def test_divergences(rule: str, gamma: float) -> None:
    """The root of xi; for gamma = 2 the minimum of the second moment.

    Between the weights of the grid xi is interpolated, hence 0.01.
    """

    def expected(w: float) -> float:
        p_w = w * P_L + (1 - w) * P_B
        return integral(f(X) ** gamma * (P_L - P_B) / p_w**gamma)

    assert weight(rule) == pytest.approx(brentq(expected, 0.01, 0.99), abs=0.01)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_seen(name: str) -> None:
    """Black patches stay at 1/2."""
    rule = dmis.make_rule(name)
    statistic = rule.statistic(4, 2)
    statistic.add([], np.zeros((3, 8), np.float32), 2)
    assert (rule.solve(statistic.sums()["values"], (1.0, 1.0)) == 0.5).all()
    if name in ("kl", "tsallis"):  # xi falls with w: no root above or below 0
        assert [rule.solve(sign * np.ones((11, 1, 1)), (1.0, 1.0)) for sign in (1, -1)] == [1, 0]


def test_costs_of_a_pilot_by_hand() -> None:
    """The pilot's light samples, 4 of 8, trace rays: 1 + 4 (.25 + .4 w) is 3.6 at w = 1 and 2 at w = 0."""
    film = pilot_of_curves(np.ones((len(GRID), 1, 1)), shape=(4, 5))[0.5]
    film = replace(film, rays={"camera": 100, "shadow": 400}, shading_samples=8)
    film = replace(film, sums={"values": np.array([[[16.0, 4.0]]] * 2)})
    np.testing.assert_allclose(dmis.make_rule("inverse-variance:filter=none").fit({0.5: film}).weight, 2 / (2 + 3.6))
    # the order of the divergence; each rule has a sentence
    with pytest.raises(ValueError, match="gamma must be positive and finite; got inf"):
        dmis.make_rule("tsallis:gamma=1e400")
    assert len({about(name) for name in NAMES}) == len(NAMES) and all("Choose shares" in about(n) for n in NAMES)
