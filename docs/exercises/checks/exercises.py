"""The checks of all exercises, one module for each tutorial, and the check of a file with a solution.

Tutorial t has the exercises 3t + 1 to 3t + 3. A starter file of each is in ``docs/exercises``, and a solution in
``docs/exercises/solutions``.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

from dmis.base.plugins import load_plugin
from dmis.testing.outcome import Outcome, line, summary
from grading import EXERCISES

for _name in ("one_batch", "monte_carlo", "sampling", "mis", "parabola", "pilot", "own"):
    import_module(f"check_{_name}")


def main(arguments: list[str] | None = None) -> int:
    """Check the file that the command line names; return 0 if all checks passed, 1 if one failed, 2 for a bad file."""
    parser = argparse.ArgumentParser("python docs/exercises/checks", description="Check the solution of an exercise.")
    parser.add_argument("exercise", type=int, choices=EXERCISES, metavar="N", help=f"its number, 1 to {len(EXERCISES)}")
    parser.add_argument("file", type=Path, metavar="FILE.py", help="the solution: the starter file, completed")
    options = parser.parse_args(arguments)
    try:
        outcomes = check_file(options.exercise, options.file)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(*map(line, outcomes), summary(outcomes), sep="\n")
    return int(not all(outcome.passed for outcome in outcomes))


def check_file(number: int, file: Path) -> list[Outcome]:
    """Return the outcomes of an exercise's check for the solution in `file`.

    The solution runs in a process of its own. If that ends before it has reported the outcomes, the check has failed.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it cannot be imported, see `dmis.base.plugins.load_plugin`.
    """
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        try:
            return pool.submit(_check, number, file).result()
        except BrokenProcessPool:
            return [Outcome(f"exercise {number}", False, f"{file} ended the process before its check was complete")]


def _check(number: int, file: Path) -> list[Outcome]:
    """Return the outcomes of the check of a file, in this process."""
    load_plugin(file)
    return EXERCISES[number](sys.modules[file.stem])
