"""
The ladder of bounds: a table of docs/measurements.md
==============================================

How small the error could be in equal time with one freedom of the estimator after another, on the four scenes, as
``print_ladder.py SCENE --compensation 0`` prints it for one. The first rung is the balance heuristic,
so skies are sampled without compensation. Takes ten minutes; the result is kept with the project.
"""

import sys
from datetime import date
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, TABLES, machine, options, replace_table, show
from evenness import EVEN_SEEDS, EVEN_SPP, measure_evenness
from ladder import RUNGS, halved_oracle, make_ladder

import dmis

PAGE = ROOT / "docs" / "measurements.md"

opts, given = options(
    __file__,
    "bounds of the error in equal time on the four scenes",
    page={"type": Path, "default": PAGE, "help": "the page whose table is replaced"},
)
SPP = opts.pick(64, 2048)
PLAIN = dmis.Settings(compensation=0)

# %%
# The oracle is rendered once and kept; the ladder follows from it, but for the renders with Sobol points.
ladders = {}
for name, shrink in TABLES.items():
    scene = opts.scene(name, shrink * opts.pick(4, 1))
    oracle = halved_oracle(scene, SPP, settings=PLAIN, parallel=opts.threads, progress=show(f"{name}: oracle"))
    progress = show(f"{name}: Sobol points")
    evenness = measure_evenness(scene, oracle, settings=PLAIN, parallel=opts.threads, progress=progress)
    ladder = make_ladder(oracle, evenness)
    assert ladder is not None, f"{name} has no noise"
    ladders["{} {}×{}".format(scene.name, *scene.camera.resolution)] = ladder
    print(scene.name, ladder.text(), sep="\n", flush=True)

# %%
# Rungs by scenes, and below what they follow from.
lines = ["| bound | what may be chosen | " + " | ".join(ladders) + " |", "|---|---|" + "---|" * len(ladders)]
for name, meaning in RUNGS.items():
    values = [ladder.rung_text(name) for ladder in ladders.values()]
    lines.append(f"| {name} | {meaning} | {' | '.join(values)} |")
for title, values in {
    "P / V at w = 1/2": [f"{ladder.position:.2f}" for ladder in ladders.values()],
    f"`balance` with Sobol points, {EVEN_SPP} samples": [f"{ladder.evenness.ratio:.2g}" for ladder in ladders.values()],
    "its exponent a, error ~ n^-a": [f"{ladder.evenness.exponent:.2f}" for ladder in ladders.values()],
}.items():
    lines.append(f"| | {title} | {' | '.join(values)} |")
difference = max(
    abs(1 - ladder.flattered[name] / ladder.rungs[name])
    for ladder in ladders.values()
    for name in RUNGS
    if name not in ("B6", "B7")
)
about = (
    f"Made on {date.today()} with {SPP} samples per pixel and, with Sobol points, {EVEN_SEEDS} renders each of "
    f"{EVEN_SPP // 4} and {EVEN_SPP}, on {machine()}.",
    f"Chosen and evaluated on the same samples, B0 to B3 are within {difference:.0%} of these.",
)
replace_table(given.page, "ladder", *about, "", *lines)
