"""
The table of README: what the rule auto saves
=============================================

The table is put together from tables that are on other pages, so nothing is rendered: the error of `auto` in equal time
over that of the balance heuristic with independent points (docs/measurements.md) and with Sobol points
(docs/tables.md), and over that of Mitsuba's best sampler (docs/performance.md): by relMSE and by MSE, if these tables
have a column for each, such as "128 spp, relMSE". The scripts that measure those tables write this one, too.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, replace_table

DOCS = ROOT / "docs"
STEPS = DOCS / "measurements.md"
POINTS = DOCS / "tables.md"
MITSUBA = DOCS / "performance.md"
MEASURES = ("relMSE", "MSE")
COLUMNS = ("balance, independent points", "balance, Sobol points", "Mitsuba's best sampler")


def read_rows(page: Path, mark: str) -> list[dict[str, str]]:
    """Return the rows of the table between the marks of a page, cells by the titles of their columns."""
    _, _, rest = page.read_text("utf-8").partition(f"<!-- {mark}: begin -->")
    block, end, _ = rest.partition(f"<!-- {mark}: end -->")
    if not end:
        raise ValueError(f"{page} must have a table between <!-- {mark}: begin --> and <!-- {mark}: end -->")
    lines = [line for line in block.split("\n") if line.startswith("|")]
    titles, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(titles, row, strict=True)) for row in rows]


def number(cell: str) -> float:
    """Return the ratio of a cell such as ``**0.5 ± 0.1**``; 0 of a dash."""
    return float(cell.strip("*").split()[0].replace("–", "0"))


def cell(row: dict[str, str], title: str, measure: str) -> str:
    """Return the ratio by a measure in the columns `title`, which alone is of MSE; a dash if there is none."""
    return row.get(f"{title}, {measure}", row.get(title, "–") if measure == "MSE" else "–")


def front_rows(steps: Path = STEPS, points: Path = POINTS, mitsuba: Path = MITSUBA) -> list[str]:
    """Return the lines of the table; a ratio that was not measured is a dash.

    Of the lines that the table of Mitsuba has for a scene that with the largest ratio is taken: its best set-up of all.
    """
    over_independent = {row["scene"]: row for row in read_rows(steps, "steps")}
    over_sobol = {row["scene"]: row for row in read_rows(points, "points") if row["rule"] == "auto"}
    over_mitsuba = read_rows(mitsuba, "mitsuba-errors")
    measures = [
        name for name in MEASURES if any(cell(row, "all three", name) != "–" for row in over_independent.values())
    ]
    titles = [f"{column}, {name}" if len(measures) > 1 else column for column in COLUMNS for name in measures]
    lines = [f"| scene | {' | '.join(titles)} |", "|---" * (1 + len(titles)) + "|"]
    for scene, row in over_independent.items():
        cells = [cell(row, "all three", name) for name in measures]
        cells += [cell(over_sobol[scene], "128 spp", name) for name in measures]
        best = [line for line in over_mitsuba if line["scene"] == scene.split()[0]]
        cells += [max((cell(line, "`auto`, sobol", m) for line in best), key=number, default="–") for m in measures]
        lines.append(f"| {scene} | {' | '.join(cells)} |")
    return lines


def write_front_table(page: Path = ROOT / "README.md") -> None:
    """Put the table between the marks 'equal time' of README."""
    replace_table(page, "equal time", *front_rows())


if __name__ == "__main__":
    write_front_table()
