"""Runs: their order, errors and times, and the number of samples for a given time."""

import dataclasses

import pytest

import dmis
from dmis.experiment.metrics import mse, relmse
from dmis.experiment.runs import Run, measure, on_cpu, spp_in_time


def run(rule: str, spp: int, seconds: float, overhead: float = 0.0) -> Run:
    return Run(rule, spp, 0, 0, overhead, 0.0, seconds - overhead, 1.0, 0.1, 1.0)


def test_measure(box, tmp_path):
    """`measure` has the errors of separate renders; rules take turns within each seed."""
    reference = dmis.make_reference(box, 64, folder=tmp_path)
    seen = []
    budgets = [("balance", 8), ("thesis:patch=4", 16)]
    runs = measure(box, budgets, [3, 5], reference, progress=lambda *a: seen.append(a))
    assert list(runs) == budgets
    assert seen == [("balance", 1, 4), ("thesis:patch=4", 2, 4), ("balance", 3, 4), ("thesis:patch=4", 4, 4)]
    for (rule, spp), both in runs.items():
        assert [r.seed for r in both] == [3, 5]
        result = dmis.render(box, rule, spp, seed=5)
        assert both[1].mse == pytest.approx(mse(result.image, reference.first, reference.second), rel=1e-12)
        assert both[1].relmse == pytest.approx(relmse(result.image, reference.first, reference.second), rel=1e-12)
        assert both[1].rays == sum(result.rays.values())
        assert 0 <= both[1].overhead < both[1].seconds and both[1].mse_error > 0
    assert runs["balance", 8][0].mse != runs["balance", 8][1].mse


def test_a_budget_named_twice_is_measured_once(box, tmp_path):
    """A budget that is named twice is rendered once, so that its runs do not count twice."""
    reference = dmis.make_reference(box, 4, folder=tmp_path)
    assert [len(r) for r in measure(box, [("balance", 2)] * 2, [1], reference).values()] == [1]


@pytest.mark.parametrize("seconds, spp", [(10, 100), (5, 50), (20, 200), (0.001, 1)])
def test_spp_of_a_rule_without_a_pilot(seconds, spp):
    """Without a pilot the samples are in proportion to the time, and at least one."""
    assert spp_in_time(seconds, [run("balance", 100, 10)]) == spp


@pytest.mark.parametrize("seconds, spp", [(13.2, 128), (12.9, 125), (1, 7), (25.4, 250)])
def test_spp_pays_for_the_pilot(seconds, spp):
    """The time of pilot and fit is subtracted first: 122 final samples took 12.2 s of 13.2 s."""
    assert spp_in_time(seconds, [run("thesis", 128, 13.2, 1.0)]) == spp


def test_time_of_the_processor():
    """`on_cpu` replaces a doubled wall time by CPU seconds and keeps the shares of the stages."""
    (one,) = on_cpu([dataclasses.replace(run("thesis", 128, 13.2, 1.2), cpu_seconds=6.6)])
    assert one.seconds == pytest.approx(6.6) and one.overhead == pytest.approx(0.6)
