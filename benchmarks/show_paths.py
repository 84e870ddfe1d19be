"""Tables of docs/paths.md from the rows of make_path_table.py."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from common import ROOT, bold
from pieces import FOUR
from rows import markdown, read_runs

from dmis.experiment.convergence import MEASURES, Interval, Measure
from dmis.experiment.metrics import ratio
from dmis.experiment.runs import Run

CSV = ROOT / "docs" / "tables" / "paths.csv"
SCENES = ("cornell", *FOUR, "ten-lights")
BEFORE = {"compensation": "points", "roulette": "compensation", "lights": "roulette", "counts": "lights"}
"""The step before; where a scene does not have that step, the one before it."""
STEPS = {
    "Sobol / independent points": ("points", "independent"),
    "sky compensation": ("compensation", "points"),
    "Russian roulette": ("roulette", "compensation"),
    "light tree": ("lights", "roulette"),
    "numbers of samples": ("counts", "lights"),
    "learned shares": ("auto", "counts"),
    "all": ("auto", "independent"),
    "`auto` / `balance`": ("auto", "lights"),
}
"""Steps: what is measured, and what it is compared with; the last compares with Sobol points and all settings."""


@cache
def measured(csv: Path | None = None) -> dict[str, dict[str, list[Run]]]:
    """Return the runs of each scene by what is switched on."""
    order = {scene: n for n, scene in enumerate(SCENES)}
    scenes: dict[str, dict[str, list[Run]]] = {}
    for scene, runs in sorted(read_runs(csv or CSV).items(), key=lambda item: order[item[0].split()[0]]):
        budget = max(run.spp for run in runs)
        for run in runs:
            if run.spp == budget:
                scenes.setdefault(scene, {}).setdefault(run.rule, []).append(run)
    return scenes


def over(scene: str, label: str, base: str, measure: Measure, csv: Path | None = None) -> tuple[float, float] | None:
    """Return error times CPU seconds over that of another, and half of the interval; None without such a step."""
    runs = measured(csv)[scene]
    if label not in runs:
        return None
    while base not in runs:
        base = BEFORE[base]
    if measure == "mse":
        label, base = (f"{name}, absolute" if name in ("counts", "auto") else name for name in (label, base))
    costs = [np.array([getattr(run, measure) * run.cpu_seconds for run in runs[name]]) for name in (label, base)]
    return ratio(costs[0], costs[1])


def steps(measure: Measure) -> list[str]:
    """Return the table of `STEPS` by a measure; a dash where a step changes nothing."""
    lines = []
    for scene in measured():
        values = [over(scene, *pair, measure) for pair in STEPS.values()]
        lines.append([scene, *("–" if value is None else bold(*value) for value in values)])
    return markdown([MEASURES[measure], *STEPS], lines)


def claims(csv: Path | None = None) -> dict[str, Interval]:
    """Return what `auto` leaves of the errors of `balance` in path tracing."""
    ratios = {}
    for scene in measured(csv):
        for measure, error in MEASURES.items():
            value, half = over(scene, "auto", "lights", measure, csv) or (np.nan, np.nan)
            # of the logarithm, so that no interval of few seeds goes below 0
            ratios[f"{scene} by paths, auto / balance, {error}"] = Interval(
                value, value * np.exp(-half / value), value * np.exp(half / value)
            )
    return ratios


def tables() -> dict[str, list[str]]:
    """Return the lines of the block."""
    return {"paths.md: steps by paths": [*steps("relmse"), "", *steps("mse")]}


def sentences() -> dict[str, list[str]]:
    """Return fragments of prose with numbers, by page."""

    def values(step: str, measure: Measure) -> list[str]:
        ratios = [over(scene, *STEPS[step], measure) for scene in measured()]
        return [f"{ratio[0]:.2f}" for ratio in ratios if ratio is not None]

    def span(step: str, measure: Measure) -> str:
        return f"{min(values(step, measure), key=float)} to {max(values(step, measure), key=float)}"

    first = next(iter(STEPS))
    return {
        "paths.md": [
            f"{span(first, 'mse')} of the MSE and {span(first, 'relmse')} of the relMSE",
            f"lowers the relMSE of TT to {values('sky compensation', 'relmse')[0]}",
            f"lowers the relMSE of `ten-lights` to {values('light tree', 'relmse')[0]}",
            f"{min(values('numbers of samples', 'relmse')[2:])} to {max(values('numbers of samples', 'relmse')[2:])}",
        ]
    }
