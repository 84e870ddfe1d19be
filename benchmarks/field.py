"""Error of the default rule over the balance heuristic on scene files, in equal CPU time.

On scenes of your own, on which no constant of dmis was chosen:

    python benchmarks/field.py my-scenes kitchen/scene.pbrt room.gltf

A folder stands for the scene files in it and in its folders. Direct light, Sobol points, one thread, both rules in
turns; the reference is rendered by ``balance``. Each render is a row of the CSV file, written as soon as it is made.
The error of ``balance`` at the time of ``auto`` comes from renders of the same and of twice as many samples. A scene
takes some minutes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import show
from equal_time import equal_time_ratio
from rows import markdown, read_runs, writer
from show_points import cell

import dmis
from dmis.base.atomic_files import check_writable
from dmis.experiment.convergence import MEASURES
from dmis.experiment.runs import measure

SCENE_FILES = (".pbrt", ".gltf", ".glb", ".obj")


def scene_files(path: Path) -> Iterator[Path]:
    """Yield a file, or the scene files in a folder and its folders; pbrt files without a world belong to others."""
    if not path.is_dir():
        yield path
        return
    for file in sorted([*path.glob("*"), *path.glob("*/*")]):
        included = file.suffix == ".pbrt" and "WorldBegin" not in file.read_text("utf-8", "replace")
        if file.suffix in SCENE_FILES and not included:
            yield file


def scene_name(file: Path) -> str:
    """Return what tables call a scene file: its folder, where the file's name says nothing."""
    return file.parent.resolve().name if file.stem.startswith("scene") else file.stem


def table(csv: Path) -> list[str]:
    """Return the table of a file of results, of renders that minimise relMSE."""
    rows = []
    for scene, runs in read_runs(csv).items():
        of = {turn: [run for run in runs if (run.rule, run.spp) == turn] for turn in {(r.rule, r.spp) for r in runs}}
        balance = [of_turn for (rule, _), of_turn in of.items() if rule == "balance"]
        for spp in sorted(spp for rule, spp in of if rule == "auto"):
            cells = [cell(*equal_time_ratio(of["auto", spp], balance, measure)) for measure in MEASURES]
            worst, of_balance = (max(run.relmse for run in of[rule, spp]) for rule in ("auto", "balance"))
            rows.append([scene, str(spp), *cells, f"{worst / of_balance:.2f}"])
    heads = (f"{error} over `balance`" for error in MEASURES.values())
    return markdown(["scene", "samples", *heads, "worst seed over `balance`'s worst"], rows)


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("scenes", nargs="+", type=Path, help="scene files, or folders of them")
    parser.add_argument("--spp", nargs="+", type=int, default=[64], help="samples per pixel (default 64)")
    parser.add_argument("--seeds", type=int, default=6, help="number of seeds (default 6)")
    parser.add_argument("--resolution", nargs=2, type=int, default=(320, 180), help="pixels (default 320 180)")
    parser.add_argument("--reference", type=int, default=2048, help="samples per pixel of each half (default 2048)")
    parser.add_argument("--csv", type=Path, default="field.csv", help="new file of results (default field.csv)")
    given = parser.parse_args()
    files = [file for path in given.scenes for file in scene_files(path)]
    names = [f"{scene_name(file)} {given.resolution[0]}×{given.resolution[1]}" for file in files]
    if not files or given.seeds < 2 or given.csv.exists() or len({*names}) < len(names):
        parser.error(
            f"the scenes need files {SCENE_FILES} with names of their own, --seeds two or more, and --csv a new file; "
            f"got {names}, --seeds {given.seeds}, --csv {given.csv}{' (exists)' * given.csv.exists()}"
        )
    try:
        check_writable(given.csv)
        scenes = [dmis.load_scene(file, resolution=tuple(given.resolution)) for file in files]
    except (OSError, ValueError) as error:
        parser.error(str(error))
    for name, scene in zip(names, scenes):
        about = {"settings": dmis.Settings(integrator="direct", sampler="sobol"), "progress": show(name)}
        reference = dmis.make_reference(scene, given.reference, **about)
        turns = [turn for n in given.spp for turn in (("balance", n), ("auto", n), ("balance", 2 * n))]
        measure(
            scene, [*dict.fromkeys(turns)], given.seeds, reference, record=writer(given.csv, name), parallel=1, **about
        )
    print("\n".join(table(given.csv)))


if __name__ == "__main__":
    main()
