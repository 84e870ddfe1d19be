"""
Several techniques: the table of docs/measurements.md
==============================================

Does a third technique pay? Light, BRDF and resampled light samples with shares that are learned, or given, against the
balance heuristic and the second-moment rule, which mix the first two: at equal camera samples, and by efficiency, the
ratio of mean squared error times seconds, which is what the error would be in equal time: samples are independent.
Takes ten minutes; the result is kept with the project.
"""

import sys
from datetime import date
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, cell, machine, options, replace_table, show

from dmis.examples.gallery import on_cpu
from dmis.experiment.runs import measure, median_seconds

PAGE = ROOT / "docs" / "measurements.md"

opts, given = options(
    __file__,
    "learned and given shares of three techniques",
    seeds={"type": int, "default": 4, "help": "number of seeds (default 4)"},
    spp={"type": int, "help": "camera samples per pixel (default 64)"},
    page={"type": Path, "default": PAGE, "help": "the page whose table is replaced"},
)
SHRINK = {"teapot-area-light": 6, "killeroo-diffuse": 9, "killeroo-gold": 9, "tt": 10}  # the thesis's sizes
SPP = given.spp or opts.pick(16, 64)
RULES = (
    "second-moment",
    "simplex:light+brdf",
    "simplex:light+brdf+resampled",
    "simplex:light+brdf+resampled,cost=no",
    "simplex:light+brdf+uniform",
    "simplex:light=0.25,brdf=0.25,resampled=0.5",
)

# %%
# MSE over that of the balance heuristic, with the 95 % confidence interval over seeds; bold where it is below 1.
# In brackets the same times the ratio of the processor's seconds, on one thread.
rows = {rule: [] for rule in RULES}
names = []
for name, shrink in SHRINK.items():
    scene = opts.scene(name, shrink * opts.pick(4, 1))
    reference = opts.reference(scene, opts.pick(64, 1024))
    budgets = [(rule, SPP) for rule in ("balance", *RULES)]
    runs = measure(
        scene, budgets, range(given.seeds), reference, sampler="independent", parallel=1, progress=show(name)
    )
    names.append("{} {}×{}".format(scene.name, *scene.camera.resolution))
    for rule, row in rows.items():
        own, base = runs[rule, SPP], runs["balance", SPP]
        each = sum(run.mse for run in own) / sum(run.mse for run in base)
        seconds = median_seconds(on_cpu(own)) / median_seconds(on_cpu(base))
        row.append(f"{cell(own, base)} ({each * seconds:.2f})")
        print(name, rule, row[-1], flush=True)

# %%
# The table goes between two marks in the page.
lines = ["| rule | " + " | ".join(names) + " |", "|---|" + "---|" * len(names)]
lines += [f"| `{rule}` | " + " | ".join(row) + " |" for rule, row in rows.items()]
about = f"Made on {date.today()} with {SPP} samples per pixel and {given.seeds} seeds, on {machine()}."
replace_table(given.page, "simplex", about, "", *lines)
