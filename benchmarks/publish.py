"""Make every table and picture of the pages anew where it is older than the renders or the script that decide it.

    python benchmarks/publish.py             make what is old (hours; an interrupted run continues)
    python benchmarks/publish.py --only points stability       make these, old or not
    python benchmarks/publish.py --list      what is old, and why (a minute, for the renders)
    python benchmarks/publish.py --pages     write the tables into the pages again from docs/tables: seconds
    python benchmarks/publish.py --record points --commit ID --minutes 31     note that this was made by hand

What decides a piece of `pieces.PIECES` are small renders of its scenes and rules (`frozen`): a refactoring that changes
them by rounding alone makes nothing old. Their fingerprints are in docs/tables/renders.csv; one that changes gets
another row with the next serial number. docs/tables/published.csv has a row for each piece, with the serial number at
the time, and docs/published.md shows it.

Before an old piece is made, its rows in docs/tables are deleted, and with them its row in published.csv. So a piece
without such a row was interrupted, or never made: its command continues with the rows that are there.
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
from common import machine, replace_table
from pieces import PIECES, Piece
from rows import markdown, read_rows, write_rows

import dmis

DOCS = ROOT / "docs"
PUBLISHED = DOCS / "tables" / "published.csv"
RENDERS = DOCS / "tables" / "renders.csv"
PAGE = DOCS / "published.md"
FIELDS = ("piece", "commit", "date", "minutes", "machine", "serial", "script", "files")
"""Columns of `PUBLISHED`; `serial` is that of the renders at the time, `script` and `files` are hashes."""
NUMBERS = (
    *(f"{name}{by}" for name in ("image", "deviation", "weight", "samples") for by in ("", " by number")),
    "rays",
)
"""Numbers of a fingerprint."""


# Tables of the pages ------------------------------------------------------------------------------------------------


def page_of(block: str) -> tuple[Path, str]:
    """Return the page and the mark of a block such as ``"measurements.md: steps"``."""
    name, _, mark = block.partition(": ")
    return (ROOT if name == "README.md" else DOCS) / name, mark


def tables_of(piece: Piece) -> dict[str, list[str]]:
    """Return the lines of the blocks of a piece, from docs/tables alone."""
    if not piece.module:
        return {}
    tables: dict[str, list[str]] = import_module(piece.module).tables()
    return {block: tables[block] for block in piece.blocks}


def sentences_of(piece: Piece) -> dict[str, list[str]]:
    """Return the fragments of prose with numbers, by page; from docs/tables alone."""
    module = import_module(piece.module) if piece.module else None
    return module.sentences() if module is not None and hasattr(module, "sentences") else {}


def write_pages(pieces: Iterable[Piece] = PIECES) -> None:
    """Write the blocks of the pieces into the pages, and `PAGE`; pieces without rows are left out."""
    for piece in pieces:
        if missing := [name for name in piece.files if not (DOCS / name).exists()]:
            print(f"{piece.name}: there is no {', '.join(missing)}", file=sys.stderr)
            continue
        for block, lines in tables_of(piece).items():
            replace_table(*page_of(block), *lines)
    write_published()


def write_published() -> None:
    """Write `PAGE`: each piece, its command, and where and when it was made."""
    commands = {piece.name: piece.command for piece in PIECES}
    lines = [
        "# What was published when",
        "",
        "After this page you know by which command, at which commit and on which machine each table and picture was",
        "made. `make publish` makes those that are older than the renders or the script that decide them.",
        "",
    ]
    cells = [
        [
            row["piece"],
            f"`{commands.get(row['piece'], '–')}`",
            row["commit"],
            row["date"],
            row["minutes"],
            row["machine"],
        ]
        for row in read_rows(PUBLISHED)
    ]
    lines += markdown(["piece", "command: python …", "commit", "date", "minutes", "machine"], cells)
    PAGE.write_text("\n".join(lines) + "\n", "utf-8")


# Ages ---------------------------------------------------------------------------------------------------------------


def code_digest(script: str) -> str:
    """Return a hash of the code of a script, without comments and docstrings; empty for no script."""
    if not script:
        return ""
    tree = ast.parse((ROOT / script).read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:12]


def files_digest(piece: Piece) -> str:
    """Return a hash of the files of a piece."""
    sha = hashlib.sha256()
    for name in piece.files:
        sha.update((DOCS / name).read_bytes() if (DOCS / name).exists() else b"missing")
    return sha.hexdigest()[:12]


def update_renders(pieces: Iterable[Piece] = PIECES) -> None:
    """Render the frozen configurations that decide pieces, and note fingerprints that differ by more than rounding."""
    rows: list[Mapping[str, object]] = [*read_rows(RENDERS)]
    before = {str(row["render"]): {key: float(str(row[key])) for key in NUMBERS} for row in rows}
    serial = 1 + newest_serial()
    scenes: dict[str, dmis.Scene] = {}
    begins = tuple(begin for piece in pieces for begin in piece.renders)
    table = {name: item for name, item in frozen.configurations().items() if name.startswith(begins)}
    for n, (name, configuration) in enumerate(table.items(), 1):
        print(f"\rrender {n} of {len(table)}", end="", file=sys.stderr, flush=True)
        numbers = frozen.fingerprint(frozen.render(configuration, scenes))
        if not frozen.agree(before.get(name, {}), numbers):
            rows.append({"serial": serial, "render": name, **{key: f"{x:.7g}" for key, x in numbers.items()}})
    print(file=sys.stderr)
    write_rows(RENDERS, rows, ("serial", "render", *NUMBERS))


def newest_serial() -> int:
    """Return the serial number of the newest renders; 0 if there are none."""
    return max((int(row["serial"]) for row in read_rows(RENDERS)), default=0)


def reason_to_make(piece: Piece, published: dict[str, dict[str, str]], renders: list[dict[str, str]]) -> str:
    """Return why a piece is old; empty if it is not."""
    if piece.name not in published:
        return "was never made by this command"
    row = published[piece.name]
    if row["files"] != files_digest(piece):
        return "its files are not those that were published"
    if row["script"] != code_digest(piece.script):
        return f"{piece.script} has changed"
    for render in renders:
        if int(render["serial"]) > int(row["serial"]) and render["render"].startswith(piece.renders or ("\n",)):
            return f"the render '{render['render']}' has changed"
    return ""


def state() -> tuple[dict[str, dict[str, str]], list[dict[str, str]]]:
    """Return the published rows by piece, and the fingerprints."""
    return {row["piece"]: row for row in read_rows(PUBLISHED)}, read_rows(RENDERS)


def record(piece: Piece, minutes: float | None = None, commit: str = "") -> None:
    """Note that the files of a piece have been made, at a commit; without minutes, those of its old row stay."""
    published, _ = state()
    old = published.get(piece.name, {})
    git = ["git", "-C", str(ROOT), "show", "-s", "--format=%h %cs", commit or "HEAD"]
    made = subprocess.run(git, capture_output=True, text=True, check=False).stdout.split()
    published[piece.name] = {
        "piece": piece.name,
        "commit": made[0] if made else "unknown",
        "date": made[1] if commit and made else str(date.today()),
        "minutes": old.get("minutes", "–") if minutes is None else f"{minutes:.1f}",
        "machine": machine(),
        "serial": str(newest_serial()),
        "script": code_digest(piece.script),
        "files": files_digest(piece),
    }
    write_published_rows(published)


def forget(piece: Piece) -> dict[Path, bytes]:
    """Delete the rows of a piece, so that they are measured anew, and return them.

    A piece that was interrupted or never made keeps its rows.
    """
    published, _ = state()
    if not published.pop(piece.name, None):
        return {}
    paths = [DOCS / name for name in piece.files if name.startswith("tables/") and (DOCS / name).exists()]
    rows = {path: path.read_bytes() for path in paths}
    for path in rows:
        path.unlink()
    write_published_rows(published)
    return rows


def write_published_rows(published: Mapping[str, Mapping[str, object]]) -> None:
    """Write `PUBLISHED`, in the order of the pieces."""
    order = {known.name: n for n, known in enumerate(PIECES)}
    write_rows(PUBLISHED, sorted(published.values(), key=lambda row: order.get(str(row["piece"]), len(order))), FIELDS)


# Making -------------------------------------------------------------------------------------------------------------


def make(piece: Piece) -> bool:
    """Run the command of a piece, and note that it was made; return whether it succeeded.

    A command that fails before its first row, such as one that lacks a package, leaves the old rows.
    """
    published, _ = state()
    old_rows = forget(piece)
    begin = time.perf_counter()
    done = subprocess.run([sys.executable, *shlex.split(piece.command)], cwd=ROOT, check=False)
    if done.returncode == 0:
        record(piece, (time.perf_counter() - begin) / 60)
        write_pages([piece])
    elif not any(path.exists() for path in old_rows):
        for path, content in old_rows.items():
            path.write_bytes(content)
        write_published_rows(published)
    return done.returncode == 0


def named(names: Sequence[str] | None) -> list[Piece]:
    """Return the pieces of these names, all if None; `SystemExit` for a name that none has."""
    known = {piece.name: piece for piece in PIECES}
    unknown = [name for name in names or () if name not in known]
    if unknown:
        sys.exit(f"no piece {', '.join(unknown)}; pieces are {', '.join(known)}")
    return [known[name] for name in names] if names else list(PIECES)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line above; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", nargs="+", metavar="PIECE", help="make these, old or not")
    parser.add_argument("--list", action="store_true", help="print what is old, and why; make nothing")
    parser.add_argument("--pages", action="store_true", help="write the pages from docs/tables; measure nothing")
    parser.add_argument("--record", nargs="+", metavar="PIECE", help="note that files were made by hand just now")
    parser.add_argument("--commit", default="", help="commit at which --record's pieces were made (default: HEAD)")
    parser.add_argument("--minutes", type=float, help="minutes that this took")
    given = parser.parse_args(arguments)
    pieces = named(given.only or given.record)
    if given.pages:
        write_pages(pieces)
        return 0
    update_renders(pieces)
    if given.record:
        for piece in pieces:
            record(piece, given.minutes, given.commit)
        write_pages(pieces)
        return 0
    reasons = {piece.name: reason_to_make(piece, *state()) for piece in pieces}
    for piece in pieces:
        print(f"{piece.name:40} {reasons[piece.name] or 'as new as what decides it'}")
    if given.list:
        return 0
    old = [piece for piece in pieces if given.only or reasons[piece.name]]
    failed = []
    for n, piece in enumerate(old, 1):
        print(f"[{n} of {len(old)}] {piece.name}: python {piece.command}", flush=True)
        if not make(piece):
            failed.append(piece.name)
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return len(failed) and 1


if __name__ == "__main__":
    sys.exit(main())
