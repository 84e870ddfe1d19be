"""
The ladder of bounds: a table of docs/measurements.md
==============================================

How small the error could be in equal time with one freedom of the estimator after another, on the four scenes, as
``ladder.py SCENE`` prints it for one. The first rung is the balance heuristic,
so skies are sampled without compensation. Takes ten minutes; rows go to docs/tables/ladder.csv.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, TABLES, options, show
from ladder import EVEN_SPP, INTERVAL, RUNGS, halved_oracle, make_ladder, measure_evenness, rung_text
from pieces import FOUR
from rows import markdown, read_rows, write_rows

import dmis

CSV = ROOT / "docs" / "tables" / "ladder.csv"
FIELDS = ("scene", "rung", "value", "standard error", "same samples")
POSITION, RATIO, EXPONENT = "P / V at w = 1/2", f"`balance` with Sobol points, {EVEN_SPP} samples", "a, error ~ n^-a"
"""Rows of what the rungs follow from."""


def tables() -> dict[str, list[str]]:
    """Return the lines of the block: rungs by scenes, and below what they follow from."""
    rows = read_rows(CSV)
    scenes = sorted({row["scene"]: None for row in rows}, key=lambda scene: FOUR.index(scene.split()[0]))
    cells = {(row["scene"], row["rung"]): row for row in rows}
    lines = []
    for name, meaning in RUNGS.items():
        values = [cells[scene, name] for scene in scenes]
        texts = [rung_text(float(row["value"]), INTERVAL * float(row["standard error"])) for row in values]
        lines.append([name, meaning, *texts])
    for name, digits in ((POSITION, ".2f"), (RATIO, ".2g"), (EXPONENT, ".2f")):
        lines.append(["", name, *(format(float(cells[scene, name]["value"]), digits) for scene in scenes)])
    return {"measurements.md: ladder": markdown(["bound", "what may be chosen", *scenes], lines)}


def main() -> None:
    """Measure; the oracle is rendered once and kept."""
    opts, given = options(
        __file__,
        "bounds of the error in equal time on the four scenes",
        csv={"type": Path, "default": CSV, "help": "rows of results"},
    )
    plain = dmis.Settings(compensation=0)
    rows = read_rows(given.csv)
    for name, shrink in TABLES.items():
        scene = opts.scene(name, shrink * opts.pick(4, 1))
        title = "{} {}×{}".format(name, *scene.camera.resolution)
        if any(row["scene"] == title for row in rows):
            continue
        about = {"settings": plain, "parallel": opts.threads}
        oracle = halved_oracle(scene, opts.pick(64, 2048), progress=show(f"{name}: oracle"), **about)
        evenness = measure_evenness(scene, oracle, progress=show(f"{name}: Sobol points"), **about)
        ladder = make_ladder(oracle, evenness)
        assert ladder is not None, f"{name} has no noise"
        print(title, ladder.text(), sep="\n", flush=True)
        values = {rung: (ladder.rungs[rung], ladder.standard_errors[rung], ladder.flattered[rung]) for rung in RUNGS}
        values |= {POSITION: (ladder.position, 0, 0), RATIO: (evenness.ratio, 0, 0)}
        values |= {EXPONENT: (evenness.exponent, 0, 0)}
        numbers = {rung: [f"{value:.6g}" for value in of_rung] for rung, of_rung in values.items()}
        rows += [dict(zip(FIELDS, (title, rung, *of_rung), strict=True)) for rung, of_rung in numbers.items()]
        write_rows(given.csv, rows, FIELDS)


if __name__ == "__main__":
    main()
