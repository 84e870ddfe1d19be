"""Rows of CSV files in docs/tables: an interrupted measurement continues, and a table can be made again."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, fields
from itertools import starmap
from pathlib import Path

from dmis.experiment.runs import Run

COLUMNS = ("scene", *(field.name for field in fields(Run)))


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a file; none if there is no file."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_rows(path: Path, rows: Iterable[Mapping[str, object]], fields: Sequence[str]) -> None:
    """Write a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, fields, lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table."""
    return [f"| {' | '.join(head)} |", "|---" * len(head) + "|", *(f"| {' | '.join(row)} |" for row in rows)]


def read_runs(path: Path) -> dict[str, list[Run]]:
    """Return the runs of each scene in a file, none if there is no file; scenes are named as ``tt 300×167``."""
    runs: dict[str, list[Run]] = {}
    for row in read_rows(path):
        runs.setdefault(row["scene"], []).append(Run.read(row))
    return runs


def writer(path: Path, scene: str) -> Callable[..., None]:
    """Return a function that adds a run of a scene to a file, which it makes first if there is none."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(",".join(COLUMNS) + "\n", "utf-8")

    def write(run: Run, *_: object) -> None:
        with path.open("a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow({"scene": scene, **asdict(run)})

    return write


def two_at_once(function: Callable[..., object], turns: Sequence[tuple[object, ...]]) -> Iterator[object]:
    """Yield what a function returns for each turn of arguments; two processes share them if there are several."""
    if len(turns) == 1:
        yield from starmap(function, turns)
        return
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        for future in [pool.submit(function, *turn) for turn in turns]:
            yield future.result()
