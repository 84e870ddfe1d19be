"""
The parabola of docs/thesis.md, with exact and with estimated variances
=======================================================================

Does the thesis's rule, with w the share of light samples, lose because V(w) is no parabola, or because three variances
from two samples per pixel are wrong? Both are read off the oracle's curves V(w): the weights of parabolas through three
*exact* variances of each patch, and those of the rule's pilots. No image is finished. Takes some minutes, most of them
for the oracles, which are kept; the result is kept with the project.
"""

import sys
from datetime import date
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, SCENES, machine, options, replace_table, show

import dmis
from dmis.base.patches import patch_spread, patch_sum
from dmis.experiment.oracle_renders import make_oracle
from dmis.fit.thesis import parabola_minimum
from dmis.variance.curves import GRID, HALF

opts, given = options(
    __file__,
    "exact and estimated parabolas",
    seeds={"type": int, "default": 8, "help": "number of pilots (default 8)"},
    page={"type": Path, "default": ROOT / "docs" / "thesis.md", "help": "the page whose table is replaced"},
)
ENDS = [0, HALF, len(GRID) - 1]
MISSED = 0.1
"""A pilot has missed a technique's bright samples if it reports less than this share of the technique's variance."""

# %%
# V at the shares w, over V at 1/2, both summed over the image: what the rule's weights do to the error. The loss is
# V(w) - V(1/2) where that is above 0, before the filter; the last column is the part of it in patches whose pilot has
# missed bright samples.
lines = [
    "| scene | patch | exact parabola | pilot, 5×5 filter | patches that missed | of the loss |",
    "|---|---|---|---|---|---|",
]
for name in SCENES:
    scene = opts.scene(name, opts.pick(32, 8))
    more = {"preset": "thesis-shares", "parallel": opts.threads}
    oracle = make_oracle(scene, opts.pick(16, 512), progress=show(f"{name}: oracle"), **more)
    height, width = oracle.shape
    area = patch_sum(np.ones((height, width)), oracle.patch)
    half = (area * oracle.variance[HALF]).sum()
    for size in opts.pick((4,), (4, 8, 16)):
        blocks = size // oracle.patch
        exact = patch_sum(area * oracle.variance, blocks) / patch_sum(area, blocks)  # (G, rows, columns) of patches
        best, _ = parabola_minimum(GRID[ENDS], exact[ENDS])
        ratios, missed, lost = [], [], []
        for seed in range(given.seeds):
            result = dmis.render(scene, f"thesis:patch={size}", 8, seed=seed, **more)
            raw = patch_spread(result.maps["raw"], size, (height, width))
            ratios.append((area * oracle.at(result.weight)).sum() / half)
            wrong = (result.maps["variances"] < MISSED * exact[ENDS]).any(axis=0)
            loss = area * np.maximum(oracle.at(raw) - oracle.variance[HALF], 0)
            missed.append(wrong.mean())
            lost.append((loss * patch_spread(wrong, blocks, loss.shape)).sum() / loss.sum())
        told = (area * oracle.at(patch_spread(best, size, (height, width)))).sum() / half
        lines.append(
            f"| {scene.name} {width}×{height} | {size} | {told:.2f} | {np.mean(ratios):.2f} "
            f"| {np.mean(missed):.0%} | {np.mean(lost):.0%} |"
        )
        print(lines[-1], flush=True)

about = f"Made on {date.today()} with {given.seeds} pilots, on {machine()}."
replace_table(given.page, "parabola", about, "", *lines)
