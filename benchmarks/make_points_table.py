"""
Low-discrepancy points, compensation, numbers of samples, shares: what each saves
==================================================================================

Measures four steps over one light and one BRDF sample with independent points and the balance heuristic: Sobol points,
sky compensation, numbers of samples per pixel (`counts`), and shares of light samples (`auto`). Two more
rules need no pilot: the power heuristic, and light samples alone. At several budgets, pilot included, on the thesis's
four scenes and on the two that are held out: no constant was chosen on those. `counts` and `auto` are measured twice,
because they make relMSE least by default, and MSE with ``error=absolute``.

One thread, CPU seconds, all rules in turns. Each render is a row of docs/tables/points.csv, written as soon as it is
made; an interrupted run continues after the last. Remove the file to measure again: some ten minutes for each scene.
`show_points` makes the tables.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import TABLES, options, show
from rows import read_runs, writer
from show_points import ABSOLUTE, CSV, LEARNED, PINNED, PLAIN, PLAIN_SOBOL, SKY, SOBOL, UNLEARNED

import dmis
from dmis.experiment.runs import measure

BUDGETS = (128, 16, 32, 64)
BEYOND = 256
"""Budget of `SOBOL` alone, because other rules take up to twice as long."""
HELD_OUT = {"veach-mis": (240, 180), "ten-lights": (200, 150)}
"""Held-out scenes and their resolutions."""
MORE_SEEDS = {"killeroo-gold": 18}
"""Seeds more than for other scenes at 128 spp, where few pixels have most of the error."""


Plan = tuple[Sequence[str], int, int]
"""Rules that take turns, camera samples per pixel, and number of seeds."""


def plans_of(name: str, seeds: int, most: int) -> list[Plan]:
    """Return the plans of a scene."""
    rules = [PINNED, SOBOL, *UNLEARNED, *LEARNED, *ABSOLUTE.values(), *((PLAIN, PLAIN_SOBOL) if name in SKY else ())]
    of_budgets = [(rules, spp, most + MORE_SEEDS.get(name, 0) if spp == 128 else seeds) for spp in BUDGETS]
    return [([SOBOL], BEYOND, seeds), *of_budgets]


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
            done=done,
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
        seeds={"type": int, "default": 5, "help": "number of seeds (default 5)"},
        most={"type": int, "default": 6, "help": "number of seeds at 128 samples (default 6)"},
        scenes={"nargs": "+", "default": [*TABLES, *HELD_OUT], "help": "only these scenes (default: all)"},
        csv={"type": Path, "default": CSV, "help": "rows of results (default docs/tables/points.csv)"},
    )
    for name in given.scenes:
        if name in TABLES:
            scene = opts.scene(name, TABLES[name] * opts.pick(12, 1))
        else:
            width, height = HELD_OUT[name]
            scene = dmis.load_scene(name, resolution=(width // opts.pick(8, 1), height // opts.pick(8, 1)))
        run_plans(name, scene, plans_of(name, given.seeds, given.most), given.csv, opts.pick(16, 1024))


if __name__ == "__main__":
    main()
