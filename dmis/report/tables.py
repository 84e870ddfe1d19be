"""Tables of errors, times and their ratios: in reports, on the command line, and for papers."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dmis.base.validate import did_you_mean, one_of
from dmis.experiment import alarm
from dmis.experiment.convergence import MEASURES, Gain, Interval, gains, over_scenes, ratio_text
from dmis.experiment.runs import PINNED, fallbacks
from dmis.experiment.table import Comparison

ERRORS = tuple(MEASURES.values())
OVER = ("", " / balance", "·CPU s / balance", " in equal time", " / pinned", "·CPU s / pinned")
"""Columns of a report's table of errors, each after the name of the measure."""
TOO_FEW = "(–): too few seeds for intervals; compare with more --seeds"
"""Line below a table with an interval that `dmis.experiment.convergence.Interval.is_wide`."""
PAPER = ("spp", "rule", *(f"{name}{over}" for name in ERRORS for over in OVER[:3]), "CPU s")
"""Columns of a table for a paper."""
SUMMARY = (*PAPER, *(f"{name}·CPU s / pinned" for name in ERRORS))
"""Columns of the table that ``compare`` prints."""
COSTS = ("spp", "rule", "CPU s", "pilot + fit", "Mrays", *(f"{name}·CPU s" for name in ERRORS))
"""Columns of a report's table of costs."""
_LATEX = str.maketrans({c: rf"\{c}" for c in "&%$#_{}"} | {"\\": r"\textbackslash ", "·": r"$\cdot$"})
_MARKUP = {".tex": ("({}--{})", r"\textbf{{{}}}", _LATEX), ".md": ("({} – {})", "**{}**", {})}
"""Ends of an interval, bold text, and characters that are written otherwise, of each style."""
STYLES = (*_MARKUP, ".csv")
"""Extensions of the files that a table may be written to."""


@dataclass(frozen=True)
class Table:
    """Titles of columns, and rows of cells: texts, or ratios with their intervals.

    Attributes
    ----------
    marks
        Class of each row in a report.
    uncertain
        Names of measures whose ratios are never bold.
    """

    titles: Sequence[str]
    rows: Sequence[Sequence[str | Interval]]
    marks: Sequence[str] = ()
    uncertain: tuple[str, ...] = ()

    def text(self, style: str = ".md") -> str:
        """Return the table in a style of `STYLES`; LaTeX needs the package booktabs.

        A ratio is bold only if its whole interval is below 1. `TOO_FEW` follows if an interval is wide. In CSV the ends
        of an interval are columns.
        """
        one_of("extension of a table", style, STYLES)
        if style == ".csv":
            return self._csv()
        ends, bold, special = _MARKUP[style]
        head = [title.translate(special) for title in self.titles]
        rows = [self._texts(row, ends, bold, special) for row in self.rows]
        is_wide = any(cell.is_wide for row in self.rows for cell in row if isinstance(cell, Interval))
        note = [TOO_FEW] if is_wide else []
        if style == ".md":
            lines = [f"| {' | '.join(line)} |\n" for line in (head, *rows)]
            lines.insert(1, "|---" * len(head) + "|\n")
            return "".join([*lines, *(f"\n{line}\n" for line in note)])
        lines = [r"% needs \usepackage{booktabs}", rf"\begin{{tabular}}{{rl{'r' * (len(head) - 2)}}}", r"\toprule"]
        for before, line in zip(["", head, *rows], [head, *rows], strict=False):
            lines += [r"\midrule"] if before and line[0] != before[0] else []  # a thin line before each budget
            lines.append(" & ".join(line) + r" \\")
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", *(f"% {line}" for line in note), ""])

    def _texts(self, row: Sequence[str | Interval], ends: str, bold: str, special: Mapping[int, str]) -> list[str]:
        """Return the texts of a row in the markup of a style, see `_MARKUP`."""
        texts = []
        for title, cell in zip(self.titles, row, strict=True):
            if isinstance(cell, str):
                texts.append(cell.translate(special))
                continue
            text = cell.text(ends)
            uncertain = cell.is_wide or title.startswith(self.uncertain)
            if cell.high < 1 and not uncertain:
                text = bold.format(text)
            texts.append(text)
        return texts

    def _csv(self) -> str:
        """Return the table as CSV."""

        def values(cell: str | Interval) -> list[str]:
            return [cell] if isinstance(cell, str) else [f"{value:.5g}" for value in cell]

        head = []
        for title, cell in zip(self.titles, self.rows[0], strict=True):
            name = title.lower().replace("·cpu s", "_cpu").replace("cpu s", "cpu_seconds").replace(" / ", "_over_")
            head += [f"{name}{end}" for end in ("", "_low", "_high")[: len(values(cell))]]
        text = io.StringIO()
        rows = [[value for cell in row for value in values(cell)] for row in self.rows]
        csv.writer(text, lineterminator="\n").writerows([head, *rows])
        return text.getvalue()


def gain_cells(g: Gain) -> dict[str, str | Interval]:
    """Return what tables have of a rule at one budget, by the titles of their columns."""
    row: dict[str, str | Interval] = {
        "spp": str(g.spp),
        "rule": g.rule,
        "CPU s": f"{g.cpu_seconds:.2f}",
        "pilot + fit": f"{g.overhead:.0%}",
        "Mrays": f"{g.rays / 1e6:.2f}",
    }
    for name, m in zip(ERRORS, g.measures, strict=True):
        dagger = "†" if m.extrapolated and g.rule != "balance" and np.isfinite(m.equal_time) else ""
        row |= {
            name: f"{m.error:.4g}",
            f"{name}·CPU s": f"{m.error * g.cpu_seconds:.4g}",
            f"{name} / balance": m.over_balance,
            f"{name}·CPU s / balance": m.error_time,
            f"{name} in equal time": f"{ratio_text(m.equal_time)}{dagger}",
            f"{name} / pinned": m.over_pinned,
            f"{name}·CPU s / pinned": m.error_time_over_pinned,
        }
    return row


def chosen_gains(c: Comparison, rules: Sequence[str] = (), spp: int = 0) -> list[Gain]:
    """Return the gains of `rules`, or of all but the pinned baseline, at all budgets or at one.

    A ValueError if a rule is not among those of the comparison.
    """
    of_budget = [g for g in gains(c.runs) if g.spp == spp or not spp]
    names = dict.fromkeys(g.rule for g in of_budget)
    for name in rules:
        if name not in names:
            raise ValueError(
                f"rules of a figure must be among those of the comparison{f' at {spp} samples per pixel' * bool(spp)}, "
                f"{', '.join(names)}; got {name!r}{did_you_mean(name, names)}"
            )
    return [g for g in of_budget if (g.rule in rules if rules else g.rule != PINNED)]


def paper_titles(metric: str) -> list[str]:
    """Return the titles in `PAPER` without errors by other measures than `metric`, one of `MEASURES`."""
    name = MEASURES[one_of("metric of a table", metric, MEASURES)]
    return [title for title in PAPER if title.startswith(name) or not title.startswith(ERRORS)]


def paper_table(c: Comparison, rules: Sequence[str] = (), titles: Sequence[str] = PAPER) -> Table:
    """Return the table of a comparison, a row for each budget and rule, see `chosen_gains`.

    No ratio by a measure that is `Comparison.concentrated` is bold.
    """
    rows = list(map(gain_cells, chosen_gains(c, rules)))
    uncertain = tuple(MEASURES[measure] for measure in c.concentrated)
    return Table(titles, [[row[title] for title in titles] for row in rows], uncertain=uncertain)


def summary(c: Comparison) -> str:
    """Return what ``compare`` prints: a table of all rules in Markdown, and lines about what makes it doubtful.

    These are about few pixels that have most of an error; budgets too small for their rule
    (`dmis.experiment.runs.fallbacks`); the standard error of the reference, and whether that is too large; images with
    another mean, and pilots that make most of an image's error (`dmis.experiment.alarm`).
    """
    table = paper_table(c, [rule for rule, _ in c.runs], SUMMARY)
    doubts = filter(None, [c.few_pixels(), *fallbacks(c.runs), c.reference.text(), *c.alarms()])
    return "\n".join([table.text(), *(f"{line}\n" for line in doubts)]).rstrip("\n")


def overview(comparisons: Sequence[Comparison]) -> Table:
    """Return the table of relMSE in equal time on each scene, and the geometric means of `over_scenes`, by rule.

    Each scene counts at its largest budget.
    """
    columns: list[dict[str, str | Interval]] = []
    for c in comparisons:
        largest = max(spp for _, spp in c.runs)
        columns.append({g.rule: ratio_text(g.relmse.equal_time) for g in gains(c.runs) if g.spp == largest})
    rules = dict.fromkeys(rule for column in columns for rule in column)
    columns += [dict(over_scenes([c.runs for c in comparisons], measure)) for measure in MEASURES]
    titles = ["rule", *(c.scene for c in comparisons), *(f"all, {name}·CPU s" for name in ERRORS)]
    return Table(titles, [[rule, *(column.get(rule, "–") for column in columns)] for rule in rules])


def winners(c: Comparison, rows: Sequence[Gain], k: int = 0) -> list[Gain]:
    """Return the rules at one budget whose interval of error × CPU time by measure `k` is below 1, the lowest first.

    None wins by a measure that is `Comparison.concentrated`.
    """
    below = [g for g in rows if g.rule != PINNED and g.measures[k].error_time.high < 1]
    trusted = [] if list(MEASURES)[k] in c.concentrated else below
    return sorted(trusted, key=lambda g: g.measures[k].error_time.value)


def report_tables(c: Comparison, rows: Sequence[Gain]) -> dict[str, Table]:
    """Return the tables of a report by their class: errors by both measures, and costs.

    A budget begins a ``group`` of rows; ``best`` is the first of `winners`, and ⚠ marks the alarms of
    `dmis.experiment.alarm`.
    """
    alarmed = {budget for budget, runs in c.runs.items() if any(abs(run.mean_z) > alarm.ALARM_LIMIT for run in runs)}
    shown = []
    for g in rows:
        spp = str(g.spp) if g.rule == "balance" else ""
        shown.append(gain_cells(g) | {"spp": spp, "rule": g.rule + " ⚠" * ((g.rule, g.spp) in alarmed)})
    groups = ["group" * (g.rule == "balance") for g in rows]
    tables = {}
    for k, name in enumerate(ERRORS):
        best = [winners(c, [g for g in rows if g.spp == spp], k)[:1] for spp in dict.fromkeys(g.spp for g in rows)]
        marks = [f"{group}{' best' * ([g] in best)}".strip() for group, g in zip(groups, rows, strict=True)]
        titles = ["spp", "rule", *(f"{name}{over}" for over in OVER)]
        tables[f"efficiency {name}"] = Table(titles, [[row[title] for title in titles] for row in shown], marks)
    tables["costs"] = Table(COSTS, [[row[title] for title in COSTS] for row in shown], groups)
    return tables
