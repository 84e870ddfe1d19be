"""
What a cluster costs
====================

Measures what docs/cluster.md says of many workers: bytes of a scene, of a tile and of its result; seconds to render a
tile and to merge it; tasks that Dask's scheduler handles; and whole renders on one and two worker processes of this
machine, whose table goes into the page. The last table is computed from these, for 1,000 workers, and says so. Takes a
minute or two; nothing else should run meanwhile.
"""

import argparse
import math
import pickle
import platform
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, replace_table

import dmis
from dmis.fit.rule import next_round
from dmis.pipeline.checkpoint import Store
from dmis.pipeline.executor import _send
from dmis.pipeline.film import PassFilm
from dmis.pipeline.job import resolve
from dmis.pipeline.passes import Passes
from dmis.pipeline.tile import make_tiles, render_tile

PAGE = ROOT / "docs" / "cluster.md"
RULE, SPP = "auto", 128


def main():
    """Measure, print the tables, and put them into the page."""
    from distributed import Client, LocalCluster

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[3])
    parser.add_argument("--quick", action="store_true", help="a small image: seconds")
    parser.add_argument("--page", type=Path, default=PAGE, help="the page whose tables are replaced")
    given = parser.parse_args()
    size, tasks = ((64, 48), 200) if given.quick else ((256, 192), 2000)

    scene = dmis.load_scene("killeroo-diffuse", size)
    alone, finals = dmis.render(scene, RULE, SPP, parallel=1), final_tiles(scene)
    tile_seconds = alone.seconds["render"] / len(finals)
    merge, logged = (merge_seconds(scene, finals, file) for file in (False, True))
    renders = [f"| {scene.name}, {RULE}, {SPP} samples | seconds | pilot | fit | final |", "|---|---|---|---|---|"]
    renders.append(row("1 thread, no cluster", alone.seconds))
    rate = broadcast = 0.0
    for workers in (1, 2):
        with (
            LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as cluster,
            Client(cluster) as client,
        ):
            executor = client.get_executor(pure=False)
            dmis.render(scene.crop((0, 8), (0, 8)), "balance", 4, parallel=executor)  # what is slow the first time
            result = dmis.render(scene, RULE, SPP, parallel=executor)
            assert (result.image == alone.image).all()
            renders.append(row(f"{workers} worker process{'es' * (workers > 1)}", result.seconds))
            begin = time.perf_counter()
            for future in [executor.submit(int, k) for k in range(tasks)]:
                future.result()
            rate = tasks / (time.perf_counter() - begin)
            begin = time.perf_counter()
            sent = _send(executor, scene)
            broadcast = time.perf_counter() - begin
            del sent

    busy = 1000 / tile_seconds
    up, down = (len(pickle.dumps(x)) for x in (finals[-1], render_tile(scene, finals[-1])))
    megabytes = len(pickle.dumps(scene)) / 1e6
    last = [
        f"| of {scene.name} | one tile or worker, measured | 1,000 workers, **extrapolated** |",
        "|---|---|---|",
        f"| rendering | {tile_seconds:.3f} s per tile of {finals[-1].rows[1] - finals[-1].rows[0]} rows | "
        f"{busy:.0f} tiles/s |",
        f"| scheduler | {rate:.0f} empty tasks/s, with 2 workers | busy with {rate * tile_seconds:.0f} workers |",
        f"| merge | {merge * 1e3:.2f} ms per tile, {logged * 1e3:.2f} ms with a checkpoint | "
        f"{busy * merge:.1f} s of work per second, {busy * logged:.1f} s with a checkpoint |",
        f"| network, out of the client | {up / 1e3:.0f} kB per tile | {busy * up / 1e6:.0f} MB/s |",
        f"| network, into the client | {down / 1e3:.0f} kB per tile | {busy * down / 1e6:.0f} MB/s |",
        f"| scene | {megabytes:.1f} MB, {broadcast:.2f} s to 2 workers | {megabytes:.0f} MB to each, in a tree of "
        f"depth {math.ceil(math.log2(1000))}; some {broadcast * math.log2(1000):.1f} s |",
        f"| fit, in the client | {alone.seconds['fit']:.2f} s | {alone.seconds['fit']:.2f} s, while all wait |",
    ]
    text = "\n".join(
        [
            f"Made on {date.today()} with `benchmarks/measure_cluster.py`; {size[0]}×{size[1]} pixels, {RULE}, {SPP} "
            f"samples per pixel; {platform.machine()}, Python {platform.python_version()}.",
            *("", *renders),
        ]
    )
    print("\n".join([text, "", *last]))
    if not given.quick or given.page != PAGE:
        replace_table(given.page, "cluster", text)


def final_tiles(scene):
    """Return the tiles of the final round."""
    job = resolve(scene, RULE, SPP, 0, dmis.Settings())
    rounds, film = job.rule.rounds(job.budget), None
    with Passes(job, 1) as passes:
        while (round_ := next_round(rounds, film)) is not None:
            tiles = make_tiles(scene.camera.resolution, job.seed, 1, round_)
            film = passes.render(round_)
    return tiles


def merge_seconds(scene, tiles, file):
    """Return the seconds to merge one of `tiles` into the film, and to append it to a checkpoint if `file`."""
    film_tile = render_tile(scene, tiles[0])
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder) / "checkpoint", {})
        film = PassFilm(scene.camera.resolution, 1 + max(tile.number for tile in tiles), tiles[0].round)
        begin = time.perf_counter()
        for _ in range(100):
            if file:
                store.append(film_tile)
            film.merge_tile(film_tile)
        seconds = (time.perf_counter() - begin) / 100
    return seconds


def row(name, seconds):
    """A line of the table of whole renders."""
    parts = " | ".join(f"{seconds[k]:.2f}" for k in ("total", "pilot", "fit", "render"))
    return f"| {name} | {parts} |"


if __name__ == "__main__":
    main()
