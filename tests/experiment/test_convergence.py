"""Slopes and gains: planted power laws are recovered; errors of renders fall as N^-1/2."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import run

from dmis.experiment.convergence import Gain, gains, interpolate_log_log, intervals, line, over_scenes
from dmis.experiment.metrics import log_ratio
from dmis.experiment.runs import PINNED
from dmis.report.tables import winners


@pytest.fixture
def runs() -> dict:
    """The balance heuristic at three budgets; a rule of half the error that takes a second more."""
    budgets = (8, 32, 128)
    factors = {0: 0.8, 1: 1.2}
    balance = {("balance", n): [run("balance", n, k, n / 8, f / n) for k, f in factors.items()] for n in budgets}
    rule = {("rule", n): [run("rule", n, k, n / 8 + 1, f / n / 2, 1.0) for k, f in factors.items()] for n in budgets}
    return {**rule, **balance}


def wins(gain: Gain) -> bool:
    """Return whether a rule wins where no few pixels have most of the error."""
    return winners(SimpleNamespace(concentrated={}), [gain]) == [gain]


def test_interpolate_log_log():
    """Interpolation is linear in log-log between the points, 1 / x beyond them, and independent of their order. A value
    without a logarithm gives NaN and no warning.
    """
    for at, value, between in ((1, 8, True), (2, 4, True), (4, 2, True), (8, 1, False), (0.5, 16, False)):
        for x, y in (([1.0, 4.0], [8.0, 2.0]), ([4.0, 1.0], [2.0, 8.0])):
            assert interpolate_log_log(np.array(x), np.array(y), at) == (pytest.approx(value), between)
    assert np.isnan(interpolate_log_log(np.array([1.0, 2.0]), np.array([1.0, -1.0]), 1.5)[0])
    assert np.isnan(interpolate_log_log(np.array([1.0, 2.0]), np.array([1.0, 0.5]), 0.0)[0])


def test_gains(runs):
    """MSE = 1/n at n/8 seconds; the rule has half of it and takes a second more."""
    found = {(g.rule, g.spp): g for g in gains(runs)}
    assert list(found) == list(runs)
    for n in (8, 32, 128):
        balance = found["balance", n].mse
        assert balance.equal_time == pytest.approx(1)
        g, seconds = found["rule", n], n / 8 + 1
        assert g.mse.error == pytest.approx(0.5 / n) and g.mse.over_balance == pytest.approx((0.5,) * 3)
        assert g.mse.equal_time == pytest.approx((0.5 / n) / (1 / (8 * seconds)))
        assert g.overhead == pytest.approx(1 / seconds) and g.cpu_seconds == pytest.approx(2 * seconds)
        assert g.mse.extrapolated == (n == 128)
        expected = 0.5 * seconds / (n / 8)  # the same factors in both, so there is no scatter
        assert balance.error_time.value == 1 and g.mse.error_time == pytest.approx(3 * (expected,))
        assert wins(g) == (expected < 1) and not wins(found["balance", n])


def test_each_measure_has_ratios_of_its_own(runs):
    """A rule with half the MSE and three times the relMSE loses: the winner is that of relMSE."""
    mixed = {
        (rule, n): [replace(r, relmse=(3 if rule == "rule" else 1) / n, cpu_seconds=1.0) for r in of]
        for (rule, n), of in runs.items()
    }
    for g in gains(mixed):
        expected = (3, 0.5) if g.rule == "rule" else (1, 1)
        assert [m.over_balance.value for m in g.measures] == pytest.approx(expected)
        assert [m.error_time.value for m in g.measures] == pytest.approx(expected) and not wins(g)
        assert line(mixed, "rule", "rays", "relmse")[1][0] == pytest.approx([3 / 8, 3 / 32, 3 / 128])


def test_ratios_to_the_pinned_baseline(runs):
    """Twice the error of the balance heuristic in its time; no winner and none of a family of rules."""
    assert all(np.isnan(g.mse.over_pinned.value) and np.isnan(g.mse.error_time_over_pinned.value) for g in gains(runs))
    pinned = {
        (PINNED, n): [replace(r, rule=PINNED, mse=2 * r.mse, relmse=2 * r.relmse) for r in of]
        for (rule, n), of in runs.items()
        if rule == "balance"
    }
    for g in gains({**runs, **pinned}):
        assert g.mse.over_pinned.value == pytest.approx({"balance": 0.5, "rule": 0.25, PINNED: 1}[g.rule])
        assert g.mse.error_time_over_pinned.value == pytest.approx(g.mse.error_time.value / 2)
    faster = {budget: [replace(r, mse=r.mse / 100, relmse=r.relmse / 100) for r in of] for budget, of in pinned.items()}
    assert [wins(g) for g in gains({**runs, **faster}) if g.rule == PINNED] == [False] * len(pinned)


def test_intervals_of_gains():
    """With the same error everywhere, seconds of 1 and 2 with either rule decide nothing, exact as the error is."""
    seconds = {"balance": (1.0, 2.0, 1.0, 2.0, 2.0), "rule": (1.0, 1.0, 2.0, 1.0, 1.0)}
    runs = {(rule, 8): [run(rule, 8, k, t, 0.1) for k, t in enumerate(of)] for rule, of in seconds.items()}
    _, g = gains(runs)
    assert g.mse.over_balance == (1, 1, 1) and g.cpu_seconds == 2.0  # as medians are
    assert g.mse.error_time.value == pytest.approx(6 / 8) and g.mse.error_time.high > 1 and not wins(g)
    # one seed, errors below zero and missing CPU seconds give no interval and no winner
    one = {(rule, 8): [run(rule, 8, 0, 1.0, mse)] for rule, mse in (("balance", 1.0), ("rule", 0.1))}
    _, g = gains(one)
    assert g.mse.error_time.value == pytest.approx(0.1) and np.isnan(g.mse.error_time.high) and not wins(g)
    few = {(rule, 8): [run(rule, 8, k, 1.0, -0.1 if rule == "rule" else 1.0) for k in range(3)] for rule, _ in one}
    assert np.isnan(gains(few)[1].mse.error_time).all() and not wins(gains(few)[1])
    old = {budget: [replace(r, cpu_seconds=float("nan")) for r in 3 * of] for budget, of in one.items()}
    assert np.isnan(gains(old)[1].mse.error_time).all() and not wins(gains(old)[1])


def test_several_rules_share_one_level():
    """Of 1500 comparisons of five equal rules with the balance heuristic at most 5 % name any that differs.

    Error and seconds are lognormal, 20 % each. Student's intervals without Holm's levels would name one in about 13 %,
    each of them 5 %. The standard error of the share is 0.6 %.
    """
    rng = np.random.default_rng(3)
    wrong, alone = 0, []
    for _ in range(1500):
        mse, seconds = np.exp(0.2 * rng.standard_normal((2, 6, 4)))
        balance, *rules = mse * seconds
        logs = [np.array([log_ratio(rule, balance)]) for rule in rules]
        wrong += any(not i.low <= 1 <= i.high for i in intervals(np.concatenate(logs), 3))
        alone.append([not i.low <= 1 <= i.high for log in logs for i in intervals(log, 3)])
    assert wrong / 1500 < 0.05 + 2 * 0.006 and np.any(alone, axis=1).sum() > 2 * wrong
    assert np.mean(alone) == pytest.approx(0.05, abs=0.01)


def test_lines_are_in_the_order_of_samples(runs):
    """The points of a line are sorted by samples, in whatever order budgets are given."""
    turned = dict(reversed(runs.items()))
    x, mse = line(turned, "rule", "seconds")
    np.testing.assert_allclose(x, [4, 10, 34])
    np.testing.assert_allclose(mse, np.outer([0.8, 1.2], 0.5 / np.array([8, 32, 128])))
    np.testing.assert_allclose(line(turned, "rule", "rays")[0], [800, 3200, 12800])


def test_geometric_means_over_scenes():
    """Of ratios 1/2 and 2 it is 1; of n scenes the interval is narrower by the root of n; all must have the rule."""

    def scene(factor: float, rules: tuple[str, ...], seeds: int = 4) -> dict:
        rng = np.random.default_rng(7)
        noise = np.exp(0.1 * rng.normal(size=seeds))
        made = {("balance", 8): [run("balance", 8, k, 1, 1.0) for k in range(seeds)]}
        made |= {(name, 8): [run(name, 8, k, 1, factor * x) for k, x in enumerate(noise)] for name in rules}
        return {**made, (PINNED, 8): made["balance", 8]}

    half, double = scene(0.5, ("a", "b")), scene(2.0, ("a",))
    (only,) = over_scenes([half], "mse").keys() - {"b"}
    assert only == "a"
    one, both = over_scenes([scene(0.5, ("a",))], "mse")["a"], over_scenes([half, double], "mse")
    assert both.keys() == {"a"}
    assert both["a"].value == pytest.approx(2 * one.value, rel=1e-6)
    assert np.log(both["a"].high / both["a"].low) == pytest.approx(np.log(one.high / one.low) / np.sqrt(2))
