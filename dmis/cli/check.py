"""The command ``check``: a user's own lobes, lights, techniques and rules."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from dmis.base.atomic_files import check_folder
from dmis.base.plugins import load_plugin
from dmis.testing.exercises import check_exercise
from dmis.testing.find import RECOGNISED, find
from dmis.testing.outcome import Outcome, attempt
from dmis.testing.report import line, summary, write_figures


def check(options: argparse.Namespace) -> int:
    """Run ``check`` and return its exit code: 1 if a check failed."""
    file = Path(options.file)
    folder = file.parent if options.output is None else options.output
    if options.output is not None:
        check_folder(folder)
    if not file.is_file():
        raise FileNotFoundError(f"no such file: {file}; check needs a Python file with the code to check")
    load_plugin(file)
    module = sys.modules[file.stem]
    outcomes: list[Outcome] = []
    if options.exercise is not None:
        outcomes = check_exercise(options.exercise, module)
        _print(outcomes)
    else:
        subjects, skipped = find(module)
        for other in skipped:
            print(f"dmis: {other.name} is not checked: {other.reason}", file=sys.stderr)
        if skipped and not subjects:
            raise ValueError(f"nothing in {file} can be checked as it stands; the lines above say how to change that")
        if not subjects:
            raise ValueError(
                f"{file} must define something to check; it has nothing of: {RECOGNISED}. "
                "For the solution of an exercise, add --exercise N"
            )
        for subject in subjects:
            print(f"{subject.kind} {subject.name}", flush=True)
            found = attempt(subject.name, subject.check)
            _print(found)
            outcomes += found
    print(summary(outcomes))
    if all(outcome.passed for outcome in outcomes):
        return 0
    try:
        for path in write_figures(outcomes, folder, file.stem):
            print(path)
    except ImportError as error:
        print(f"dmis: pictures of what failed are left out ({error})", file=sys.stderr)
    return 1


def _print(outcomes: list[Outcome]) -> None:
    for outcome in outcomes:
        print(line(outcome), flush=True)
