"""Tables of results and of losses agree with the rows."""

from __future__ import annotations

from statistics import fmean, median

import pytest
import show_points
from rows import read_runs

SPP = (16, 32, 64, 128)


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


def test_losses_are_the_rules_with_an_interval_above_1() -> None:
    expected = set()
    for scene in show_points.measured():
        for rule in ("auto", "counts"):
            for error, measure in (("relMSE", "relmse"), ("MSE", "mse")):
                ratios = [show_points.over(scene, f"{rule}:sampler=sobol", show_points.SOBOL, measure, n) for n in SPP]
                if max(ratio.low for ratio in ratios) > 1:
                    expected.add(f"`{rule}`, {scene.split()[0]}, {error}")
    assert expected == {name for name, *_ in cells(show_points.losses())} != set()
    # Scenes of files have no runs beside other renderers; the worst seed is the largest error
    rows = {row[0]: row for row in cells(show_points.results())}
    field = [row for name, row in rows.items() if name.endswith(" samples")]
    assert len(rows) == len(show_points.measured()) + len(field) and all(row[3:6] == ["–"] * 3 for row in field)
    runs = show_points.measured()["tt 300×167"]
    auto, balance = ([run.relmse for run in runs[f"{rule}:sampler=sobol", 128]] for rule in ("auto", "balance"))
    assert float(rows["tt 300×167"][-1]) == pytest.approx(max(auto) / max(balance), abs=6e-3)
