"""Run the demo with three seeds: rows of what it prints, its picture, and the numbers of README's caption.

python benchmarks/measure_demo.py
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from rows import read_rows, write_rows

ROOT = Path(__file__).resolve().parents[1]
CSV = ROOT / "docs" / "tables" / "demo.csv"
PICTURE = ROOT / "docs" / "images" / "demo.png"
COLUMNS = ("rule", "spp", "million rays", "seconds", "mse", "mse over balance", "relmse over balance")
SEEDS = (2, 3, 1)
"""The last one leaves the picture."""


def rows_of(printed: str) -> list[dict[str, str]]:
    """Return the rows of the table that the demo prints, without units and standard errors."""
    lines = [line for line in printed.split("\n") if line.startswith(("| balance", "| thesis", "| auto"))]
    cells = [[cell.split()[0] for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(COLUMNS, row, strict=True)) for row in cells]


def tables() -> dict[str, list[str]]:
    """Return no tables: README has the picture, and these numbers in its caption."""
    return {}


def sentences() -> dict[str, list[str]]:
    """Return fragments of prose with numbers."""

    def of(rule: str, column: str) -> list[str]:
        """Return the values of all seeds, in order of size."""
        return [f"{value:.2f}" for value in sorted(float(row[column]) for row in read_rows(CSV) if row["rule"] == rule)]

    measures = ("mse over balance", "relmse over balance")
    thesis, auto = ([of(rule, measure)[k] for measure in measures for k in (0, -1)] for rule in ("thesis", "auto"))
    shown = {row["rule"]: float(row["mse over balance"]) for row in read_rows(CSV) if row["seed"] == str(SEEDS[-1])}
    return {
        "README.md": [
            f"errors of the whole: 1, {shown['thesis']:.2f} and {shown['auto']:.2f}]",
            "rule has {} to {} times the MSE of the balance heuristic and {} to {} times its relMSE".format(*thesis),
            "`auto` has {} to {} times the MSE and {} to {} times the relMSE".format(*auto),
        ]
    }


def main() -> None:
    """Render, and write the rows and the picture."""
    rows = []
    for seed in SEEDS:
        command = [sys.executable, f"{ROOT}/examples/demo.py", "--seed", f"{seed}", "-o", f"{PICTURE}"]
        printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        rows += [{"seed": str(seed), **row} for row in rows_of(printed)]
    write_rows(CSV, rows, ("seed", *COLUMNS))


if __name__ == "__main__":
    main()
