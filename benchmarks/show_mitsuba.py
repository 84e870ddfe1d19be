"""Tables of docs/performance.md and docs/paths.md from the rows of against_mitsuba.py, without Mitsuba."""

from __future__ import annotations

import numpy as np
from common import ROOT, bold
from rows import markdown, read_rows

TABLES = ROOT / "docs" / "tables"
SPEED, ERRORS, PATHS = (TABLES / f"mitsuba-{kind}.csv" for kind in ("speed", "errors", "paths"))
SPEED_FIELDS = ("scene", "contestant", "seed", "wall rate", "CPU rate")
"""Columns of `SPEED`; rates are millions of camera samples per second."""
ERROR_FIELDS = ("scene", "seeds", "spp", "set-up", "its spp", "compared", "measure", "ratio", "half", "noise")
"""Columns of `ERRORS` and `PATHS`: error times CPU seconds of what is compared over that of a set-up of Mitsuba, or of
that set-up over Mitsuba's default; `half` is half of the 95 % interval, `noise` the share of the reference's noise in
the smallest error of the scene."""
DEFAULT = "over its default"
COMPARED = {DEFAULT: "over its default", "balance": "`balance`"}
NAMES = {"relmse": "relMSE", "mse": "MSE"}


def best(rows: list[dict[str, str]], scene: str, measure: str) -> dict[str, str] | None:
    """Return the row of Mitsuba's best set-up of all: that with the largest ratio; None if there is none."""
    of_scene = [r for r in rows if (r["scene"], r["compared"], r["measure"]) == (scene, "balance", measure)]
    return max(of_scene, key=lambda row: float(row["ratio"]), default=None)


def cell(row: dict[str, str]) -> str:
    """Return a ratio with its interval."""
    return bold(float(row["ratio"]), float(row["half"]))


def errors(rows: list[dict[str, str]]) -> list[str]:
    """Return a table with a line for each set-up that is best for its scene, with lights picked in one of the ways."""
    lines = []
    for scene, setup in dict.fromkeys((row["scene"], row["set-up"]) for row in rows):
        own = {(r["compared"], r["measure"]): r for r in rows if (r["scene"], r["set-up"]) == (scene, setup)}
        first = next(iter(own.values()))
        cells = [cell(own[rule, measure]) for rule in COMPARED for measure in NAMES]
        lines.append([scene, f"{setup}, {first['its spp']} spp", *cells])
    head = [f"{title}, {error}" for title in COMPARED.values() for error in NAMES.values()]
    return markdown(["scene", "Mitsuba's set-up", *head], lines)


def noise(rows: list[dict[str, str]]) -> str:
    """Return a sentence on the references."""
    shares = {row["scene"]: float(row["noise"]) for row in rows}
    texts = [f"{100 * share:.3g} % on {scene}{' (**too noisy**)' * (share > 0.05)}" for scene, share in shares.items()]
    return f"A reference's noise should be at most 5 % of the smallest error on its scene. It is {', '.join(texts)}."


def speeds() -> list[str]:
    """Return the table of speeds: medians over seeds, wall (CPU) time."""
    rows = read_rows(SPEED)
    rates: dict[str, dict[str, np.ndarray]] = {}
    for scene, contestant in dict.fromkeys((row["scene"], row["contestant"]) for row in rows):
        own = [r for r in rows if (r["scene"], r["contestant"]) == (scene, contestant)]
        values = np.array([(float(r["wall rate"]), float(r["CPU rate"])) for r in own])
        rates.setdefault(scene, {})[contestant] = values
    lines = []
    for scene, of_scene in rates.items():
        medians = [np.median(values, axis=0) for values in of_scene.values()]
        medians += [np.median(of_scene["dmis"] / of_scene[name], axis=0) for name in ("LLVM", "own")]
        lines.append([scene, *(f"{wall:.2f} ({cpu:.2f})" for wall, cpu in medians)])
    return markdown(["scene", *next(iter(rates.values()), {}), "dmis / LLVM", "dmis / own"], lines)


def tables() -> dict[str, list[str]]:
    """Return the lines of the blocks that have rows."""
    blocks = {}
    if SPEED.exists():
        blocks["performance.md: mitsuba-speed"] = speeds()
    for path, name in ((ERRORS, "performance.md: mitsuba-errors"), (PATHS, "paths.md: mitsuba-paths")):
        if rows := read_rows(path):
            blocks[name] = [*errors(rows), "", noise(rows)]
    return blocks
