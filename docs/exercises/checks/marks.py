"""Marks of a folder of hand-ins: which exercise and whose each file is, its check, a table and a CSV file."""

from __future__ import annotations

import csv
import os
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path

from apart import Limits, check_file
from dmis.testing.outcome import Outcome, line

CHECKS = (4, 4, 10, 4, 4, 7, 5, 6, 6, 5, 9, 2, 6, 18, 5, 5, 6, 6, 3, 6, 4, 4, 4, 4)
"""Number of checks of each exercise; a check that ends early has fewer outcomes."""
STARTERS = (0, 0, 2, 2, 0, 6, 4, 2, 4, 3, 2, 0, 0, 15, 2, 0, 3, 1, 1, 5, 2, 2, 3, 2)
"""Number of checks that the starter of each exercise passes: marks are for those beyond them."""


@dataclass(frozen=True)
class Mark:
    """The verdict on one file; `first_failure` is empty if it passed, and also says why a file could not be checked."""

    student: str
    exercise: int
    file: str
    passed: int
    total: int
    first_failure: str


def owner(file: Path, folder: Path) -> tuple[str, int]:
    """Return the student and the number of the exercise of a hand-in; 0 if the name has none.

    The number is the first one in the file's name. The student is the folder that the file is in, as in
    ``anna/03_direct_light.py``; or else what the name has beside the number, as in ``anna_03.py`` and ``3-anna.py``.
    """
    numbers = re.findall(r"\d+", file.stem)
    number = int(numbers[0]) if numbers and 1 <= int(numbers[0]) <= len(CHECKS) else 0
    inside = file.relative_to(folder).parts[:-1]
    rest = re.sub(r"\d+", "", file.stem, count=1).strip("_- .") if number else file.stem
    return ("/".join(inside) or rest or "?"), number


def hand_ins(folder: Path) -> list[Path]:
    """Return the Python files of a folder and its subfolders; those that begin with ``_`` or ``.`` are left out."""
    files = sorted(folder.rglob("*.py"))
    return [file for file in files if not any(part[0] in "_." for part in file.relative_to(folder).parts)]


def mark(file: Path, folder: Path, seed: int, limits: Limits) -> Mark:
    """Return the verdict on a file."""
    student, number = owner(file, folder)
    blank = Mark(student, number, str(file.relative_to(folder)), 0, marks_of(number) if number else 0, "")
    if not number:
        what = f"the name must have the number of an exercise, 1 to {len(CHECKS)}, such as {student}_03.py"
        return replace(blank, first_failure=what)
    try:
        outcomes = check_file(number, file, seed, limits)
    except (OSError, ValueError) as error:
        return replace(blank, first_failure=str(error))
    failed = [outcome for outcome in outcomes if not outcome.passed]
    why = line(failed[0]).removeprefix("FAILED").strip() if failed else ""
    return replace(blank, passed=points(number, outcomes), first_failure=why)


def points(number: int, outcomes: Sequence[Outcome]) -> int:
    """Return how many more checks passed than with the starter of exercise `number`; `marks_of` only if none failed."""
    passed = sum(outcome.passed for outcome in outcomes)
    if passed == len(outcomes):
        return marks_of(number)
    return max(0, min(passed - STARTERS[number - 1], marks_of(number) - 1))


def marks_of(number: int) -> int:
    """Return the marks of a right solution of an exercise."""
    return CHECKS[number - 1] - STARTERS[number - 1]


def mark_folder(folder: Path, seed: int, limits: Limits) -> list[Mark]:
    """Return the verdicts on all hand-ins of a folder, as many at a time as there are processors.

    A ValueError if there is no such folder, or no Python file in it.
    """
    files = hand_ins(folder) if folder.is_dir() else []
    if not files:
        raise ValueError(f"--folder must be a folder of Python files; got {folder}, which has none")
    marks = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for done, verdict in enumerate(pool.map(lambda file: mark(file, folder, seed, limits), files), 1):
            marks.append(verdict)
            if sys.stderr.isatty():
                print(f"\r{done} of {len(files)} hand-ins", end="" if done < len(files) else "\n", file=sys.stderr)
    return sorted(marks, key=lambda one: (one.student, one.exercise, one.file))


def write_csv(marks: Iterable[Mark], file: Path) -> None:
    """Write a line for each mark, with a head. Texts that a spreadsheet would take for a formula get a ``'``."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(field.name for field in fields(Mark))
        for one in marks:
            values = (f"'{value}" if str(value).startswith(("=", "+", "-", "@")) else value for value in astuple(one))
            writer.writerow(values)


def table(marks: Sequence[Mark]) -> str:
    """Return a table of students and exercises, each cell passed/total of the best hand-in."""
    cells: dict[str, dict[int, Mark]] = defaultdict(dict)
    for one in marks:
        best = cells[one.student].get(one.exercise)
        if best is None or one.passed > best.passed:
            cells[one.student][one.exercise] = one
    numbers = sorted({one.exercise for one in marks})
    wide = max(len("student"), *map(len, cells))
    lines = [f"{'student':{wide}}" + "".join(f"{number or '?':>7}" for number in numbers)]
    for student, row in cells.items():
        shown = (f"{row[n].passed}/{row[n].total}" if n in row else "-" for n in numbers)
        lines.append(f"{student:{wide}}" + "".join(f"{text:>7}" for text in shown))
    return "\n".join(lines)
