"""Slopes and gains: planted power laws are found again; rendered ones fall as N^-1/2."""

from pathlib import Path

import numpy as np
import pytest

import dmis
from dmis.convergence import gains, line, read_off, slope
from dmis.experiment import Run, measure


def run(rule: str, spp: int, seed: int, seconds: float, mse: float, overhead: float = 0.0) -> Run:
    return Run(rule, spp, seed, 100 * spp, overhead, 0.0, seconds - overhead, mse, 0.1 * mse, mse, 2 * seconds)


@pytest.fixture
def runs() -> dict:
    """The balance heuristic at three budgets; a rule of half the error that takes a second more."""
    budgets = (8, 32, 128)
    factors = {0: 0.8, 1: 1.2}
    balance = {("balance", n): [run("balance", n, k, n / 8, f / n) for k, f in factors.items()] for n in budgets}
    rule = {("rule", n): [run("rule", n, k, n / 8 + 1, f / n / 2, 1.0) for k, f in factors.items()] for n in budgets}
    return {**rule, **balance}


@pytest.mark.parametrize("power", [-0.5, -1.0, 0.25])
def test_slope_of_a_power_law(power):
    """The error's exponent, whatever the seeds' factors: they do not change a slope."""
    x = np.array([4.0, 8, 64, 100])
    mse = np.array([[0.5], [2.0], [1.0]]) * x ** (2 * power)
    assert slope(x, mse) == pytest.approx((power, 0), abs=1e-12)


def test_slope_error_is_that_of_many_experiments():
    """The jackknife's standard error is the spread of slopes of independent experiments of five seeds."""
    rng = np.random.default_rng(1)
    x = np.array([4.0, 16, 64])
    found = np.array([slope(x, np.exp(0.3 * rng.standard_normal((5, 3))) / x) for _ in range(400)])
    assert found[:, 0].mean() == pytest.approx(-0.5, abs=4 * found[:, 0].std() / 20)
    assert np.sqrt((found[:, 1] ** 2).mean()) == pytest.approx(found[:, 0].std(), rel=0.15)


def test_slopes_that_cannot_be_told():
    """One budget, two that took the same time but for rounding, an error below zero, as two halves of a reference may
    give, one seed.
    """
    assert np.isnan(slope(np.array([4.0]), np.array([[1.0], [2.0]]))[0])
    assert np.isnan(slope(np.array([0.1 + 0.2, 0.3]), np.array([[1.0, 2.0], [2.0, 3.0]]))).all()
    assert np.isnan(slope(np.array([4.0, 8.0]), np.array([[1.0, -1.0]]))[0])
    value, error = slope(np.array([4.0, 16.0]), np.array([[1.0, 0.25]]))
    assert value == pytest.approx(-0.5) and np.isnan(error)


@pytest.mark.parametrize(
    "at, value, between", [(1, 8, True), (2, 4, True), (4, 2, True), (8, 1, False), (0.5, 16, False)]
)
def test_read_off(at, value, between):
    """Log-log between the points, 1 / x beyond them; their order does not matter."""
    for x, y in (([1.0, 4.0], [8.0, 2.0]), ([4.0, 1.0], [2.0, 8.0])):
        assert read_off(np.array(x), np.array(y), at) == (pytest.approx(value), between)


def test_read_off_without_a_logarithm():
    """nan, not a warning."""
    assert np.isnan(read_off(np.array([1.0, 2.0]), np.array([1.0, -1.0]), 1.5)[0])
    assert np.isnan(read_off(np.array([1.0, 2.0]), np.array([1.0, 0.5]), 0.0)[0])


def test_gains(runs):
    """MSE = 1/n at n/8 seconds; the rule has half of it and takes a second more."""
    found = {(g.rule, g.spp): g for g in gains(runs)}
    assert list(found) == list(runs)
    for n in (8, 32, 128):
        assert (found["balance", n].equal_error, found["balance", n].equal_time) == pytest.approx((1, 1))
        g, seconds = found["rule", n], n / 8 + 1
        assert g.mse == pytest.approx(0.5 / n) and g.over_balance == pytest.approx(0.5)
        assert g.interval == pytest.approx(0, abs=1e-12)
        assert g.equal_error == pytest.approx((2 * n / 8) / seconds)
        assert g.equal_time == pytest.approx((1 / (8 * seconds)) / (0.5 / n))
        assert g.efficiency == pytest.approx(2 * n / seconds)
        assert g.overhead == pytest.approx(1 / seconds) and g.cpu_seconds == pytest.approx(2 * seconds)
        assert g.extrapolated == (n == 128)


def test_lines_are_in_the_order_of_samples(runs):
    """However the budgets were listed."""
    turned = dict(reversed(runs.items()))
    x, mse = line(turned, "rule", "seconds")
    np.testing.assert_allclose(x, [2, 5, 17])
    np.testing.assert_allclose(mse, np.outer([0.8, 1.2], 0.5 / np.array([8, 32, 128])))
    np.testing.assert_allclose(line(turned, "rule", "rays")[0], [800, 3200, 12800])


@pytest.mark.parametrize("name, seeds", [("teapot-area-light", 16), ("killeroo-diffuse", 3)])
def test_errors_fall_as_they_must(name: str, seeds: int, tmp_path: Path) -> None:
    """Fixed rules with independent samples: RMSE ~ N^-1/2, within 0.05. The teapot's few bright spikes need seeds."""
    scene = dmis.load_scene(name, resolution=(48, 40))
    reference = dmis.make_reference(scene, 512, folder=tmp_path)
    rules = ("balance", "pbrt")
    runs = measure(scene, [(rule, n) for rule in rules for n in (4, 16, 64)], range(seeds), reference)
    for rule in rules:
        value, error = slope(*line(runs, rule, "spp"))
        assert value == pytest.approx(-0.5, abs=0.05), f"{rule}: {value:.3f} ± {error:.3f}"
