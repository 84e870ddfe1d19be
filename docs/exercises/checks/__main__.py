"""Check the solution of an exercise; this folder and an installed dmis are all that it needs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from dmis.testing.report import line, summary
from exercises import EXERCISES, check_file


def main(arguments: list[str] | None = None) -> int:
    """Check the file that the command line names; return 0 if all checks passed, 1 if one failed, 2 for a bad file."""
    parser = argparse.ArgumentParser("python docs/exercises/checks", description=__doc__)
    parser.add_argument("exercise", type=int, choices=EXERCISES, metavar="N", help=f"its number, 1 to {len(EXERCISES)}")
    parser.add_argument("file", type=Path, metavar="FILE.py", help="the solution: the starter file, completed")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="directory of pictures (default: the file's)")
    options = parser.parse_args(arguments)
    try:
        outcomes = check_file(options.exercise, options.file, options.output or options.file.parent)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(*map(line, outcomes), summary(outcomes), sep="\n")
    return int(not all(outcome.passed for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
