"""
Which published tables are older than the code that decides them
================================================================

A measured table of README.md or docs/*.md is followed by a line that says how it was made:

    <!-- table: COMMAND; DATE; commit COMMIT; depends: PATH PATH ... -->

`common.replace_table` writes that line. This script (``make tables``) lists the tables and compares each with the
history of the paths: a table is old if one of them has changed since its commit. That the numbers have changed, too, is
not said; the command makes them again. It needs git, and a clone that is not shallow.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from datetime import date
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MARKER = re.compile(
    r"^<!-- table: (?P<command>[^;\n]+); (?P<date>\d{4}-\d\d-\d\d); commit (?P<commit>[0-9a-f]{7,40}|unknown); "
    r"depends: (?P<depends>[^;\n]+) -->$",
    re.M,
)


class NoHistoryError(RuntimeError):
    """Git cannot tell what has changed."""


@dataclass(frozen=True)
class Table:
    """A published table: where it is and how it was made."""

    place: str
    command: str
    date: str
    commit: str
    depends: tuple[str, ...]


def git(root: Path, *words: str) -> str:
    """Return what git prints; raise `NoHistoryError` if it fails or is not there."""
    try:
        return subprocess.run(["git", *words], cwd=root, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError) as error:
        raise NoHistoryError(f"git {words[0]} failed in {root}") from error


def find_tables(root: Path) -> list[Table]:
    """Return the marked tables of the pages; raise `ValueError` for a marker that cannot be read."""
    tables = []
    for page in (root / "README.md", *sorted((root / "docs").glob("*.md"))):
        text = page.read_text("utf-8")
        found = list(MARKER.finditer(text))
        if len(found) != text.count("\n<!-- table:"):
            raise ValueError(f"{page.name} has a marker <!-- table: ... --> that is not of the form in {__file__}")
        for match in found:
            place = f"{page.relative_to(root)}:{text.count(chr(10), 0, match.start()) + 1}"
            depends = tuple(match["depends"].split())
            tables.append(Table(place, match["command"], match["date"], match["commit"], depends))
    return tables


def newer_change(root: Path, table: Table) -> str:
    """Return the newest change of the table's paths since its commit, as one line; empty if there is none.

    A commit that the history does not have is replaced by the end of the table's day.

    Raises
    ------
    NoHistoryError
        If there is no history, or only its end (a shallow clone).
    """
    if git(root, "rev-parse", "--is-shallow-repository") == "true":
        raise NoHistoryError("the clone is shallow; `git fetch --unshallow` gets the history")
    try:
        git(root, "merge-base", "--is-ancestor", table.commit, "HEAD")
        since = [f"{table.commit}..HEAD"]
    except NoHistoryError:
        since = [f"--since={table.date}T23:59:59"]
    return git(root, "log", "-1", "--format=%h %cs %s", *since, "--", *table.depends)


def marker(old: str = "") -> str:
    """Return the marker of a table that the running script makes now; the paths are those of the `old` block."""
    known = MARKER.search(old)
    script = Path(sys.argv[0]).resolve()
    name = script.relative_to(ROOT).as_posix() if script.is_relative_to(ROOT) else script.name
    try:
        commit = git(ROOT, "rev-parse", "--short", "HEAD")
    except NoHistoryError:
        commit = "unknown"
    command = shlex.join(["python", name, *sys.argv[1:]]).replace(";", ",")
    return (
        f"<!-- table: {command}; {date.today()}; commit {commit}; depends: {known['depends'] if known else 'dmis'} -->"
    )


def main(root: Path = ROOT) -> int:
    """Print a line for each table, those that are old with what has changed; return 0, or 2 without a history."""
    tables = find_tables(root)
    old = 0
    try:
        for table in tables:
            change = newer_change(root, table)
            old += bool(change)
            state = f"OLDER than {change}" if change else "as new as its modules"
            print(f"{table.place}  {table.date} {table.commit}  {state}\n    {table.command}")
    except NoHistoryError as error:
        print(f"cannot tell which tables are old: {error}", file=sys.stderr)
        return 2
    print(f"{old} of {len(tables)} tables are older than the modules that decide them")
    return 0


if __name__ == "__main__":
    sys.exit(main())
