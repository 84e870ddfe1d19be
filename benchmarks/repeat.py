"""Repeat the numbers of README and docs/results.md in half an hour: three seeds, wide intervals, the same signs.

    python benchmarks/repeat.py         (or: make publish QUICK=1)

Renders at the full resolution what the ratios of `auto`, at all budgets of the table of losses, and of each step need,
two scenes at once, and prints each ratio beside the published one. A published ratio is not repeated if its interval
and that of the new ratio, with an allowance for CPU seconds, do not meet, or if one says that a rule wins and the other
that it loses. Exit code 1 if there is such a ratio.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "examples")]

import show_paths
import show_points
from rows import two_at_once, writer

from dmis.experiment.convergence import Interval

# flat scripts, which the type checker leaves out
points, paths = (import_module(f"make_{kind}_table") for kind in ("points", "path"))
SEEDS = 3
FEWER = 4
"""How many times fewer samples the references of paths, and of scenes with many, have than for the tables."""
SECONDS = 1.15
"""Factor by which two runs may differ in CPU seconds, which no interval over seeds contains."""


def render(kind: str, name: str, csv: Path) -> str:
    """Render a scene of ``points`` or ``paths``, and return its name."""
    scene, reference = points.scene_of(name), points.MORE_SAMPLES.get(name, FEWER * points.REFERENCE) // FEWER
    if kind == "paths":
        needed = "roulette", "lights", "auto", "auto, absolute"
        variants = [variant for variant in paths.VARIANTS if variant.label in needed]
        paths.run_scene(name, scene, csv, SEEDS, paths.SPP, paths.REFERENCE // FEWER, variants, ())
        return f"{name} by paths"
    rules = [show_points.PINNED, show_points.SOBOL, show_points.COUNTS, show_points.AUTO]
    rules += show_points.ABSOLUTE.values()
    rules += [show_points.PLAIN, show_points.PLAIN_SOBOL] if name in show_points.SKY else []
    auto = [show_points.SOBOL, show_points.AUTO, show_points.ABSOLUTE[show_points.AUTO]]
    plans = [(rules, show_points.SPP, SEEDS), (auto[:1], 2 * show_points.SPP, SEEDS)]
    plans += [(auto, spp, SEEDS) for spp in show_points.FEW[:-1]]
    points.run_plans(name, scene, plans, csv, reference)
    return name


def contradicts(old: Interval, new: Interval) -> bool:
    """Return whether two intervals do not meet, times being uncertain, or lie on the two sides of 1."""
    apart = SECONDS * old.high < new.low or SECONDS * new.high < old.low
    return apart or (old.high < 1 < new.low) or (new.high < 1 < old.low)


def compare(published: Mapping[str, Interval], repeated: Mapping[str, Interval]) -> Iterator[str]:
    """Print each ratio of both, and yield the names of those that contradict each other."""
    for name, new in repeated.items():
        wrong = contradicts(published[name], new)
        print(f"{name:70} {published[name].text():25} {new.text():25} {'NOT REPEATED' if wrong else ''}")
        if wrong:
            yield name


def main(arguments: Sequence[str] | None = None) -> int:
    """Render, compare, and return the exit code."""
    argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0]).parse_args(arguments)
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        files = {kind: Path(folder) / f"{kind}.csv" for kind in ("points", "paths")}
        for csv in files.values():
            writer(csv, "")  # its head
        scenes = {"points": [name.split()[0] for name in show_points.measured()], "paths": show_paths.SCENES}
        turns = [(kind, name, files[kind]) for kind, names in scenes.items() for name in names]
        for done in two_at_once(render, turns):
            print(done, flush=True)
        for module, csv in zip((show_points, show_paths), files.values(), strict=True):
            wrong += compare(module.claims(), module.claims(csv))
    print(f"not repeated: {', '.join(wrong) or 'none'}")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
