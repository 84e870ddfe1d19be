"""Table of docs/tables.md from the rows of agreement.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rows import markdown, read_rows

CSV = Path(__file__).resolve().parents[1] / "docs" / "tables" / "mitsuba-agreement.csv"
FIELDS = ("scene", "surfaces", "light", "seeds", "mean", "s.e.", "l2", "noise", "z")
"""Relative difference of the means over the image and its standard error, of the means of blocks and that of noise, and
root mean square of z over blocks."""


def tables() -> dict[str, list[str]]:
    """Return the lines of the block."""
    rows = []
    for row in read_rows(CSV):
        mean, error, l2, noise = (100 * float(row[field]) for field in ("mean", "s.e.", "l2", "noise"))
        freedom = 2 * (int(row["seeds"]) - 1)
        expected = f" ({np.sqrt(freedom / (freedom - 2)):.2f})" if freedom > 2 else ""
        cells = f"{mean:+.3f} ± {error:.3f} %", f"{l2:.2f} ({noise:.2f}) %", f"{float(row['z']):.2f}{expected}"
        rows.append([row["scene"], row["surfaces"], row["light"], *cells])
    head = [
        "scene",
        "surfaces",
        "light",
        "mean, dmis / Mitsuba - 1",
        "blocks, relative L2 (noise)",
        "r.m.s. z (of noise)",
    ]
    return {"tables.md: mitsuba-agreement": markdown(head, rows)}


def sentences() -> dict[str, list[str]]:
    """Return fragments of prose with numbers, by page."""
    rows = read_rows(CSV)
    largest = max(rows, key=lambda row: abs(float(row["mean"])))
    mean, error = (100 * abs(float(largest[field])) for field in ("mean", "s.e."))
    z = [float(row["z"]) for row in rows]
    return {
        "performance.md": [
            f"In [{len(rows)} set-ups]",
            f"differ by at most {mean:.3f} ± {error:.3f} %",
            f"these differences have a root mean square of {min(z):.2f} to {max(z):.2f}",
        ]
    }
