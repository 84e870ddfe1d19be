"""Tables of steps and of losses agree with the rows and with the full table."""

from __future__ import annotations

import re
from statistics import fmean, median

import pytest
import show_points
from rows import read_runs


def cells(lines: list[str]) -> list[list[str]]:
    """Return the cells of a table's rows below its head."""
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines[2:]]


def test_all_steps_together_are_error_times_seconds_over_those_of_the_thesis() -> None:
    worth = {}
    for rule in ("auto:sampler=sobol", "balance:sampler=independent,compensation=0"):
        runs = [run for run in read_runs(show_points.CSV)["tt 300×167"] if (run.rule, run.spp) == (rule, 128)]
        worth[rule] = fmean(run.relmse for run in runs) * median(run.cpu_seconds for run in runs)
    auto, thesis = worth.values()
    (tt,) = (row for row in cells(show_points.steps("relmse")) if row[0].startswith("tt "))
    assert float(tt[-1].strip("*").split()[0]) == pytest.approx(auto / thesis, abs=6e-4)


def test_losses_are_the_rows_of_the_full_table_with_an_interval_above_1() -> None:
    expected = {}
    for scene, rule, *values in cells(show_points.all_budgets()):
        for k, error in enumerate(("relMSE", "MSE")):
            lows = [float(re.findall(r"\d+\.\d+", value)[1]) for value in values[k::2]]
            if rule in ("`auto`", "`counts`") and max(lows) > 1:
                expected[f"{rule}, {scene.split()[0]}, {error}"] = values[k::2]
    assert expected
    assert {name: values for name, *values in cells(show_points.losses())} == expected
