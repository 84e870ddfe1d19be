"""Starter files whose task depends on a seed, so that the published solutions do not fit."""

from __future__ import annotations

from pathlib import Path

import grading

FOLDER = Path(__file__).resolve().parent.parent
CHANGES = {
    5: (("X = 2 pi u if", "X = 2 pi u^{e} if"),),
    7: (
        ("is cos t inside", "is cos^{e} t inside"),
        ("in proportion to cos t.", "in proportion to cos^{e} t."),
    ),
    20: (
        ("rim * rim)", "rim**{e})"),
        (" (cos / pi has 1.4, a uniform density 0.37).", "."),
    ),
}  # fmt: skip
"""Texts of starters, and what they become with an exponent e."""


def other_task(number: int, seed: int) -> str:
    """Return a sentence about the task of an exercise if a seed changes it; else an empty text."""
    if not seed or number not in grading.EXPONENTS:
        return ""
    return (
        f"With --seed {seed} exercise {number} has another task, which its published solution does not solve. "
        f"--starter {number} --seed {seed} prints its starter"
    )


def starter(number: int, seed: int) -> str:
    """Return the text of a starter; with a seed, that of exercises 5, 7 and 20 has another exponent."""
    (path,) = FOLDER.glob(f"{number:02}_*.py")
    text = path.read_text("utf-8")
    if not seed:
        return text
    grading.SEED = seed
    for before, after in CHANGES.get(number, ()):
        if before not in text:
            raise ValueError(f"{path} must have the text {before!r}, which the seed changes")
        text = text.replace(before, after.format(e=grading.exponent(number)))
    return text.replace(f"checks {number} mine_{number:02}.py", f"checks {number} mine_{number:02}.py --seed {seed}")
