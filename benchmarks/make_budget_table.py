"""
The budgets of docs/rules.md
============================

Where does learning stop paying? The second-moment rule and auto against the balance heuristic from 16 to 512 camera
samples per pixel, pilot included: at equal camera samples (auto: equal shading samples), and by efficiency, the ratio
of mean squared error times seconds, which is what the error would be in equal time. With stratified or Sobol camera
samples (``--sampler``) for all, the baseline too. Takes a quarter of an hour; the result is kept with the project.
"""

import sys
from datetime import date
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, TABLES, cell, machine, options, replace_table, show

from dmis.experiment.runs import measure, median_seconds, on_cpu

PAGE = ROOT / "docs" / "rules.md"

opts, given = options(
    __file__,
    "the second-moment rule and auto at several budgets",
    seeds={"type": int, "default": 3, "help": "number of seeds (default 3)"},
    budgets={"type": int, "nargs": "+", "help": "camera samples per pixel (default 16 32 128 512)"},
    sampler={"default": "independent", "help": "of all rules (default independent)"},
    page={"type": Path, "default": PAGE, "help": "the page whose table is replaced"},
)
BUDGETS = given.budgets or opts.pick((16, 32), (16, 32, 128, 512))
BASE, WEIGHTS, AUTO = (f"{rule}:sampler={given.sampler}" for rule in ("balance", "second-moment", "auto"))

# %%
# MSE over that of the balance heuristic at the same budget, with the 95 % confidence interval over seeds; bold where
# the interval is below 1. In brackets the same times the ratio of the processor's seconds, on one thread.
lines = ["| scene | rule | " + " | ".join(f"{spp} spp" for spp in BUDGETS) + " |", "|---|---|" + "---|" * len(BUDGETS)]
for name, shrink in TABLES.items():
    scene = opts.scene(name, shrink * opts.pick(4, 1))
    reference = opts.reference(scene, opts.pick(64, 1024))
    budgets = [(rule, spp) for spp in BUDGETS for rule in (BASE, WEIGHTS, AUTO)]
    runs = measure(scene, budgets, range(given.seeds), reference, parallel=1, progress=show(name))
    width, height = scene.camera.resolution
    for rule in (WEIGHTS, AUTO):
        cells = []
        for spp in BUDGETS:
            own, base = runs[rule, spp], runs[BASE, spp]
            each = sum(run.mse for run in own) / sum(run.mse for run in base)
            seconds = median_seconds(on_cpu(own)) / median_seconds(on_cpu(base))
            cells.append(f"{cell(own, base)} ({each * seconds:.2f})")
        lines.append(f"| {scene.name} {width}×{height} | {rule.split(':')[0]} | " + " | ".join(cells) + " |")
    print("\n".join(lines[-2:]), flush=True)

# %%
# The table goes between two marks in the page.
kind = f"budgets {given.sampler}"
about = f"Made on {date.today()} with {given.seeds} seeds, {given.sampler} camera samples, on {machine()}."
replace_table(given.page, kind, about, "", *lines)
