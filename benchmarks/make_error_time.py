"""
Error against run time of the rules that learn
==============================================

Measures the thesis's rule, both meanings of its weight, and `second-moment` on the thesis's four scenes at four
budgets, pilot included: the lines of the figure *Error against time* that `make_points_table` does not render. The
thesis's rule has independent points, `second-moment` Sobol points; all rules have their default sky compensation.

One thread, CPU seconds, all rules in turns. Each render is a row of docs/tables/error-time.csv, written as soon as it
is made; an interrupted run continues after the last. Remove the file to measure again: some 20 minutes.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, TABLES, options, show
from rows import read_runs, writer

import dmis
from dmis.experiment.runs import measure

CSV = ROOT / "docs" / "tables" / "error-time.csv"
BUDGETS = (128, 64, 32, 16)
RULES = (
    "thesis:weigh=heuristic,sampler=independent",
    "thesis:weigh=samples,sampler=independent",
    "second-moment:sampler=sobol",
)


def run_scene(scene: dmis.Scene, csv: Path, seeds: int, reference_spp: int) -> None:
    """Render what the file does not have yet."""
    width, height = scene.camera.resolution
    title = f"{scene.name} {width}×{height}"
    done = read_runs(csv).get(title, [])
    wanted = {(rule, spp, seed) for rule in RULES for spp in BUDGETS for seed in range(seeds)}
    if not wanted - {(run.rule, run.spp, run.seed) for run in done}:
        print(f"{title}: nothing is missing in {csv}")
        return
    reference = dmis.make_reference(scene, reference_spp, progress=show(scene.name))
    write = writer(csv, title)
    for spp in BUDGETS:
        measure(
            scene,
            [(rule, spp) for rule in RULES],
            range(seeds),
            reference,
            done=done,
            record=lambda run, _: write(run),
            parallel=1,
            progress=show(f"{scene.name} {spp} spp"),
        )
        print(title, spp, "done", flush=True)


def main() -> None:
    """Measure."""
    opts, given = options(
        __file__,
        "error against time of the thesis's rule and of second-moment",
        seeds={"type": int, "default": 5, "help": "number of seeds (default 5)"},
        scenes={"nargs": "+", "choices": list(TABLES), "default": list(TABLES), "help": "scenes (default: all)"},
        csv={"type": Path, "default": CSV, "help": "rows of results (default docs/tables/error-time.csv)"},
    )
    if opts.size == "quick" and given.csv == CSV:
        given.csv = opts.output.parent / CSV.name  # numbers of tiny images are not for the pages of the project
    for name in given.scenes:
        run_scene(opts.scene(name, TABLES[name] * opts.pick(12, 1)), given.csv, given.seeds, opts.pick(16, 1024))


if __name__ == "__main__":
    main()
