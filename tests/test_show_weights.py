"""Rows of the tables of bounds, scores and points, from planted scores, patches and runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from statistics import fmean, median

import measure_weights
import numpy as np
import pytest
import repeat
import show_points
import show_weights
from equal_time import equal_time_ratio
from helpers import run
from rows import read_runs, write_rows
from weight_bounds import BOUNDS

from dmis.bench.data import HALF
from dmis.bench.judge import Score
from dmis.experiment.convergence import Interval
from tests.test_weight_bounds import planted


def of(small: list[float], large: list[float]) -> tuple[Score, Score]:
    """Return the scores of a rule at both sizes, of these absolute errors by seed and without a block."""
    noise = np.random.default_rng(len(small)).normal(1, 1e-4, (12, 1))
    rows = [np.array(errors)[:, None] * np.ones(6) for errors in (small, large)]
    return Score("a", {"tt": rows[0]}), Score("a", {"tt": rows[1] * noise}, True)


def test_orders_that_change() -> None:
    """Rules whose order is sure at both sizes and not the same are told; unsure ones do not count."""
    rules = {
        "balance": of([1.0] * 4, [1.0] * 12),
        "better now": of([1.1] * 4, [0.9] * 12),
        "always better": of([0.7] * 4, [0.7] * 12),
        "unsure": of([0.5, 1.5, 0.6, 1.9], [0.95] * 12),
    }
    small, large = ({name: sizes[k] for name, sizes in rules.items()} for k in range(2))
    assert show_weights.order_rows(large, small) == [["tt", "3", "1"]]


@pytest.fixture
def fresh():
    """Tables are read anew, before and after a test."""
    caches = show_weights.scores, show_weights.bounds, show_weights.validated
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


def test_rows_of_bounds(monkeypatch: pytest.MonkeyPatch, tmp_path, fresh) -> None:
    """Each scene has a row per size, the part of camera samples first; at equal samples cost does not count."""
    data = planted()
    data.position[:] = 3 * (data.terms[:, :, 0, HALF] + data.terms[:, :, 1, HALF])
    data.cost[HALF] *= 2
    monkeypatch.setattr(measure_weights, "read_bounds", lambda name, size: data)
    monkeypatch.setattr(show_weights, "BOUNDS_CSV", tmp_path / "bounds.csv")
    rows = [row for size in ("full", "quarter") for row in measure_weights.bound_rows("tt", size)]
    write_rows(show_weights.BOUNDS_CSV, rows, show_weights.BOUND_FIELDS)
    assert len(rows) == (3 + 2) * (1 + len(BOUNDS)) and tuple(BOUNDS) == show_weights.KINDS[1:]
    assert (rows[0]["width"], rows[-1]["width"]) == (1500, 375)
    row, absolute, relative = show_weights.bound_rows()
    assert row[:3] == ["tt", "1500x833", "0.75 (0.75)"] and absolute[3:] == row[3:] == relative[3:]
    tilt = show_weights.KINDS.index("tilt per patch")
    equal = show_weights.bounds("tt", "full", "absolute, equal samples")[0, tilt]
    np.testing.assert_allclose(show_weights.bounds("tt", "full", "absolute")[0, tilt], equal)  # tilts cost nothing


def test_pairs_in_the_predicted_order(monkeypatch: pytest.MonkeyPatch, tmp_path, fresh) -> None:
    """Pairs whose intervals overlap do not count; a pair in the other order is told, by measure."""
    monkeypatch.setattr(show_weights, "VALIDATED_CSV", tmp_path / "validated.csv")
    cells = [("balance", 1, 1, 1, 1), ("thesis", 0.8, 0.8, 0.8, 1.2), ("random", 2, 2, 1.01, 2.5)]
    rows = [dict(zip(show_weights.VALIDATED_FIELDS, ("tt", *line, 0.01, 0.01), strict=True)) for line in cells]
    write_rows(show_weights.VALIDATED_CSV, rows, show_weights.VALIDATED_FIELDS)
    pairs, agreeing = show_weights.ordered_pairs(["tt"], ["balance", "thesis", "random"])
    assert pairs.tolist() == [2, 3] and agreeing.tolist() == [2, 2]
    assert show_weights.validated_rows() == [["tt", "1.00", "0.67–1.00", "1.98, 0.80"]]


def test_rules_of_papers_link_to_the_files_that_register_them() -> None:
    folder = Path(measure_weights.__file__).parents[1] / "docs"
    for link, rule, *_ in show_weights.literature_rows():
        path = folder / link.partition("](")[2].rstrip(")")
        assert f'register_rule("{rule.strip("`")}"' in path.read_text("utf-8"), rule


# Tables of points ----------------------------------------------------------------------------------------------------


def cells(lines: list[str]) -> list[list[str]]:
    """Return the cells of a table's rows below its head."""
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines[2:]]


def test_independent_points_are_compared_by_error_times_seconds() -> None:
    worth = {}
    for rule in ("auto:sampler=sobol", "balance:sampler=independent,compensation=0"):
        runs = [run for run in read_runs(show_points.CSV)["tt 300×167"] if (run.rule, run.spp) == (rule, 128)]
        worth[rule] = fmean(run.relmse for run in runs) * median(run.cpu_seconds for run in runs)
    auto, thesis = worth.values()
    (tt,) = (row for row in cells(show_points.results()) if row[0].startswith("tt "))
    assert float(tt[3].strip("*").split()[0]) == pytest.approx(auto / thesis, abs=6e-4)


def test_losses_are_the_scenes_with_an_interval_above_1() -> None:
    rows = cells(show_points.losses())
    above = [any(float(cell.split("(")[1].split("–")[0]) > 1 for cell in row[1:] if "(–)" not in cell) for row in rows]
    assert all(above) and {"tt 300×167, MSE", "killeroo-gold 228×171, relMSE"} <= {row[0] for row in rows}
    # The worst seed is the largest error
    rows = {row[0]: row for row in cells(show_points.results())}
    assert len(rows) == len(show_points.measured())
    runs = show_points.measured()["tt 300×167"]
    auto, balance = ([run.relmse for run in runs[f"{rule}:sampler=sobol", 128]] for rule in ("auto", "balance"))
    assert float(rows["tt 300×167"][-1]) == pytest.approx(max(auto) / max(balance), abs=6e-3)


def test_ratios_that_contradict_each_other() -> None:
    """Intervals that do not meet, or on the two sides of 1; what is not repeated is named."""
    published = {name: Interval(0.8, 0.7, 0.9) for name in "abc"}
    new = {"a": Interval(0.85, 0.5, 1.4), "b": Interval(0.5, 0.4, 0.6), "c": Interval(1.03, 1.01, 1.1)}
    assert list(repeat.compare(published, new)) == ["b", "c"]
    names = repeat.show_points.claims()
    assert {"tt 300×167, sky compensation, relMSE", "tt 300×167, auto / balance at 16, MSE"} <= names.keys()


@pytest.mark.slow
def test_results_are_repeated() -> None:
    """Half an hour: three seeds of all scenes."""
    assert repeat.main([]) == 0


# The error in equal time over a baseline: closed forms, coverage of its interval --------------------------------------


@pytest.mark.parametrize("seconds", [0.5, 3.0, 20.0])
def test_equal_time_follows_the_line_of_the_baseline(seconds: float) -> None:
    """The baseline's error falls as T^-3/2: a rule with a quarter of it at its own time has the ratio 1/4."""
    baseline = [[run("balance", n, k, n / 2, (n / 2) ** -1.5) for k in range(2)] for n in (2, 8, 16)]  # CPU seconds: n
    rule = [replace(run("auto", 8, k, seconds / 2, seconds**-1.5 * 2**1.5 / 4), relmse=9.0) for k in range(2)]
    value, low, high = equal_time_ratio(rule, baseline)
    assert (value, low, high) == pytest.approx((0.25,) * 3)
    assert equal_time_ratio(rule, baseline[:1]).value == pytest.approx(0.25 * (seconds / 2) ** -0.5)


def test_equal_time_intervals_hold_the_truth() -> None:
    """In 2,000 experiments with errors of three to five seeds, 93 to 99 % of the intervals hold the true ratio."""
    rng, inside = np.random.default_rng(3), 0
    for _ in range(2000):
        rule, *baseline = (
            [run("any", n, k, n / 2, n**-1.5 * rng.gamma(20) / 20) for k in range(seeds)]
            for n, seeds in ((3, 5), (2, 5), (4, 3))
        )
        _, low, high = equal_time_ratio(rule, baseline)
        inside += low < 1 < high
    assert 0.93 < inside / 2000 < 0.99
