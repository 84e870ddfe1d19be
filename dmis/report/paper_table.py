"""Table of a comparison for a paper: LaTeX with booktabs, Markdown or CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np

from dmis.base.validate import one_of
from dmis.experiment.convergence import Interval, gains, ratio_text
from dmis.experiment.runs import PINNED
from dmis.experiment.table import Comparison

STYLES = (".tex", ".md", ".csv")
"""Extensions of the files that a table may be written to."""
TITLES = ("spp", "rule", "relMSE", "relMSE / balance", "MSE", "MSE / balance", "relMSE x CPU s / balance", "CPU s")


def paper_table(comparison: Comparison, style: str) -> str:
    """Return the table of a comparison in a style of `STYLES`, a row for each budget and rule.

    Errors, their ratios to the balance heuristic at equal samples, and the ratio of error times CPU seconds, with 95 %
    intervals corrected for the number of rules. A ratio is bold only if its whole interval is below 1, and its measure
    is not `Comparison.concentrated`. In CSV the ends of an interval are columns.

    Parameters
    ----------
    comparison
        See `dmis.experiment.table.read_comparison`.
    style
        The extension of the file. LaTeX needs the package booktabs.

    Raises
    ------
    ValueError
        If there is no such style.
    """
    one_of("extension of a table", style, STYLES)
    rows = []
    for gain in gains(comparison.runs):
        if gain.rule == PINNED:
            continue
        ratios = gain.relmse.over_balance, gain.mse.over_balance, gain.relmse.error_time
        errors = f"{gain.relmse.error:.3e}", f"{gain.mse.error:.3e}"
        bold = [measure not in comparison.concentrated for measure in ("relmse", "mse", "relmse")]
        first, second, third = map(_cells, ratios, bold, [style] * 3)
        rule = _tex(gain.rule) if style == ".tex" else gain.rule
        seconds = f"{gain.cpu_seconds:.3g}"
        rows.append([str(gain.spp), rule, errors[0], *first, errors[1], *second, *third, seconds])
    return {".tex": _latex, ".md": _markdown, ".csv": _csv}[style](rows)


def _cells(ratio: Interval, may_be_bold: bool, style: str) -> list[str]:
    """Return a ratio with its interval in one cell, bold if it may be and all of it is below 1; of CSV in three."""
    if style == ".csv":
        return [f"{value:.5g}" for value in ratio]
    bold, dash = (r"\textbf{{{}}}", "--") if style == ".tex" else ("**{}**", "–")
    value = ratio_text(ratio.value)
    value = bold.format(value) if may_be_bold and ratio.high < 1 else value
    known = not np.isnan(ratio.high)  # else of balance itself, or of one seed
    return [f"{value} ({ratio_text(ratio.low)}{dash}{ratio_text(ratio.high)})" if known else value]


def _tex(text: str) -> str:
    """Return a text with LaTeX's special characters escaped."""
    for character in "\\&%$#_{}":
        text = text.replace(character, rf"\{character}" if character != "\\" else r"\textbackslash ")
    return text


def _latex(rows: Sequence[Sequence[str]]) -> str:
    """Return the rows between the rules of booktabs, a thin one before each number of samples."""
    titles = [title.replace("x CPU", r"$\times$ CPU") for title in TITLES]
    lines = [r"% needs \usepackage{booktabs}", r"\begin{tabular}{rlrrrrrr}", r"\toprule", rf"{' & '.join(titles)} \\"]
    before = ""
    for row in rows:
        lines += [r"\midrule"] if row[0] != before else []
        before = row[0]
        lines.append(rf"{' & '.join(row)} \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(TITLES)} |", "|---" * len(TITLES) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows), ""])


def _csv(rows: Sequence[Sequence[str]]) -> str:
    names = ["spp", "rule", "relmse"]
    for name in ("relmse_over_balance", "mse_over_balance", "relmse_cpu_over_balance"):
        names += ["mse"] if name.startswith("mse") else []
        names += [name, f"{name}_low", f"{name}_high"]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([[*names, "cpu_seconds"], *rows])
    return text.getvalue()
