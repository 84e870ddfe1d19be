"""
Error against run time
======================

Draws docs/images/error-time-SCENE.webp for each scene: relMSE and MSE against CPU seconds, direct light above and, if
they were measured, paths below. Everything comes from rows that other scripts have measured: `make_points_table`,
`make_path_table`, `against_mitsuba` and `weight_bounds`. ``tables()`` has the errors in equal time.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

import show_mitsuba
import show_points
from common import ROOT, options, print_canvas
from PIL import Image
from rows import markdown, read_rows, read_runs

from dmis import plot
from dmis.experiment.convergence import MEASURES, Measure
from dmis.experiment.metrics import mean_and_error
from dmis.experiment.runs import Run

TABLES = ROOT / "docs" / "tables"
PATHS, BOUNDS = TABLES / "paths.csv", TABLES / "weight-bounds.csv"


class Line(NamedTuple):
    """A rule in the legend, the rule measured for it in direct light and the variant by paths, and how it is drawn."""

    label: str
    direct: str
    paths: str
    colour: str
    mark: str


LINES = (
    Line("balance, independent", show_points.PLAIN, "independent", "0.55", "o"),
    Line("thesis", show_points.TILT, "", "#d55e00", "s"),
    Line("balance, Sobol", show_points.SOBOL, "roulette", "black", "o"),
    Line("auto, Sobol", show_points.AUTO, "auto", "#2b8cd6", "v"),
)
"""The thesis's baseline and its rule are without sky compensation, the lines below have it."""
BALANCE, BOUND, MITSUBA = "balance, Sobol", "bound of shares", "Mitsuba's best set-up"
Lines = dict[str, dict[int, list[Run]]]
"""Runs by label and samples per pixel."""


def direct(scene: str, measure: Measure) -> Lines:
    """Return the runs in direct light, fewest samples first."""
    runs = show_points.measured()[scene]
    rules = {line.label: line.direct for line in LINES}
    if measure == "mse":
        rules = {label: show_points.ABSOLUTE.get(rule, rule) for label, rule in rules.items()}
    return {label: {n: runs[name, n] for name, n in sorted(runs) if name == rule} for label, rule in rules.items()}


def by_paths(scene: str) -> Lines:
    """Return the runs by paths, fewest samples first; `auto` makes relMSE least."""
    lines: Lines = {}
    for line in LINES:
        runs = [run for run in read_runs(PATHS).get(scene, []) if run.rule == line.paths]
        lines[line.label] = {n: [run for run in runs if run.spp == n] for n in sorted({run.spp for run in runs})}
    return lines


def bound(name: str, measure: Measure) -> float | None:
    """Return what the best shares leave of the balance heuristic's error, at the smallest size of a scene; or None."""
    kind = {"relmse": "relative", "mse": "absolute"}[measure]
    rows = [r for r in read_rows(BOUNDS) if (r["scene"], r["measure"], r["bound"]) == (name, kind, "share per patch")]
    return float(min(rows, key=lambda row: int(row["width"]))["value"]) if rows else None


def points(of_rule: Mapping[int, Sequence[Run]], measure: Measure) -> np.ndarray:
    """Return seconds, mean error and the ends of its 95 % interval ``(4, B)``: Student's, of the logarithm."""
    from scipy.stats import t

    columns = []
    for runs in of_rule.values():
        mean, error = mean_and_error(np.array([getattr(run, measure) for run in runs]))
        factor = np.exp(t.ppf(0.975, len(runs) - 1) * error / mean) if len(runs) > 1 else 1.0
        columns.append((np.median([run.cpu_seconds for run in runs]), mean, mean / factor, mean * factor))
    return np.array(columns).reshape(-1, 4).T


def draw(axis: Any, lines: Lines, measure: Measure, limit: float | None, mitsuba: Mapping[str, str] | None) -> None:
    """Draw the lines of all rules; `limit` is a `bound`, `mitsuba` a row of `against_mitsuba`."""
    for line in LINES:
        if not lines[line.label]:
            continue
        seconds, mean, low, high = points(lines[line.label], measure)
        axis.fill_between(seconds, low, high, color=line.colour, alpha=0.15, linewidth=0)
        axis.plot(seconds, mean, color=line.colour, marker=line.mark, markersize=3.5, label=line.label)
    if limit is not None:
        seconds, mean = points(lines[LINES[0].label], measure)[:2]
        axis.plot(seconds, limit * mean, color="0.55", linestyle="--", label=BOUND)
    if mitsuba is not None:
        seconds, mean = points({0: lines[BALANCE][int(mitsuba["spp"])]}, measure)[:2]
        style = {"marker": "*", "markersize": 9, "markerfacecolor": "white", "linestyle": "", "label": MITSUBA}
        axis.plot(seconds, mean / float(mitsuba["ratio"]), color="#b0413e", **style)
    axis.set(xscale="log", yscale="log")
    axis.grid(alpha=0.25, which="both", linewidth=0.4)
    plot.round_ticks(axis.xaxis)
    plot.round_ticks(axis.yaxis)


def figure(scene: str) -> Any:
    """Return the figure of a scene."""
    name = scene.split()[0]
    paths = by_paths(scene)
    rows = 2 if len(paths[BALANCE]) > 1 else 1
    drawn, axes = print_canvas(rows, 2, 3.4 * rows, sharex="row")
    for column, (measure, title) in zip(axes.T, MEASURES.items(), strict=True):
        theirs = show_mitsuba.best(read_rows(show_mitsuba.ERRORS), name, measure)
        draw(column[0], direct(scene, measure), measure, bound(name, measure), theirs)
        column[0].set_title(f"{title}, direct light")
        if rows == 2:
            theirs = show_mitsuba.best(read_rows(show_mitsuba.PATHS), name, measure)
            draw(column[1], paths, measure, None, theirs)
            column[1].set_title(f"{title}, by paths")
        column[-1].set_xlabel("CPU seconds")
    labelled = dict(zip(*reversed(axes[0, 0].get_legend_handles_labels()), strict=True))
    drawn.legend(labelled.values(), labelled, loc="outside lower center", ncols=4)
    return drawn


def tables() -> dict[str, list[str]]:
    """Return the table of relMSE in equal time, over the balance heuristic with Sobol points."""
    rules = {
        **show_points.UNLEARNED,
        show_points.TILT: "`thesis`",
        show_points.SHARES: "`thesis:weigh=samples`",
        show_points.SECOND_MOMENT: "`second-moment`",
        show_points.AUTO: "`auto`",
    }
    rows = []
    for scene in show_points.measured():
        ratios = (show_points.over(scene, rule, show_points.SOBOL, "relmse") for rule in rules)
        rows.append([show_points.title(scene), *(show_points.cell(*ratio) for ratio in ratios)])
    return {"results.md: equal-time": markdown(["scene", *rules.values()], rows)}


def main() -> None:
    """Draw, and write WebP files."""
    opts, given = options(
        __file__,
        "figures of error against time",
        folder={"type": Path, "default": ROOT / "docs" / "images", "help": "of the pictures (default docs/images)"},
    )
    for scene in show_points.measured():
        drawn = figure(scene)
        drawn.savefig(opts.output, dpi=200)
        target = given.folder / f"error-time-{scene.split()[0]}.webp"
        with Image.open(opts.output) as image:
            image.convert("RGB").save(target, quality=85, method=6)
        print(target)


if __name__ == "__main__":
    main()
