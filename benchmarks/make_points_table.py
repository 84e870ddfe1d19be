"""
What each step saves, and error against run time
================================================

Measures four steps over one light and one BRDF sample with independent points and the balance heuristic, at 128 samples
per pixel, pilot included: Sobol points, sky compensation, numbers of samples per pixel (`counts`), and shares of light
samples (`auto`). Beside them the thesis's rule, `second-moment`, the power heuristic and light samples alone. `counts`
and `auto` are measured twice, because they minimise relMSE by default, and MSE with ``error=absolute``. The rules of
the figures of error against time also have budgets from 4 to 512 samples. Scenes are the thesis's four, and those that
are held out.

One thread, CPU seconds, all rules in turns, two scenes at once. Each render is a row of docs/tables/points.csv, written
as soon as it is made; an interrupted run continues after the last. Remove the file to measure again: some 20 minutes
for each scene. `show_points` and `show_error_time` make the tables and figures.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

import show_points
from common import TABLES, options, show
from pieces import INTERIORS
from rows import read_runs, two_at_once, writer
from show_points import ABSOLUTE, AUTO, COUNTS, CSV, HELD_OUT, PINNED, PLAIN, PLAIN_SOBOL, RULES, SKY, SOBOL, SPP, TILT

import dmis
from dmis.experiment.runs import measure

BUDGETS = {4: 4, 8: 4, 16: 4, 32: 4, 64: 4, 256: 3, 512: 3}
"""Budgets of the figures beside `SPP`, and their numbers of seeds."""
LEAST = {AUTO: 16, ABSOLUTE[AUTO]: 16, TILT: 8}
"""Smallest budgets of rules that need a pilot."""
SIZES = {"veach-mis": (240, 180), "ten-lights": (200, 150), **dict.fromkeys(INTERIORS, (240, 135))}
"""Resolutions of the scenes that are not the thesis's; others have that of the file."""
MORE_SEEDS = {"killeroo-gold": 18, "interior": 18, "interior-glasses": 6, "interior-door": 6}
"""Seeds more than for other scenes, for the table of results, where few pixels have most of the error."""
REFERENCE, MORE_SAMPLES = 1024, dict.fromkeys(INTERIORS, 8192)
"""Samples per pixel of each half of a reference; more where glints in glass have most of the error."""
Plan = tuple[Sequence[str], int, int]
"""Rules that take turns, camera samples per pixel, and number of seeds."""


def plans_of(name: str, most: int) -> list[Plan]:
    """Return the plans of a scene: all rules at `SPP`, rules of the steps with more seeds, lines of the figures."""
    rules = [PINNED, SOBOL, *RULES, *ABSOLUTE.values(), *((PLAIN, PLAIN_SOBOL) if name in SKY else ())]
    steps = [PINNED, SOBOL, COUNTS, AUTO, *ABSOLUTE.values()]
    lines = [PLAIN if name in SKY else PINNED, SOBOL, TILT, AUTO, ABSOLUTE[AUTO]]
    figures = [([r for r in lines if LEAST.get(r, 0) <= n], n, min(seeds, most)) for n, seeds in BUDGETS.items()]
    return [(rules, SPP, most), (steps, SPP, most + MORE_SEEDS.get(name, 0)), *figures]


def scene_of(name: str, shrink: int = 1) -> dmis.Scene:
    """Return a scene at the resolution of the tables, or at a fraction of it."""
    width, height = SIZES.get(name) or dmis.load_scene(name).camera.resolution
    shrink *= TABLES.get(name, 1)
    return dmis.load_scene(name, resolution=(round(width / shrink), round(height / shrink)))


def run_plans(name: str, scene: dmis.Scene, plans: Sequence[Plan], csv: Path, reference_spp: int) -> None:
    """Render what the file does not have yet."""
    width, height = scene.camera.resolution
    title = f"{name} {width}×{height}"
    done = read_runs(csv).get(title, [])
    wanted = {(rule, spp, seed) for rules, spp, number in plans for rule in rules for seed in range(number)}
    if not wanted - {(run.rule, run.spp, run.seed) for run in done}:
        print(f"{title}: nothing is missing in {csv}")
        return
    reference = dmis.make_reference(scene, reference_spp, progress=show(name))
    write = writer(csv, title)
    for of_plan, spp, number in plans:
        runs = measure(
            scene,
            [(rule, spp) for rule in of_plan],
            range(number),
            reference,
            done=read_runs(csv).get(title, []),
            record=lambda run, _: write(run),
            parallel=1,
            progress=show(f"{name} {spp} spp"),
        )
        for rule, of_rule in runs.items():
            print(title, *rule, sum(run.relmse for run in of_rule) / number, flush=True)


def main() -> None:
    """Measure."""
    opts, given = options(
        __file__,
        "what points, compensation, numbers of samples and shares save, in equal time",
        seeds={"type": int, "default": 6, "help": "number of seeds at 128 samples (default 6)"},
        scenes={"nargs": "+", "default": [*TABLES, *HELD_OUT], "help": "only these scenes (default: all)"},
        csv={"type": Path, "default": CSV, "help": "rows of results (default docs/tables/points.csv)"},
    )
    writer(given.csv, "")  # the head of the file
    turns = []
    for name in given.scenes:
        reference_spp = opts.pick(16, MORE_SAMPLES.get(name, REFERENCE))
        scene = scene_of(name, opts.pick(8, 1))
        turns.append((name, scene, plans_of(name, given.seeds), given.csv, reference_spp))
    list(two_at_once(run_plans, turns))
    for ratio, interval in show_points.claims(given.csv).items():
        print(f"{ratio:70} {interval.text()}")


if __name__ == "__main__":
    main()
