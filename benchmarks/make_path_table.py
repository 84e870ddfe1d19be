"""
The tables of docs/paths.md
===========================

What rules save in path tracing (six surfaces deep) on the thesis's scenes and on the box of colours: mean squared error
over that of the balance heuristic, with equal camera samples (128, pilot included) and in equal time; beside it the
oracle, which knows what weights could save. Times are of the processor, on one thread, rules taking turns, because a
shared machine has no other clock to trust. Takes up to forty minutes; the result is kept with the project.
"""

import sys
from datetime import date
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import IN_TIME, ROOT, TABLES, cell, in_time, options, replace_table, show

import dmis
from dmis.experiment.oracle import make_oracle
from dmis.experiment.runs import measure, median_seconds, on_cpu, spp_in_time

PAGE = ROOT / "docs" / "paths.md"

opts, given = options(
    __file__,
    "rules in path tracing against the balance heuristic and the oracle",
    seeds={"type": int, "default": 4, "help": "number of seeds (default 4)"},
    page={"type": Path, "default": PAGE, "help": "the page whose tables are replaced"},
)
SEEDS = range(given.seeds)
SPP = opts.pick(16, 128)
PATHS = dmis.Settings(integrator="path", max_depth=6, sampler="independent")
RULES = {"power": "pbrt", "second-moment": "second-moment", "auto": "auto"}


# %%
# A first round with equal samples tells how many fit in the time of the balance heuristic; a second one measures that.
equal, timed, known = [], [], []
for name in ("cornell", *TABLES):
    if name == "cornell":
        scene = dmis.load_scene(name, resolution=opts.pick((16, 16), (200, 200)))
    else:
        scene = opts.scene(name, TABLES[name] * opts.pick(8, 1))
    about = {"settings": PATHS, "parallel": 1}
    reference = dmis.make_reference(scene, opts.pick(32, 256), progress=show("reference"), **about)
    oracle = make_oracle(scene, opts.pick(16, 256), progress=show("oracle"), **about)
    runs = measure(
        scene, [(rule, SPP) for rule in ("balance", *RULES.values())], SEEDS, reference, progress=show(name), **about
    )
    base = runs["balance", SPP]
    budgets = {
        rule: (rule, spp_in_time(median_seconds(on_cpu(base)), on_cpu(runs[rule, SPP]))) for rule in RULES.values()
    }
    again = measure(scene, [("balance", SPP), *budgets.values()], SEEDS, reference, progress=show(name), **about)
    width, height = scene.camera.resolution
    row = f"| {scene.name} {width}×{height} |"
    equal.append(" ".join([row, *(f"{cell(runs[rule, SPP], base)} |" for rule in RULES.values())]))
    timed.append(row)
    base = again["balance", SPP]
    for budget, text in zip(budgets.values(), in_time([again[budget] for budget in budgets.values()], base)):
        share = median_seconds(on_cpu(again[budget])) / median_seconds(on_cpu(base))
        timed[-1] += f" {text} ({budget[1]} spp, time × {share:.2f}) |"
    limits = oracle.limit(), oracle.spread_evenly(), oracle.limit_with_counts()
    known.append(" ".join([row, *(f"{limit:.3f} |" for limit in limits)]))
    print(equal[-1], timed[-1], known[-1], sep="\n", flush=True)

# %%
# The tables go between two marks in the page.
head = [f"| scene | {' | '.join(RULES)} |", "|---" * (len(RULES) + 1) + "|"]
replace_table(
    given.page,
    f"paths {'original' if opts.scene_dir else 'shipped'}",
    f"Made on {date.today()} with {given.seeds} seeds, {SPP} samples per pixel, six surfaces deep. {IN_TIME}",
    "",
    "At equal samples:",
    "",
    *head,
    *equal,
    "",
    "In equal time of one processor:",
    "",
    *head,
    *timed,
    "",
    "What the oracle could save at equal samples; in the last column in equal time, by the cost model, no pilot:",
    "",
    "| scene | weights | numbers of samples, at w = ½ | weights and numbers, equal time |",
    "|---|---|---|---|",
    *known,
)
