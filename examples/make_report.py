"""
A report on the four scenes
===========================

Error against time of five rules on the four scenes, in one page that can be sent around: ``figures/report.html``.
Samples are independent, so that lines fall as 1 / n and the best weights a bound. What is measured is kept in
``figures/report/``, a folder for each scene, so that an interrupted run goes on where it was, and a second one with
more seeds renders only those. Made to take less than ten minutes on two quiet cores. With ``--docs`` rows go to
``docs/tables``, from which `tables` makes that of docs/report.md, and the picture to ``docs/images``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from common import ROOT, SCENES, TABLES, options, show

sys.path.insert(0, str(ROOT / "benchmarks"))
from rows import markdown, read_rows, read_runs, write_rows, writer

import dmis
from dmis import plot
from dmis.experiment.compare import summary
from dmis.experiment.convergence import MEASURES, gains
from dmis.experiment.oracle import Oracle
from dmis.experiment.report.page import write_report
from dmis.experiment.report.plots import error_lines

RULES = ("balance", "pbrt", "thesis:weigh=samples", "second-moment", "auto")
CSV = ROOT / "docs" / "tables" / "report.csv"
LIMITS_CSV = ROOT / "docs" / "tables" / "report-limits.csv"
LIMITS = ("scene", "equal samples", "equal time")
"""Columns of the errors of the best shares, without a pilot, over that of balance."""


def tables() -> dict[str, list[str]]:
    """Return the lines of the block: error ratios at the largest budget."""
    scenes = read_runs(CSV)
    rows = {rule: [rule] for rule in RULES[1:]}
    for runs in scenes.values():
        largest = max(run.spp for run in runs)
        for gain in (gain for gain in gains(runs) if gain.spp == largest and gain.rule in rows):
            cells = (
                f"{m.over_balance.text()}, {m.equal_time:.2f}{'†' if m.extrapolated else ''}" for m in gain.measures
            )
            rows[gain.rule] += cells
    best = ["*best shares, no pilot*"]
    for row in read_rows(LIMITS_CSV):
        best += ["–", f"{float(row['equal samples']):.3f}, {float(row['equal time']):.2f}"]
    head = ["rule", *(f"{SCENES[scene].title}, {error}" for scene in scenes for error in MEASURES.values())]
    return {"report.md: four scenes": markdown(head, [*rows.values(), best])}


def draw(comparisons: Sequence[dmis.Comparison], oracles: Sequence[Oracle], path: Path) -> None:
    """Draw error over seconds and over rays, a column for each scene."""
    figure, axes = plot.canvas(2, len(comparisons), 22, 10, sharey="col")
    for column, comparison, oracle in zip(axes.T, comparisons, oracles, strict=True):
        for axis, over in zip(column, ("seconds", "rays"), strict=True):
            error_lines(axis, comparison.runs, over, oracle)
        column[0].set_title(SCENES[comparison.scene].title, fontsize=11)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right center")
    figure.savefig(path, dpi=80)


def main() -> None:
    """Measure, and write the page."""
    opts, given = options(
        __file__,
        __doc__ or "",
        seeds={"type": int, "default": 3, "help": "number of seeds (default 3)"},
        scenes={"nargs": "+", "choices": list(SCENES), "default": list(SCENES), "help": "only these scenes"},
        page={"type": Path, "help": "the page to write (default report.html beside the folder)"},
        docs={"action": "store_true", "help": "also write the rows and the picture of docs/report.md"},
    )
    folder = opts.output.parent / "report"
    page = given.page or opts.output.parent / "report.html"
    begin = time.perf_counter()
    comparisons, oracles = [], []
    for name in given.scenes:
        # references and oracles are rendered once and kept; each scene's folder also has a page of its own
        scene = opts.scene(name, TABLES[name] * opts.pick(8, 1))
        reference = opts.reference(scene, opts.pick(16, 512))
        oracle = dmis.make_oracle(scene, opts.pick(16, 256), parallel=opts.threads, progress=show(f"oracle of {name}"))
        comparison = dmis.compare(
            scene,
            RULES,
            opts.pick((8, 32), (16, 32, 64, 128)),
            range(given.seeds),
            reference,
            folder / name,
            oracle=oracle,
            sampler="independent",
            parallel=opts.threads,
            progress=show(SCENES[name].title),
        )
        comparisons.append(comparison)
        oracles.append(oracle)
        print(f"{SCENES[name].title}, {time.perf_counter() - begin:.0f} s\n{summary(comparison)}\n", flush=True)
    write_report(comparisons, page, "Error against time, on four scenes")
    if given.docs and opts.size != "quick":  # numbers of tiny images are not for the pages of the project
        CSV.unlink(missing_ok=True)
        for comparison in comparisons:
            for run in comparison.runs:
                writer(CSV, comparison.scene)(run)
        limits = [(c.scene, o.limit(), o.limit(costly=True)) for c, o in zip(comparisons, oracles, strict=True)]
        write_rows(LIMITS_CSV, [dict(zip(LIMITS, row, strict=True)) for row in limits], LIMITS)
        draw(comparisons, oracles, ROOT / "docs" / "images" / "error-vs-time.png")
    print(page)


if __name__ == "__main__":
    main()
