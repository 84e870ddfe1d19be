"""
The tables of docs/paths.md
===========================

What rules save in path tracing, five surfaces deep, on the thesis's scenes and on the box of colours: relMSE and MSE
times CPU seconds, pilot included, over those of the balance heuristic with independent points. Beside it the
oracle, which knows what shares and numbers of samples could save. One thread, rules in turns. Takes about half an hour;
the result is kept with the project.
"""

import sys
from datetime import date
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, TABLES, bold, machine, options, replace_table, show

import dmis
from dmis.experiment.convergence import MEASURES
from dmis.experiment.metrics import ratio
from dmis.experiment.oracle_renders import make_oracle
from dmis.experiment.runs import measure

PAGE = ROOT / "docs" / "paths.md"
PINNED = "balance:sampler=independent"
RULES = {
    "second-moment:sampler=independent": "second-moment, independent",
    "balance:sampler=sobol": "balance, Sobol",
    "counts:sampler=sobol": "counts",
    "auto:sampler=sobol": "auto",
}
"""Rules, and what the table calls them."""
ABSOLUTE = {rule: f"{rule},error=absolute" for rule in ("counts:sampler=sobol", "auto:sampler=sobol")}
"""Rules whose MSE is measured in place of these rules'."""
MORE_SEEDS = {"cornell": 3, "killeroo-gold": 3}
"""Seeds more than for other scenes, where few paths have most of the error."""

opts, given = options(
    __file__,
    "rules in path tracing against the balance heuristic and the oracle",
    seeds={"type": int, "default": 5, "help": "number of seeds (default 5)"},
    page={"type": Path, "default": PAGE, "help": "the page whose tables are replaced"},
)
SPP = opts.pick(16, 64)
PATHS = dmis.Settings(integrator="path", max_depth=5)


# %%
# One thread, CPU seconds, all rules in turns.
efficient, bounds = [], []
for name in ("cornell", *TABLES):
    if name == "cornell":
        scene = dmis.load_scene(name, resolution=opts.pick((16, 16), (200, 200)))
    else:
        scene = opts.scene(name, TABLES[name] * opts.pick(8, 1))
    about = {"settings": PATHS, "parallel": 1}
    reference = dmis.make_reference(scene, opts.pick(32, 512), progress=show("reference"), **about)
    seeds = range(given.seeds + MORE_SEEDS.get(name, 0))
    budgets = [(rule, SPP) for rule in (PINNED, *RULES, *ABSOLUTE.values())]
    runs = measure(scene, budgets, seeds, reference, progress=show(name), **about)
    efficiency = {
        (rule, measure): np.array([getattr(run, measure) * run.cpu_seconds for run in runs[rule, spp]])
        for rule, spp in budgets
        for measure in MEASURES
    }
    width, height = scene.camera.resolution
    row = f"| {scene.name} {width}×{height} |"
    columns = [(ABSOLUTE.get(rule, rule) if m == "mse" else rule, m) for rule in RULES for m in MEASURES]
    cells = [f"{bold(*ratio(efficiency[rule, m], efficiency[PINNED, m]))} |" for rule, m in columns]
    efficient.append(" ".join([row, *cells]))
    print(efficient[-1], flush=True)
    strong = "balance:sampler=sobol"
    print(
        "over balance with Sobol points:",
        *(f"{r} {m} {ratio(efficiency[r, m], efficiency[strong, m])}" for r, m in columns),
    )
    oracle = make_oracle(scene, opts.pick(16, 256), progress=show("oracle"), **about)
    limits = oracle.limit(), oracle.spread_evenly(), oracle.limit_with_counts()
    bounds.append(" ".join([row, *(f"{limit:.3f} |" for limit in limits)]))
    print(bounds[-1], flush=True)

# %%
# The tables go between two marks in the page.
replace_table(
    given.page,
    f"paths {'original' if opts.scene_dir else 'shipped'}",
    f"Made on {date.today()} with {given.seeds} seeds ({given.seeds + 3} of cornell and killeroo-gold), {SPP} samples "
    f"per pixel, five surfaces deep, on {machine()}.",
    "",
    f"| scene | {' | '.join(f'{rule}, {error}' for rule in RULES.values() for error in MEASURES.values())} |",
    "|---" * (2 * len(RULES) + 1) + "|",
    *efficient,
    "",
    "What the oracle could save at equal samples with independent points; in the last column in equal time, by the "
    "cost model, no pilot:",
    "",
    "| scene | weights | numbers of samples, at w = ½ | weights and numbers, equal time |",
    "|---|---|---|---|",
    *bounds,
)
