"""
A report on the four scenes
===========================

Error against time of five rules on the four scenes, in one page that can be sent around: ``figures/report.html``.
Samples are independent, so that lines fall as 1 / n and the best weights a bound. What is measured is kept in
``figures/report/``, a folder for each scene, so that an interrupted run goes on where it was, and a second one with
more seeds renders only those. Made to take less than ten minutes on two quiet cores.
"""

import time
from datetime import date
from pathlib import Path

from common import SCENES, TABLES, machine, options, replace_table, show

import dmis
from dmis import plot
from dmis.experiment.compare import summary
from dmis.experiment.convergence import MEASURES, gains
from dmis.experiment.report.page import write_report
from dmis.experiment.report.plots import error_lines

opts, given = options(
    __file__,
    __doc__,
    seeds={"type": int, "default": 3, "help": "number of seeds (default 3)"},
    scenes={"nargs": "+", "choices": list(SCENES), "default": list(SCENES), "help": "only these scenes (default: all)"},
    page={"type": Path, "help": "the page to write (default report.html beside the folder)"},
    docs={"type": Path, "help": "also replace the tables of this page, and the picture in its folder images"},
)
RULES = ("balance", "pbrt", "thesis:weigh=samples", "second-moment", "auto")
BUDGETS = opts.pick((8, 32), (16, 32, 64, 128))
folder = opts.output.parent / "report"
page = given.page or opts.output.parent / "report.html"

# %%
# References and oracles are rendered once and kept. Each scene's folder also has a page of its own.
begun = time.perf_counter()
comparisons, limits = [], []
for name in given.scenes:
    scene = opts.scene(name, TABLES[name] * opts.pick(8, 1))
    reference = opts.reference(scene, opts.pick(16, 512))
    oracle = dmis.make_oracle(scene, opts.pick(16, 256), parallel=opts.threads, progress=show(f"oracle of {name}"))
    comparison = dmis.compare(
        scene,
        RULES,
        BUDGETS,
        range(given.seeds),
        reference,
        folder / name,
        oracle=oracle,
        sampler="independent",
        parallel=opts.threads,
        progress=show(SCENES[name].title),
    )
    comparisons.append(comparison)
    limits.append(oracle)
    table = summary(comparison)
    print(f"{SCENES[name].title}, {time.perf_counter() - begun:.0f} s\n{table}\n", flush=True)

# %%
# One page for all.
write_report(comparisons, page, "Error against time, on four scenes")

# %%
# The same in a table and a picture, for the pages of the project. Error ratios at the largest budget.
rows = {rule: f"| {rule} |" for rule in RULES[1:]}
best = "| *best shares, no pilot* |"
figure, axes = plot.canvas(2, len(given.scenes), 22, 10, sharey="col")
for column, comparison, oracle in zip(axes.T, comparisons, limits, strict=True):
    runs, title = comparison.runs, SCENES[comparison.scene].title
    for axis, over in zip(column, ("seconds", "rays"), strict=True):
        error_lines(axis, runs, over, oracle)
    column[0].set_title(title, fontsize=11)
    for gain in (gain for gain in gains(runs) if gain.spp == BUDGETS[-1]):
        if gain.rule in rows:
            for m in gain.measures:
                rows[gain.rule] += f" {m.over_balance.text()}, {m.equal_time:.2f}{'†' if m.extrapolated else ''} |"
    best += f" – | {oracle.limit():.3f}, {oracle.limit(costly=True):.2f} |"
lines = [
    f"| rule | {' | '.join(f'{SCENES[c.scene].title}, {error}' for c in comparisons for error in MEASURES.values())} |",
    "|---" * (1 + 2 * len(comparisons)) + "|",
    *rows.values(),
    best,
]
figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right center")
if given.docs is not None:
    figure.savefig(given.docs.parent / "images" / "error-vs-time.png", dpi=80)
    took = f"{time.perf_counter() - begun:.0f} s"
    about = f"Made on {date.today()} in {took} with {given.seeds} seeds, on {machine()}."
    replace_table(given.docs, "four scenes", about, "", *lines)
print(page)
