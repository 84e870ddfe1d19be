"""The checks of all exercises, one module for each tutorial, and the check of a file with a solution.

Tutorial t has the exercises 3t + 1 to 3t + 3. A starter file of each is in ``docs/exercises``, and a solution in
``docs/exercises/solutions``.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

from dmis.base.plugins import load_plugin
from dmis.testing.outcome import Outcome, attempt
from dmis.testing.report import write_figures
from grading import EXERCISES

for _name in ("one_batch", "monte_carlo", "sampling", "mis", "parabola", "pilot", "own"):
    import_module(f"check_{_name}")


def check_file(number: int, file: Path, folder: Path) -> list[Outcome]:
    """Return the outcomes of an exercise's check for the solution in `file`; write pictures of failures to `folder`.

    The solution runs in a process of its own. If that ends before it has reported the outcomes, the check has failed.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it cannot be imported, see `dmis.base.plugins.load_plugin`.
    """
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        try:
            return pool.submit(_check, number, file, folder).result()
        except BrokenProcessPool:
            return [Outcome(f"exercise {number}", False, f"{file} ended the process before its check was complete")]


def _check(number: int, file: Path, folder: Path) -> list[Outcome]:
    """Return the outcomes of the check of a file, in this process, without their pictures, which are written."""
    load_plugin(file)
    outcomes = attempt(f"exercise {number}", lambda: EXERCISES[number](sys.modules[file.stem]))
    try:
        write_figures(outcomes, folder, file.stem)
    except ImportError as error:
        print(f"pictures of what failed are left out ({error})", file=sys.stderr)
    return [replace(outcome, figure=None) for outcome in outcomes]
