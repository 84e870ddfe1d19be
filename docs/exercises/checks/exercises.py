"""The checks of all exercises, one module for each tutorial, and the command that checks files with solutions.

Tutorial t has the exercises 3t + 1 to 3t + 3. A starter file of each is in ``docs/exercises``, and a solution in
``docs/exercises/solutions``.
"""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path

from apart import Limits, check_file
from dmis.testing.outcome import line, summary
from grading import EXERCISES, EXPONENTS
from marks import mark_folder, table, write_csv
from starters import other_task, starter

for _name in ("one_batch", "monte_carlo", "sampling", "mis", "parabola", "pilot", "own", "paths"):
    import_module(f"check_{_name}")


SEED_HELP = f"other numbers, and other tasks in exercises {', '.join(map(str, EXPONENTS))} (see --starter)"


def main(arguments: list[str] | None = None) -> int:
    """Check what the command line names; return 0 if all checks passed, 1 if one failed, 2 for a bad file."""
    options = _parser().parse_args(arguments)
    limits = Limits(options.seconds, options.memory, quiet=options.folder is not None)
    try:
        if options.starter:
            print(starter(options.starter, options.seed), end="")
            return 0
        if options.folder:
            return _mark(options.folder, options.csv, options.seed, limits)
        if options.exercise is None or options.file is None:
            raise ValueError("write the number of an exercise and a file, or --folder HANDINS, or --starter N")
        outcomes = check_file(options.exercise, options.file, options.seed, limits)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    failed = not all(outcome.passed for outcome in outcomes)
    print(*map(line, outcomes), summary(outcomes), sep="\n")
    if failed and (why := other_task(options.exercise, options.seed)):
        print(why)
    return int(failed)


def _mark(folder: Path, file: Path | None, seed: int, limits: Limits) -> int:
    """Print the marks of a folder, and write them to a CSV file; return 0, whatever the marks."""
    marks = mark_folder(folder, seed, limits)
    print(table(marks))
    if file is not None:
        write_csv(marks, file)
        print(f"\n{file}: {len(marks)} hand-ins")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python docs/exercises/checks", description="Check solutions of exercises.")
    last = len(EXERCISES)
    number = {"type": int, "choices": EXERCISES, "metavar": "N"}
    parser.add_argument("exercise", nargs="?", help=f"its number, 1 to {last}", **number)
    parser.add_argument("file", nargs="?", type=Path, metavar="FILE.py", help="the starter file, completed")
    parser.add_argument("--folder", type=Path, help="check all files in it, such as anna_03.py or anna/03_light.py")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the marks of --folder to FILE")
    parser.add_argument("--starter", help="print the starter of exercise N, with the parameters of --seed", **number)
    parser.add_argument("--seed", type=int, default=0, help=f"0 (default): the published numbers; others: {SEED_HELP}")
    parser.add_argument("--seconds", type=float, default=20, help="CPU seconds of a hand-in (default 20)")
    parser.add_argument("--memory", type=float, default=2, metavar="GB", help="its memory limit (default 2)")
    return parser
