"""
The table of docs/reproduction.md
=================================

For each scene, the thesis's rule at patches of 4, 8, 16 and 32 pixels against two baselines, at equal camera samples
(128, pilot included) and over several seeds: one light and one BRDF sample with the balance heuristic, and the
one-sample model, which picks a technique at random with w = 1/2. Takes a quarter of an hour; the result is kept with
the project, once for the scenes that come with dmis, and once (``--scene-dir``) for the original ones.
"""

import sys
from datetime import date
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import ROOT, SCENES, cell, machine, options, replace_table, show

import dmis

PAGE = ROOT / "docs" / "reproduction.md"
PATCHES = (4, 8, 16, 32)

opts, given = options(
    __file__,
    "the thesis's rule against two baselines, by patch size",
    seeds={"type": int, "default": 6, "help": "number of seeds (default 6)"},
    page={"type": Path, "default": PAGE, "help": "the page whose table is replaced"},
)

# %%
# MSE of the row over MSE of the column's baseline, same seeds, with the 95 % confidence interval; in bold where the
# interval is below 1.
lines = ["| scene | rule | MSE / balance 1+1 | MSE / one-sample ½ |", "|---|---|---|---|"]
for name in SCENES:
    scene = opts.scene(name, opts.pick(16, 4))
    reference = opts.reference(scene)
    rules = {"one-sample ½": "one-sample", **{f"thesis, patch {p}": f"thesis:patch={p}" for p in PATCHES}}
    rules["thesis, patch 16, pilot in the image"] = "thesis:patch=16,reuse=yes"
    budgets = [(rule, opts.spp) for rule in ("balance", *rules.values())]
    runs = dmis.measure(scene, budgets, range(given.seeds), reference, parallel=opts.threads, progress=show(name))
    width, height = scene.camera.resolution
    for title, rule in rules.items():
        against = [cell(runs[rule, opts.spp], runs[base, opts.spp]) for base in ("balance", "one-sample")]
        lines.append(f"| {scene.name} {width}×{height} | {title} | {against[0]} | {against[1]} |")
    print("\n".join(lines[-len(rules) :]), flush=True)
    lines = [line.replace("| 1.000 ± 0.000 |", "| 1 |") for line in lines]

# %%
# The table goes between two marks in the page.
kind = "original" if opts.scene_dir else "shipped"
about = f"Made on {date.today()} with {given.seeds} seeds at {opts.spp} camera samples per pixel, on {machine()}."
replace_table(given.page, kind, about, "", *lines)
