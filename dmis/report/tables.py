"""Tables of a report, and how numbers are written in them."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence

import numpy as np

from dmis.experiment import alarm
from dmis.experiment.convergence import MEASURES, Gain, Interval, gains, over_scenes, ratio_text
from dmis.experiment.runs import PINNED
from dmis.experiment.table import COLUMNS, Comparison, cells, run_by_key

LINES_NOTE = """Lines: root of the mean error over seeds; bands: lowest to highest seed. Dotted: the slope −½ of
N<sup>−1/2</sup>. A rule with a pilot can be steeper, because the share of the pilot in the time falls. Dashed or ×, by
MSE, if there is an oracle: the best weights by it, in time and rays of the balance heuristic."""
GAINS_NOTE = """Ratios below 1 are better than the baseline. Errors are means over seeds; CPU seconds are medians, from
the pilot to the last sample. relMSE: mean of d² / (r² + 0.01), d being the difference to the reference r; MSE: mean of
d². In brackets: 95 % intervals of the ratios' logarithms over paired seeds; with several rules at one number of samples
they are wider (Holm). ·CPU s: error times CPU seconds, whose intervals include the scatter of the times. Bold: the
lowest ratio·CPU s of the table, if its interval is below 1 and few pixels do not have most of the error. In equal time:
error over that of the balance heuristic in the rule's CPU seconds, interpolated on its line; † where it is extrapolated
as error ∝ 1 / seconds. Pinned: the balance heuristic with preset=thesis, which is one light and one BRDF sample and
independent points, whatever the settings of the others."""
OVERVIEW_NOTE = """Scenes: relMSE over that of the balance heuristic in equal time, at the largest budget. All:
geometric means over the scenes of error times CPU seconds over the balance heuristic's, with 95 % intervals over seeds.
Below 1 is better."""
RUNS_NOTE = f"""mean_z: mean of the image less that of the reference, in standard errors, of the channel where it is
largest. About ±1 is noise; beyond ±{alarm.ALARM_LIMIT:g} the errors above are not noise, and a paragraph above says why
that may be. The other columns are explained in docs/report.md."""


def winners(c: Comparison, rows: Sequence[Gain], k: int = 0) -> list[Gain]:
    """Return the rules at one budget whose interval of error × CPU time by measure `k` is below 1, the lowest first.

    None wins by a measure that is `Comparison.concentrated`.
    """
    below = [g for g in rows if g.rule != PINNED and g.measures[k].error_time.high < 1]
    trusted = [] if list(MEASURES)[k] in c.concentrated else below
    return sorted(trusted, key=lambda g: g.measures[k].error_time.value)


def efficiency_table(c: Comparison, gains_of_budgets: Sequence[Gain]) -> str:
    """Return the tables of errors and their ratios of all rules and budgets, one for each measure."""
    alarmed = {budget for budget, runs in c.runs.items() if any(abs(run.mean_z) > alarm.ALARM_LIMIT for run in runs)}
    tables = ""
    for k, name in enumerate(MEASURES.values()):
        head = ["spp", "rule", name, f"{name} / balance", f"{name}·CPU s / balance", f"{name} in equal time"]
        head += [f"{name} / pinned", f"{name}·CPU s / pinned"]
        rows = []
        for g in gains_of_budgets:
            m, first = g.measures[k], g.rule == "balance"
            dagger = "†" if m.extrapolated and not first and np.isfinite(m.equal_time) else ""
            cells = [str(g.spp) if first else "", _rule(g.rule) + (" ⚠" if (g.rule, g.spp) in alarmed else "")]
            cells += [f"{m.error:.4g}", interval_text(m.over_balance), interval_text(m.error_time)]
            cells += [f"{ratio_text(m.equal_time)}{dagger}"]
            rows.append([*cells, interval_text(m.over_pinned), interval_text(m.error_time_over_pinned)])
        tables += html_table(head, rows, f"efficiency {name}", _row_marks(gains_of_budgets, c, k))
    return f'{tables}<p class="note">{GAINS_NOTE}</p>'


def costs_table(gains_of_budgets: Sequence[Gain]) -> str:
    """Return the table of what the rules cost: CPU seconds, rays, and errors times CPU seconds."""
    head = ["spp", "rule", "CPU s", "pilot + fit", "Mrays", *(f"{name}·CPU s" for name in MEASURES.values())]
    rows = [
        [
            str(g.spp) if g.rule == "balance" else "", _rule(g.rule), f"{g.cpu_seconds:.2f}", f"{g.overhead:.0%}",
            f"{g.rays / 1e6:.2f}", *(f"{m.error * g.cpu_seconds:.4g}" for m in g.measures),
        ]
        for g in gains_of_budgets
    ]  # fmt: skip
    return html_table(head, rows, "costs", _row_marks(gains_of_budgets))


def _row_marks(gains_of_budgets: Sequence[Gain], c: Comparison | None = None, k: int = 0) -> list[str]:
    """Return the classes of rows: ``group`` where a budget begins, ``best`` for the first of `winners` by `k`."""
    best = []
    if c is not None:
        budgets = {g.spp for g in gains_of_budgets}
        best = [g for spp in budgets for g in winners(c, [g for g in gains_of_budgets if g.spp == spp], k)[:1]]
    marks = [("group" * (g.rule == "balance"), "best" * (g in best)) for g in gains_of_budgets]
    return [" ".join(filter(None, mark)) for mark in marks]


def _rule(name: str) -> str:
    """Return a rule's name, which may be broken after colons and commas."""
    return re.sub("([:,])", r"\1<wbr>", escaped(name))


def overview_table(comparisons: Sequence[Comparison]) -> str:
    """Return the table of relMSE in equal time of all rules on all scenes, each at its largest budget."""
    by_scene = []
    for c in comparisons:
        gains_of_budgets = gains(c.runs)
        largest = max(g.spp for g in gains_of_budgets)
        by_scene.append({g.rule: g for g in gains_of_budgets if g.spp == largest})
    rules = dict.fromkeys(rule for gains_of_rules in by_scene for rule in gains_of_rules)
    ratios = {
        rule: [ratio_text(of[rule].relmse.equal_time) if rule in of else "–" for of in by_scene] for rule in rules
    }
    means = {name: over_scenes([c.runs for c in comparisons], name) for name in MEASURES}
    rows = []
    for rule, of_scenes in ratios.items():
        of_all = [interval_text(of[rule]) if rule in of else "–" for of in means.values()]
        rows.append([_rule(rule), *of_scenes, *of_all])
    head = ["rule", *(escaped(c.scene) for c in comparisons), *(f"all, {name}·CPU s" for name in MEASURES.values())]
    return f'<h2>Overview</h2>{html_table(head, rows, "overview")}<p class="note">{OVERVIEW_NOTE}</p>'


def runs_table(c: Comparison) -> str:
    """Return the table of all runs, cell by cell as in ``results.csv``."""
    runs = run_by_key(run for by_seed in c.runs.values() for run in by_seed)
    rows = [[escaped(value) for value in cells(c.scene, run, runs)] for run in runs.values()]
    return html_table([name.replace("_", "_<wbr>") for name in COLUMNS], rows, "runs")


def html_table(
    head: Sequence[str], rows: Sequence[Sequence[str]], kind: str, marks: Sequence[str] | None = None
) -> str:
    """Return a table of the class `kind`; `marks` are the classes of its rows."""
    titles = "".join(f'<th scope="col">{title}</th>' for title in head)
    lines = [
        f'<tr class="{mark}">' + "".join(f"<td>{value}</td>" for value in row) + "</tr>"
        for row, mark in zip(rows, marks or [""] * len(rows), strict=True)
    ]
    content = f"<thead><tr>{titles}</tr></thead><tbody>{''.join(lines)}</tbody>"
    return f'<div class="wide"><table class="{kind}">{content}</table></div>'


def interval_text(interval: Interval) -> str:
    """Return a ratio with the ends of its interval, if these are known."""
    return interval.text("<small>({} – {})</small>")


def escaped(value: object) -> str:
    """Return a value as text with HTML's special characters escaped."""
    return html.escape(str(value))
