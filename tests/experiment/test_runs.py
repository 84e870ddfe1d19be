"""Runs: their order, errors and times, and the number of samples for a given time."""

import pytest

import dmis
from dmis.experiment.metrics import mse, relmse
from dmis.experiment.runs import measure


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
