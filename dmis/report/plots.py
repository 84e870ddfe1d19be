"""Plots of a report: error lines, maps and images, as SVG and as PNG in data URIs (extra ``plot``)."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes

from dmis import plot
from dmis.base.vectors import Array
from dmis.experiment.convergence import MEASURES, Axis, Measure, line
from dmis.experiment.runs import Budget, Run
from dmis.experiment.table import Comparison
from dmis.report.comparer import png

RULE_COLOURS = (
    "#808080", "#d55e00", "#2b8cd6", "#00a17a", "#c565b0", "#d9a200", "#8a6fd1", "#b0413e", "#4fb3bf", "#7d8f1f",
)  # fmt: skip
"""Colours of rules in their order, the balance heuristic first; distinct on white and on black."""
RULE_MARKS = "os^DvPX"
"""Markers of rules: with ten colours and seven markers, 70 rules differ in one of the two."""
INK = "#010203"
"""Placeholder of the colour of the page's text in `error_svg`."""
LINES: tuple[tuple[Axis, Measure], ...] = (("seconds", "relmse"), ("seconds", "mse"), ("rays", "mse"))
"""Axis and measure of each plot of a comparison."""
AXIS_LABELS: dict[Axis, str] = {"rays": "rays", "seconds": "CPU seconds"}


def error_lines(
    axis: Axes,
    runs: Mapping[Budget, Sequence[Run]],
    over: Axis,
    ink: str = "0.35",
    measure: Measure = "mse",
) -> None:
    """Draw the root of the error of every rule over rays or seconds, log-log.

    Lines are the root of the mean over seeds, bands go from the lowest to the highest seed. Dotted: the slope of
    N^-1/2.
    """
    lows = []
    for k, rule in enumerate(dict.fromkeys(rule for rule, _ in runs)):
        x, mse = line(runs, rule, over, measure)
        colour, mark = RULE_COLOURS[k % len(RULE_COLOURS)], RULE_MARKS[k % len(RULE_MARKS)]
        errors = mse.mean(axis=0), mse.min(axis=0), mse.max(axis=0)
        mean, low, high = (np.sqrt(np.where(error > 0, error, np.nan)) for error in errors)
        axis.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)
        axis.plot(x, mean, color=colour, marker=mark, markersize=5, linewidth=1.6, label=rule)
        lows += [(at, error * np.sqrt(at)) for at, error in zip(x, low, strict=True)]
    ends = np.array([min(x for x, _ in lows), max(x for x, _ in lows)])
    axis.set_xlabel(AXIS_LABELS[over])
    axis.set_ylabel("RMSE (linear RGB)" if measure == "mse" else "root of relMSE")
    if not any(error > 0 for _, error in lows):
        axis.text(0.5, 0.5, "no error above zero", ha="center", transform=axis.transAxes)
        return
    reference_line = 0.8 * min(error for _, error in lows if error > 0) / np.sqrt(ends)
    axis.plot(ends, reference_line, color=ink, linestyle=":", linewidth=1.1, label="N^(-1/2)")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.grid(alpha=0.25, which="both", linewidth=0.5)
    plot.round_ticks(axis.xaxis)
    plot.round_ticks(axis.yaxis)


def convergence(comparison: Comparison, path: Path) -> None:
    """Write the plot of errors over seconds by both measures, and over rays, with its caption, as a PNG file."""
    figure, axes = plot.canvas(1, 3, 17, 5)
    for axis, (over, measure) in zip(axes[0], LINES, strict=True):
        error_lines(axis, comparison.runs, over, measure=measure)
    axis.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), borderaxespad=0)  # of all
    caption = f"""Root of relMSE and of MSE against the reference, mean over {comparison.seeds} seed(s); bands go from
        the lowest to the highest seed. CPU time is from the pilot to the last sample, fit included. Dotted: N^-1/2.
        Errors that are estimated below zero, because the reference is noisy, are left out."""
    plot.save(figure, path, f"{comparison.scene}: error against time and rays", caption)


def error_svg(comparison: Comparison, over: Axis, measure: Measure = "mse") -> str:
    """Return `error_lines` as an SVG element with the page's colour and fonts."""
    inked = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color", "grid.color")
    label = f"Root of {MEASURES[measure]} over {AXIS_LABELS[over]}, {comparison.scene}"
    style: dict[str, Any] = {
        **dict.fromkeys(inked, INK),
        "svg.fonttype": "none",
        "svg.hashsalt": label,
        "font.size": 9.5,
        "axes.spines.top": False,
        "axes.spines.right": False,
    }
    with matplotlib.rc_context(style):  # type: ignore[arg-type]
        figure, axes = plot.canvas(1, 1, 5.4, 3.9)
        error_lines(axes[0, 0], comparison.runs, over, INK, measure)
        if axes[0, 0].get_legend_handles_labels()[0]:
            axes[0, 0].legend(fontsize=8, frameon=False, handlelength=2.4, loc="best")
        file = io.StringIO()
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    _, box, drawing = re.split(r'<svg[^>]*?viewBox="([^"]*)"[^>]*>', file.getvalue())
    # neither addresses, which name spaces are, nor names that another plot of the page has, too
    drawing = re.sub(r'<metadata>.*?</metadata>|\sxmlns(:\w+)?="[^"]*"|(?<=<g) id="[^"]*"', "", drawing, flags=re.S)
    head = f'<svg viewBox="{box}" role="img" aria-label="{html.escape(label)}">'
    return head + drawing.replace(INK, "currentColor")


def map_png(shares: Array, palette: str) -> str:
    """Return a map ``(H, W)`` of numbers from 0 to 1 in the colours of matplotlib's `palette`, a PNG in a data URI."""
    return png(matplotlib.colormaps[palette](np.asarray(shares, np.float64), bytes=True)[..., :3])
