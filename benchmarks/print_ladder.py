"""Print and plot the ladder of bounds of a scene: the least error in equal time with one freedom after another.

    python benchmarks/print_ladder.py tt --resolution 300x167 --compensation 0 -o tt-oracle

See `ladder`; `make_ladder_table.py` makes the table of docs/measurements.md.
"""

import argparse
from pathlib import Path

import numpy as np
from evenness import measure_evenness
from ladder import RUNGS, Ladder, halved_oracle, make_ladder

import dmis
from dmis import plot
from dmis.cli.arguments import RESOLUTION

MIN_BAR = 1e-4
"""Least end of a bar; rungs may be smaller, and estimates of them below 0."""


def write_ladder(ladder: Ladder, path: Path, scene: str) -> None:
    """Write the rungs as bars on a log scale, with their meanings as the caption, to a PNG file."""
    figure, axes = plot.canvas(1, 1, 8, 3.6)
    axis, ends = axes[0, 0], np.maximum(list(ladder.rungs.values()), MIN_BAR)
    axis.barh(list(ladder.rungs), 1 - ends, left=ends, color="#2b8cd6", alpha=0.35, height=0.7)
    for row, name in enumerate(ladder.rungs):
        axis.text(ends[row] / 1.05, row, ladder.rung_text(name), va="center", ha="right", fontsize=8)
    axis.set_xscale("log")
    axis.set_xlim(ends.min() / 20, 2)
    axis.invert_yaxis()
    axis.grid(alpha=0.25, axis="x", linewidth=0.5)
    axis.set_xlabel("error in equal time, over independent samples of the balance heuristic")
    plot.round_ticks(axis.xaxis)
    meanings = "; ".join(f"{name}: {RUNGS[name]}" for name in ladder.rungs)
    plot.save(figure, path, f"{scene}: ladder of bounds", f"{meanings}. Bars end at the least error that is possible.")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("scene")
    parser.add_argument("--resolution", type=RESOLUTION, metavar="WxH")
    parser.add_argument("--spp", type=int, default=2048, help="camera samples per pixel, a multiple of 4 (2048)")
    parser.add_argument("--compensation", type=float, metavar="SHARE")
    parser.add_argument("--threads", type=int)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    given = parser.parse_args()
    scene, settings = dmis.load_scene(given.scene, given.resolution), dmis.Settings(compensation=given.compensation)
    oracle = halved_oracle(scene, given.spp, settings=settings, parallel=given.threads)
    ladder = make_ladder(oracle, measure_evenness(scene, oracle, settings=settings, parallel=given.threads))
    if ladder is None:
        raise SystemExit(f"a ladder needs noise; every sample of scene {scene.name!r} is the same")
    print(ladder.text())
    given.output.mkdir(parents=True, exist_ok=True)
    write_ladder(ladder, given.output / "ladder.png", scene.name)
