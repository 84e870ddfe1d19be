"""Make every table and picture of the pages anew where it is older than the renders or the script that decide it.

    python benchmarks/publish.py             make what is old (hours; an interrupted run continues)
    python benchmarks/publish.py --only points stability       make these, old or not
    python benchmarks/publish.py --list      what is old, and why (a minute, for the renders)
    python benchmarks/publish.py --pages     write the tables into the pages again from docs/tables: seconds
    python benchmarks/publish.py --record points --commit ID --minutes 31     note that this was made by hand

What decides a piece of `pieces.PIECES` are small renders of its scenes and rules (`frozen`): a refactoring that changes
them by rounding alone makes nothing old. Their fingerprints are in docs/tables/renders.csv; one that changes gets
another row with the next serial number. docs/tables/published.csv has a row for each piece, with the serial number at
the time, and the end of docs/results.md shows it.

An old piece loses its rows in docs/tables and in published.csv before it is made, so that one without a row there was
interrupted, or never made: its command continues with the rows that it finds. ``git checkout docs/tables`` brings back
what a command that fails has lost.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from datetime import date
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "examples"), str(ROOT / "examples" / "thesis")]

import frozen
from common import machine, replace_table, replace_tables
from pieces import GALLERY, PIECES, Piece
from rows import markdown, read_rows, write_rows

import dmis

DOCS = ROOT / "docs"
PUBLISHED, RENDERS = DOCS / "tables" / "published.csv", DOCS / "tables" / "renders.csv"
PAGE = DOCS / "results.md"
FIELDS = ("piece", "commit", "date", "minutes", "machine", "serial", "script", "files")
"""Columns of `PUBLISHED`; `serial` is that of the renders at the time, `script` and `files` are hashes."""
NUMBERS = (
    *(f"{name}{by}" for name in ("image", "deviation", "weight", "samples") for by in ("", " by number")),
    "rays",
)
"""Numbers of a fingerprint."""
Rows = dict[str, dict[str, str]]
"""Rows of `PUBLISHED` by piece."""


def write_pages(pieces: Iterable[Piece] = PIECES) -> None:
    """Write the blocks of the pieces, and `commands`, into the pages; pieces without rows are left out."""
    for piece in pieces:
        missing = [name for name in piece.files if not (DOCS / name).exists()]
        if missing:
            print(f"{piece.name}: there is no {', '.join(missing)}", file=sys.stderr)
        elif piece.module:
            replace_tables(import_module(piece.module).tables())
    replace_table(PAGE, "published", *commands())


def commands() -> list[str]:
    """Return the table of commands, commits and minutes of `PUBLISHED`; pictures of the gallery share a row."""
    rows, gallery = [], []
    for name, row in published().items():
        command = next((piece.command for piece in PIECES if piece.name == name), "–")
        if command.startswith(GALLERY):
            gallery.append(float(row["minutes"]))
        else:
            rows.append([name, f"`{command}`", row["commit"], row["minutes"]])
    if gallery:
        rows.append([f"{len(gallery)} figures", f"`{GALLERY} NAME`", "–", f"{sum(gallery):.1f}"])
    return markdown(["piece", "command: python …", "commit", "minutes"], rows)


def code_digest(script: str) -> str:
    """Return a hash of the code of a script, without imports, comments and docstrings; empty for no script."""
    if not script:
        return ""
    tree = ast.parse((ROOT / script).read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef):
            kept = node.body[ast.get_docstring(node) is not None :]
            node.body = [line for line in kept if not isinstance(line, ast.Import | ast.ImportFrom)]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:12]


def files_digest(piece: Piece) -> str:
    """Return a hash of the files of a piece."""
    contents = [(DOCS / name).read_bytes() if (DOCS / name).exists() else b"missing" for name in piece.files]
    return hashlib.sha256(b"".join(contents)).hexdigest()[:12]


def update_renders(pieces: Iterable[Piece] = PIECES) -> None:
    """Render the frozen configurations that decide pieces, and note fingerprints that differ by more than rounding."""
    rows: list[Mapping[str, object]] = [*read_rows(RENDERS)]
    before = {str(row["render"]): {key: float(str(row[key])) for key in NUMBERS} for row in rows}
    serial, scenes = 1 + newest_serial(), dict[str, dmis.Scene]()
    begins = tuple(begin for piece in pieces for begin in piece.renders)
    for name, configuration in frozen.configurations().items():
        if name.startswith(begins):
            print(f"\r{name:70}", end="", file=sys.stderr, flush=True)
            numbers = frozen.fingerprint(frozen.render(configuration, scenes))
            if not frozen.agree(before.get(name, {}), numbers):
                rows.append({"serial": serial, "render": name, **{key: f"{x:.7g}" for key, x in numbers.items()}})
    print(file=sys.stderr)
    write_rows(RENDERS, rows, ("serial", "render", *NUMBERS))


def newest_serial() -> int:
    """Return the serial number of the newest renders; 0 if there are none."""
    return max((int(row["serial"]) for row in read_rows(RENDERS)), default=0)


def published() -> Rows:
    """Return the published rows by piece."""
    return {row["piece"]: row for row in read_rows(PUBLISHED)}


def write_published(rows: Rows) -> None:
    """Write `PUBLISHED`, in the order of the pieces."""
    order = [piece.name for piece in PIECES]
    write_rows(PUBLISHED, sorted(rows.values(), key=lambda row: [*order, row["piece"]].index(row["piece"])), FIELDS)


def reason_to_make(piece: Piece, rows: Rows, renders: Iterable[Mapping[str, str]]) -> str:
    """Return why a piece is old, by published rows and rows of renders; empty if it is not."""
    if piece.name not in rows:
        return "was never made by this command"
    row = rows[piece.name]
    if row["files"] != files_digest(piece):
        return "its files are not those that were published"
    if row["script"] != code_digest(piece.script):
        return f"{piece.script} has changed"
    newer = (render["render"] for render in renders if int(render["serial"]) > int(row["serial"]))
    return next((f"the render '{name}' has changed" for name in newer if name.startswith(piece.renders)), "")


def record(piece: Piece, minutes: float | None = None, commit: str = "") -> None:
    """Note that the files of a piece have been made, at a commit; without minutes, those of its old row stay."""
    rows = published()
    git = ["git", "-C", str(ROOT), "show", "-s", "--format=%h %cs", commit or "HEAD"]
    made = subprocess.run(git, capture_output=True, text=True, check=False).stdout.split() or ["unknown", ""]
    rows[piece.name] = {
        "piece": piece.name,
        "commit": made[0],
        "date": made[1] if commit else str(date.today()),
        "minutes": rows.get(piece.name, {}).get("minutes", "–") if minutes is None else f"{minutes:.1f}",
        "machine": machine(),
        "serial": str(newest_serial()),
        "script": code_digest(piece.script),
        "files": files_digest(piece),
    }
    write_published(rows)


def make(piece: Piece) -> bool:
    """Run the command of a piece, without the rows of one that was published; return whether it succeeded."""
    rows, begin = published(), time.perf_counter()
    if rows.pop(piece.name, None):
        for name in piece.files:
            if name.startswith("tables/"):
                (DOCS / name).unlink(missing_ok=True)
        write_published(rows)
    done = subprocess.run([sys.executable, *shlex.split(piece.command)], cwd=ROOT, check=False)
    if done.returncode == 0:
        record(piece, (time.perf_counter() - begin) / 60)
        write_pages([piece])
    return done.returncode == 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line above; return the exit code."""
    names = [piece.name for piece in PIECES]
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", nargs="+", metavar="PIECE", choices=names, help="make these, old or not")
    parser.add_argument("--list", action="store_true", help="print what is old, and why; make nothing")
    parser.add_argument("--pages", action="store_true", help="write the pages from docs/tables; measure nothing")
    parser.add_argument("--record", nargs="+", metavar="PIECE", choices=names, help="these were made by hand just now")
    parser.add_argument("--commit", default="", help="commit at which --record's pieces were made (default: HEAD)")
    parser.add_argument("--minutes", type=float, help="minutes that this took")
    given = parser.parse_args(arguments)
    pieces = [piece for piece in PIECES if piece.name in (given.only or given.record or names)]
    if not given.pages:
        update_renders(pieces)
    for piece in pieces if given.record else ():
        record(piece, given.minutes, given.commit)
    if given.pages or given.record:
        write_pages(pieces)
        return 0
    reasons = {piece.name: reason_to_make(piece, published(), read_rows(RENDERS)) for piece in pieces}
    for name, reason in reasons.items():
        print(f"{name:40} {reason or 'as new as what decides it'}")
    old = [piece for piece in pieces if (given.only or reasons[piece.name]) and not given.list]
    failed = []
    for n, piece in enumerate(old, 1):
        print(f"[{n} of {len(old)}] {piece.name}: python {piece.command}", flush=True)
        if not make(piece):
            failed.append(piece.name)
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
