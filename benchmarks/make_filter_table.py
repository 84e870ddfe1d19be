"""
The table of filters in docs/measurements.md
=====================================

How curves are shared between patches: for each way, the share of the oracle's saving that learned weights reach, and
the share of patches that they make worse, over several pilots. Only weights are learned, no image is finished. Takes
some ten minutes, most of them for the oracles; the result is kept with the project.
"""

import sys
from datetime import date
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, TABLES, machine, options, replace_table, show

import dmis
from dmis.experiment.oracle_renders import make_oracle

PAGE = ROOT / "docs" / "measurements.md"
WAYS = {
    "none": "filter=none",
    "Gaussian": "filter=gaussian",
    "joint": "filter=joint",
}

opts, given = options(
    __file__,
    "ways to share curves between patches, by what of the oracle's saving they reach",
    seeds={"type": int, "default": 8, "help": "number of pilots (default 8)"},
    page={"type": Path, "default": PAGE, "help": "the page whose table is replaced"},
)

# %%
# The pilot takes six samples; a budget of eight leaves the final pass with next to nothing to do.
columns, cells = [], {way: [] for way in WAYS}
for name, shrink in TABLES.items():
    scene = opts.scene(name, shrink * opts.pick(8, 1))
    width, height = scene.camera.resolution
    columns.append(f"{scene.name} {width}×{height}")
    oracle = make_oracle(scene, opts.pick(16, 1024), parallel=opts.threads, progress=show("oracle"))
    for way, text in WAYS.items():
        rule = f"second-moment:cost=no,{text}"
        maps = [dmis.render(scene, rule, 8, seed=seed, parallel=opts.threads).weight for seed in range(given.seeds)]
        saving, harm = np.mean([(oracle.saving(w), oracle.harm(w)[0]) for w in maps], axis=0)
        cells[way].append(f"{saving:.0%}, harm {harm:.1%}")
        print(f"{columns[-1]} {way}: {cells[way][-1]}", flush=True)

lines = [f"| filter | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
lines += [f"| {way} | {' | '.join(row)} |" for way, row in cells.items()]
about = f"Made on {date.today()} with {given.seeds} pilots, on {machine()}."
replace_table(given.page, "filters", about, "", *lines)
