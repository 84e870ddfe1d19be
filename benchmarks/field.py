"""Error of the default rule over the balance heuristic on scene files, in equal CPU time.

On scenes of your own, on which no constant of dmis was chosen:

    python benchmarks/field.py my-scenes kitchen/scene.pbrt room.gltf

A folder stands for the scene files in it and in its folders. Direct light, Sobol points, one thread, both rules in
turns; the reference is rendered by ``balance``. Each render is a row of the CSV file, written as soon as it is made; an
interrupted run continues. A scene takes some minutes. `tables` makes the table of docs/measurements.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, show
from equal_time import equal_time_ratio
from rows import markdown, read_runs, writer
from show_points import cell

import dmis
from dmis.experiment.convergence import MEASURES
from dmis.experiment.runs import Run, measure

CSV = ROOT / "docs" / "tables" / "field.csv"
SCENE_FILES = (".pbrt", ".gltf", ".glb", ".obj")
RULES = ("balance", "auto")


def scene_files(path: Path) -> Iterator[Path]:
    """Yield a file, or the scene files in a folder and its folders; pbrt files without a world belong to others."""
    if not path.is_dir():
        yield path
        return
    for file in sorted([*path.glob("*"), *path.glob("*/*")]):
        if file.suffix in SCENE_FILES and (
            file.suffix != ".pbrt" or "WorldBegin" in file.read_text("utf-8", "replace")
        ):
            yield file


def scene_name(file: Path) -> str:
    """Return what tables call a scene file: its folder, where the file's name says nothing."""
    return file.parent.resolve().name if file.stem.startswith("scene") else file.stem


def row(scene: str, of_auto: Sequence[Run], of_balance: Sequence[Run]) -> list[str]:
    """Return the cells of a scene."""
    equal_time = [cell(*equal_time_ratio(of_auto, [of_balance], measure)) for measure in MEASURES]
    errors, baseline = (np.array([run.relmse for run in runs]) for runs in (of_auto, of_balance))
    per_ray = np.median([a.cpu_seconds / a.rays / (b.cpu_seconds / b.rays) for a, b in zip(of_auto, of_balance)])
    tail = f"{errors.max() / baseline.max():.2f}", f"{errors.max() / np.median(errors):.2f}"
    return [scene, str(of_auto[0].spp), *equal_time, *tail, f"{per_ray:.2f}"]


def tables(csv: Path = CSV) -> dict[str, list[str]]:
    """Return the lines of the block."""
    head = ("scene", "samples", *(f"{error}, equal time" for error in MEASURES.values()))
    rows = []
    for scene, runs in read_runs(csv).items():
        for spp in sorted({run.spp for run in runs}):
            auto, balance = ([run for run in runs if (run.rule, run.spp) == (rule, spp)] for rule in RULES[::-1])
            rows.append(row(scene, auto, balance))
    more = ("worst seed over `balance`'s worst", "worst seed over median", "CPU per ray")
    return {"measurements.md: field": markdown((*head, *more), rows)}


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("scenes", nargs="+", type=Path, help="scene files, or folders of them")
    parser.add_argument("--spp", nargs="+", type=int, default=[64], help="samples per pixel (default 64)")
    parser.add_argument("--seeds", type=int, default=6, help="number of seeds (default 6)")
    parser.add_argument("--resolution", nargs=2, type=int, default=(320, 180), help="pixels (default 320 180)")
    parser.add_argument("--reference", type=int, default=2048, help="samples per pixel of each half (default 2048)")
    parser.add_argument("--csv", type=Path, default=CSV, help="rows of results (default docs/tables/field.csv)")
    given = parser.parse_args()
    settings = dmis.Settings(integrator="direct", sampler="sobol")
    for file in [file for path in given.scenes for file in scene_files(path)]:
        scene = dmis.load_scene(file, resolution=tuple(given.resolution))
        name = scene_name(file)
        title = f"{name} {given.resolution[0]}×{given.resolution[1]}"
        reference = dmis.make_reference(scene, given.reference, settings=settings, progress=show(name))
        write = writer(given.csv, title)
        measure(
            scene,
            [(rule, spp) for spp in given.spp for rule in RULES],
            given.seeds,
            reference,
            done=read_runs(given.csv).get(title, []),
            record=lambda run, _: write(run),  # noqa: B023 - called in this turn of the loop alone
            parallel=1,
            settings=settings,
            progress=show(name),
        )
    print("\n".join(tables(given.csv)["measurements.md: field"]))


if __name__ == "__main__":
    main()
