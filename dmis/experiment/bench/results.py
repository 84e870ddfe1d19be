"""Scores as tables: of all scenes together, and of each."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np

from dmis.base.vectors import Array
from dmis.experiment.bench.judge import COLUMNS, Score
from dmis.experiment.metrics import mean_and_error

STYLES = {"text": ("", "  ", ""), "markdown": ("| ", " | ", " |"), "latex": ("", " & ", r" \\"), "json": ("", "", "")}
"""Forms of the tables: how a row begins, what is between its cells, and how it ends."""


def report(scores: Mapping[str, Score], style: str = "text") -> str:
    """Return tables of scores by name: means over seeds, with half the width of their 95 % intervals.

    The first has all columns over all scenes, the second absolute and relative error times cost over that of balance in
    each scene. As JSON, the columns of each seed by scene.
    """
    if style == "json":
        columns = {name: {k: v.T.tolist() for k, v in score.values.items()} for name, score in scores.items()}
        return json.dumps({"columns": COLUMNS, "scores": columns})
    total = [["all scenes", *COLUMNS], *([name, *map(_cell, s.over_scenes().T)] for name, s in scores.items())]
    by_scene = [["absolute, relative", *next(iter(scores.values())).values]]
    for name, score in scores.items():
        by_scene.append([name, *(f"{_cell(v[:, 0])}, {_cell(v[:, 1])}" for v in score.values.values())])
    return "\n\n".join(_lay_out(rows, style) for rows in (total, by_scene))


def _cell(values: Array) -> str:
    """Return the mean of the values of seeds, and half the width of its interval if there is one."""
    from scipy.stats import t  # imported where used: scipy.stats takes half a second

    mean, error = mean_and_error(values)
    width = t.ppf(0.975, max(len(values) - 1, 1)) * error
    return f"{mean:.3g} ± {width:.1g}" if width > 5e-4 * abs(mean) else f"{mean:.3g}"


def _lay_out(rows: Sequence[Sequence[str]], style: str) -> str:
    """Return a table, whose first row is its head; of LaTeX the rows of a ``tabular``."""
    begin, between, end = STYLES[style]
    widths = np.max([[len(cell) for cell in row] for row in rows], axis=0) * (style == "text")
    lines = [begin + between.join(map(str.ljust, row, widths.tolist())).rstrip() + end for row in rows]
    if style == "markdown":
        lines.insert(1, f"|{'---|' * len(rows[0])}")
    return "\n".join(lines).replace("±", r"$\pm$" if style == "latex" else "±")
