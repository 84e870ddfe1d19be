"""
What a cluster costs
====================

Measures what docs/cluster.md says of many workers: seconds of a tile, tasks that Dask's scheduler handles, and whole
renders on one and two worker processes of this machine. Takes a minute or two; nothing else should run meanwhile. Rows
go to docs/tables/cluster.csv, from which `tables` and `sentences` are made.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT
from rows import markdown, read_rows, write_rows

import dmis

CSV = ROOT / "docs" / "tables" / "cluster.csv"
FIELDS = ("quantity", "value")
SCENE, RULE, SPP = "killeroo-diffuse", "auto", 128
TILE = 32
"""Pixels of a side of a tile of the final pass."""
STAGES = ("total", "pilot", "fit", "render")
RENDERS = {"thread": "1 thread, no cluster", "1 worker": "1 worker process", "2 workers": "2 worker processes"}
"""Renders, and what the table calls them."""


def measure(size: tuple[int, int], tasks: int) -> Iterator[tuple[str, float]]:
    """Yield each quantity and its value; nothing that Dask renders may differ by a bit."""
    from distributed import Client, LocalCluster

    scene = dmis.load_scene(SCENE, size)
    alone = dmis.render(scene, RULE, SPP, parallel=1)
    yield from of_render("thread", alone)
    yield "seconds of a tile", alone.seconds["render"] / (size[0] / TILE * size[1] / TILE)
    for workers in (1, 2):
        with (
            LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as cluster,
            Client(cluster) as client,
        ):
            executor = client.get_executor(pure=False)
            dmis.render(scene.crop((0, 0, 8, 8)), "balance", 4, parallel=executor)  # what is slow the first time
            result = dmis.render(scene, RULE, SPP, parallel=executor)
            assert (result.image == alone.image).all()
            yield from of_render("2 workers" if workers == 2 else "1 worker", result)
            if workers == 2:
                begin = time.perf_counter()
                for future in [executor.submit(int, k) for k in range(tasks)]:
                    future.result()
                yield "tasks per second", tasks / (time.perf_counter() - begin)


def of_render(name: str, result: dmis.Result) -> Iterator[tuple[str, float]]:
    """Yield the seconds of the stages of a render."""
    for stage in STAGES:
        yield f"{name}: {stage}", result.seconds[stage]


def values() -> dict[str, float]:
    """Return the measured quantities by name."""
    return {row["quantity"]: float(row["value"]) for row in read_rows(CSV)}


def tables() -> dict[str, list[str]]:
    """Return the lines of the block."""
    of = values()
    rows = [[title, *(f"{of[f'{name}: {stage}']:.2f}" for stage in STAGES)] for name, title in RENDERS.items()]
    head = [f"{SCENE}, {RULE}, {SPP} samples", "seconds", "pilot", "fit", "final"]
    return {"cluster.md: cluster": markdown(head, rows)}


def sentences() -> dict[str, list[str]]:
    """Return what the page says of tiles and workers."""
    of = values()
    seconds, rate = of["seconds of a tile"], of["tasks per second"]
    return {
        "cluster.md": [
            f"a tile takes {seconds:.2f} s. Dask's scheduler handles some {rate:.0f} tasks per second, so "
            f"{rate * seconds:.0f} workers saturate it"
        ]
    }


def main() -> None:
    """Measure, and write the rows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[3])
    parser.add_argument("--quick", action="store_true", help="a small image: seconds")
    parser.add_argument("--csv", type=Path, default=CSV, help="rows of results")
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for quantity, value in measure(*(((64, 48), 200) if given.quick else ((256, 192), 2000))):
        rows.append({"quantity": quantity, "value": f"{value:.4g}"})
        print(quantity, rows[-1]["value"], flush=True)
    write_rows(given.csv, rows, FIELDS)


if __name__ == "__main__":
    main()
