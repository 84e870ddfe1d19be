"""
The tables of docs/stability.md
===============================

Where along each axis of stiffness the mean is right, how many digits are left elsewhere, and what is refused; and by
how much the images of the scenes that come with dmis differ between float32 and float64. A few minutes.
"""

import sys
from datetime import date
from itertools import groupby
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, options, replace_table
from stiff import Case, beside_ball, both, chosen, measure, rounding_errors

PAGE = ROOT / "docs" / "stability.md"
PASS, LOST = 1e-3, 0.5
"""Relative errors up to which a mean passes, and from which on nothing is left of it."""

opts, given = options(
    __file__,
    "stiff scenes with known answers, in float32 and in float64",
    page={"type": Path, "default": PAGE, "help": "the page whose tables are replaced"},
)
every, size = opts.pick(9, 1), opts.pick((24, 16), (200, 133))
cases = chosen(every)
single, double = both(opts.pick(16, 256), every, size)
errors = rounding_errors(single["family"], double["family"])


# %%
# One row per axis: ranges of values in order, each with what becomes of the mean there.
def verdict(error: float) -> str:
    """Pass, degraded or lost."""
    return "pass" if error <= PASS else "lost" if error >= LOST else "degraded"


def span(values: list[float]) -> str:
    """First and last value."""
    ends = f"{values[0]:g}", f"{values[-1]:g}"
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"


def row(axis: str, of: list[tuple[Case, float]]) -> str:
    """All cases of an axis."""
    cells: dict[str, list[str]] = {"pass": [], "degraded": [], "lost": []}
    two = of[0][0].other is not None
    for kind, group in groupby(of, lambda pair: verdict(pair[1])):
        members = list(group)
        worst = max(error for _, error in members)
        values = [f"{len(members)} cases"] if two else [span([case.value for case, _ in members])]
        if kind == "pass":
            cells[kind].append(f"{values[0]} ({-np.log10(worst):.1f} digits or more)")
        elif kind == "degraded":
            cells[kind] += [f"{case.value:g}: {-np.log10(error):.1f}" for case, error in members]
        else:
            cells[kind] += values
    return f"| {axis} | {'; '.join(cells['pass']) or '–'} | {', '.join(cells['degraded']) or '–'} | " + (
        f"{'; '.join(cells['lost']) or '–'} |"
    )


lines = ["| axis | pass, to at least 3 digits | degraded: digits that are left | lost |", "|---|---|---|---|"]
paired = sorted(zip(cases, errors), key=lambda pair: pair[0].axis)
for axis, group in groupby(paired, lambda pair: pair[0].axis):
    of = list(group)
    of.sort(key=lambda pair: (pair[1] > PASS, pair[0].value) if pair[0].other is not None else (False, pair[0].value))
    lines.append(row(axis, of))
about = f"Made on {date.today()} with {int(single['family'][0, 2]):,} camera samples of the balance heuristic per case."
replace_table(given.page, "map", about, "", *lines)

# %%
# A sphere on grounds of all sizes: more samples, because it is the mean that says whether the shadow is there.
lines = ["| ground | radiance over the truth, less 1 | standard error |", "|---|---|---|"]
for power in range(8):
    found = measure(beside_ball("ground", 10.0**power), "balance", opts.pick(16, 8192), seed=2)
    lines.append(f"| ±10{'⁰¹²³⁴⁵⁶⁷'[power]} | {found.mean - 1:+.4f} | {found.error:.4f} |")
replace_table(given.page, "ground", *lines)

# %%
# The scenes that come with dmis: the same samples in float32 and in float64.
lines = [
    "| scene | mean of the image | relative RMS over pixels | largest, of the brightest pixel |",
    "|---|---|---|---|",
]
for name, image in single.items():
    if name != "family":
        exact = double[name].astype(np.float64)
        rms, most = np.sqrt(np.mean((image - exact) ** 2)) / exact.mean(), np.abs(image - exact).max() / exact.max()
        mean = image.mean(dtype=float) / exact.mean() - 1
        lines.append(f"| {name} {size[0]}×{size[1]} | {mean:+.1e} | {rms:.1e} | {most:.1e} |")
replace_table(given.page, "scenes", "float32 less float64, 16 camera samples per pixel.", "", *lines)
