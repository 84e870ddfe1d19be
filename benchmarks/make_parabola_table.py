"""
The parabola of docs/thesis.md, with exact and with estimated variances
=======================================================================

Does the thesis's rule, with w the share of light samples, lose because V(w) is no parabola, or because three variances
from two samples per pixel are wrong? Both are read off the oracle's curves V(w): the weights of parabolas through three
*exact* variances of each patch, and those of the rule's pilots. No image is finished. Takes some minutes, most of them
for the oracles, which are kept. Rows go to docs/tables/parabola.csv; scenes that are there are not measured again.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, SCENES, options, show
from rows import markdown, read_rows, write_rows

import dmis
from dmis.base.patches import patch_spread, patch_sum
from dmis.experiment.oracle import Oracle
from dmis.experiment.oracle_renders import make_oracle
from dmis.fit.thesis import parabola_minimum
from dmis.variance.curves import GRID, HALF

CSV = ROOT / "docs" / "tables" / "parabola.csv"
FIELDS = ("scene", "patch", "seed", "exact", "pilot", "missed", "of loss")
"""V at the shares of exact and of a pilot's parabolas over V at 1/2, the share of patches whose pilot has missed bright
samples, and of the loss that is in these."""
ENDS = [0, HALF, len(GRID) - 1]
MISSED = 0.1
"""A pilot has missed a technique's bright samples if it reports less than this share of the technique's variance."""
SHARES = "thesis-shares"
"""Preset of the rule whose w is a share of samples."""


def measure(scene: dmis.Scene, oracle: Oracle, size: int, seeds: range, threads: int | None) -> Iterator[list[object]]:
    """Yield the row of each pilot: what the rule's weights, of patches of a size, do to the error.

    The loss is V(w) - V(1/2) where that is above 0, before the filter.
    """
    height, width = oracle.shape
    area = patch_sum(np.ones((height, width)), oracle.patch)
    half = (area * oracle.variance[HALF]).sum()
    blocks = size // oracle.patch
    exact = patch_sum(area * oracle.variance, blocks) / patch_sum(area, blocks)  # (G, rows, columns) of patches
    best, _ = parabola_minimum(GRID[ENDS], exact[ENDS])
    with_exact = (area * oracle.at(patch_spread(best, size, (height, width)))).sum() / half
    for seed in seeds:
        result = dmis.render(scene, f"thesis:patch={size}", 8, seed=seed, preset=SHARES, parallel=threads)
        raw = patch_spread(result.maps["raw"], size, (height, width))
        missed = (result.maps["variances"] < MISSED * exact[ENDS]).any(axis=0)
        loss = area * np.maximum(oracle.at(raw) - oracle.variance[HALF], 0)
        lost = (loss * patch_spread(missed, blocks, loss.shape)).sum() / loss.sum()
        ratio = (area * oracle.at(result.weight)).sum() / half
        numbers = with_exact, ratio, missed.mean(), lost
        yield [f"{scene.name} {width}×{height}", size, seed, *(f"{x:.5g}" for x in numbers)]


def tables() -> dict[str, list[str]]:
    """Return the lines of the block: means over pilots."""
    cases: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in read_rows(CSV):
        cases.setdefault((row["scene"], row["patch"]), []).append(row)
    lines = []
    for (scene, patch), rows in cases.items():
        exact, pilot, missed, lost = (np.mean([float(row[field]) for row in rows]) for field in FIELDS[3:])
        lines.append([scene, patch, f"{exact:.2f}", f"{pilot:.2f}", f"{missed:.0%}", f"{lost:.0%}"])
    head = ["scene", "patch", "exact parabola", "pilot, 5×5 filter", "patches that missed", "of the loss"]
    return {"thesis.md: parabola": markdown(head, lines)}


def main() -> None:
    """Measure, one scene after the other."""
    opts, given = options(
        __file__,
        "exact and estimated parabolas",
        seeds={"type": int, "default": 8, "help": "number of pilots (default 8)"},
        csv={"type": Path, "default": CSV, "help": "rows of results"},
    )
    rows: list[Mapping[str, object]] = [*read_rows(given.csv)]
    for name in SCENES:
        scene = opts.scene(name, opts.pick(32, 8))
        if any(str(row["scene"]).startswith(f"{scene.name} ") for row in rows):
            continue
        samples = opts.pick(16, 512)
        oracle = make_oracle(scene, samples, progress=show(f"{name}: oracle"), preset=SHARES, parallel=opts.threads)
        for size in opts.pick((4,), (4, 8, 16)):
            cells = measure(scene, oracle, size, range(given.seeds), opts.threads)
            rows += [dict(zip(FIELDS, row, strict=True)) for row in cells]
        write_rows(given.csv, rows, FIELDS)
        print(scene.name, flush=True)


if __name__ == "__main__":
    main()
