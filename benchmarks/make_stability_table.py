"""
The tables of docs/stability.md
===============================

Where along each axis of stiffness the mean is right, how many digits are left elsewhere, and what is refused; and by
how much the images of the scenes that come with dmis differ between float32 and float64. A few minutes; rows go to
docs/tables/stability.csv.
"""

import sys
from itertools import groupby
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, options
from rows import markdown, read_rows, write_rows
from stiff import ULP, Found, beside_ball, both, chosen, measure, rounding_errors

CSV = ROOT / "docs" / "tables" / "stability.csv"
FIELDS = ("table", "name", "value", "other", "error", "rms", "largest")
"""Of ``map`` the relative error of a case by its axis and values, that of ``balance`` or of ``auto``, whichever is
larger, empty where dmis refuses the case; of ``ground`` what the ground of a size reflects over the truth, less 1, and
the standard error; of ``scenes`` float32 less float64: mean, root mean square, largest."""
HELD = 1e-3
"""Relative error up to which a mean has three correct digits."""
KINDS = ("held", "refused", "lost")
"""What becomes of a case: three correct digits at least, a message instead of an image, or fewer digits."""


def verdict(error: float) -> str:
    """Return what becomes of a case with a relative error, NaN if dmis refuses it: one of `KINDS`."""
    return "refused" if np.isnan(error) else "held" if error <= HELD else "lost"


def span(values: list[float]) -> str:
    """Return the first and the last value."""
    ends = f"{values[0]:g}", f"{values[-1]:g}"
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"


def axis_row(axis: str, cases: list[tuple[float, float]], two: bool) -> list[str]:
    """Return the cells of an axis, from values and errors in order: ranges of values by what becomes of the mean."""
    cells: dict[str, list[str]] = {kind: [] for kind in KINDS}
    for kind, group in groupby(cases, lambda case: verdict(case[1])):
        members = list(group)
        values = f"{len(members)} cases" if two else span([value for value, _ in members])
        digits = [max(0.0, np.floor(-10 * np.log10(error)) / 10) for _, error in members]
        if kind == "lost":
            cells[kind] += [f"{value:g}: {left:.1f}" for (value, _), left in zip(members, digits, strict=True)]
        else:
            cells[kind].append(f"{values} ({min(digits):.1f} digits or more)" if kind == "held" else values)
    return [axis, *(", ".join(of_kind) or "–" for of_kind in cells.values())]


def stiff_map(rows: list[dict[str, str]]) -> list[str]:
    """Return the table of the axes; cases of two values are ordered by what becomes of them."""
    lines = []
    for axis, group in groupby(sorted(rows, key=lambda row: row["name"]), lambda row: row["name"]):
        members = list(group)
        two = bool(members[0]["other"])
        cases = [(float(row["value"]), float(row["error"] or "nan")) for row in members]
        cases.sort(key=lambda case: (verdict(case[1]), case[0]) if two else ("", case[0]))
        lines.append(axis_row(axis, cases, two))
    return markdown(["axis", "held, to at least 3 digits", "refused", "lost: digits that are left"], lines)


def excess(found: Found) -> float:
    """Return by how much more than four standard errors a mean is off; not less than an ulp."""
    return max(abs(found.mean - 1) - 4 * max(found.error, np.sqrt(10) / found.samples), ULP)


def rows_of(table: str) -> list[dict[str, str]]:
    """Return the rows of a table of `FIELDS`."""
    return [row for row in read_rows(CSV) if row["table"] == table]


def tables() -> dict[str, list[str]]:
    """Return the lines of the blocks."""
    scenes = [
        [row["name"], f"{float(row['error']):+.1e}", f"{float(row['rms']):.1e}", f"{float(row['largest']):.1e}"]
        for row in rows_of("scenes")
    ]
    return {
        "stability.md: map": stiff_map(rows_of("map")),
        "stability.md: scenes": markdown(
            ["scene", "mean of the image", "relative RMS over pixels", "largest, of the brightest pixel"], scenes
        ),
    }


def sentences() -> dict[str, list[str]]:
    """Return fragments of prose with numbers."""
    worst = max(rows_of("ground"), key=lambda row: abs(float(row["error"])))
    return {"stability.md": [f"within {abs(float(worst['error'])):.4f} ± {float(worst['rms']):.4f}"]}


def main() -> None:
    """Measure."""
    opts, given = options(
        __file__,
        "stiff scenes with known answers, in float32 and in float64",
        csv={"type": Path, "default": CSV, "help": "rows of results"},
    )
    every, size = opts.pick(9, 1), opts.pick((24, 16), (200, 133))
    single, double = both(opts.pick(16, 256), every, size)
    rows: list[dict[str, object]] = []
    for case, error in zip(chosen(every), rounding_errors(single["family"], double["family"]), strict=True):
        about = {"name": case.axis, "value": f"{case.value:.10g}"}
        other = "" if case.other is None else f"{case.other:.10g}"
        of_auto = measure(case, "auto", opts.pick(16, 1024))
        both_rules = "" if of_auto.refused else f"{min(max(error, excess(of_auto)), 1):.6g}"
        rows.append({"table": "map", **about, "other": other, "error": both_rules})
    for power in range(8):  # many samples: it is the mean that says whether the shadow is there
        found = measure(beside_ball("ground", 10.0**power), "balance", opts.pick(16, 8192), seed=2)
        rows.append({"table": "ground", "name": power, "error": f"{found.mean - 1:.6g}", "rms": f"{found.error:.6g}"})
    for name, image in single.items():  # the same samples in float32 and in float64
        if name != "family":
            exact = double[name].astype(np.float64)
            numbers = {
                "error": image.mean(dtype=float) / exact.mean() - 1,
                "rms": np.sqrt(np.mean((image - exact) ** 2)) / exact.mean(),
                "largest": np.abs(image - exact).max() / exact.max(),
            }
            title = f"{name} {size[0]}×{size[1]}"
            rows.append({"table": "scenes", "name": title} | {key: f"{value:.4g}" for key, value in numbers.items()})
    write_rows(given.csv, rows, FIELDS)


if __name__ == "__main__":
    main()
