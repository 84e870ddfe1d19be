"""
Low-discrepancy points, numbers of samples, shares: what each saves
===================================================================

The error in equal time of three steps over one light and one BRDF sample with independent points and the balance
heuristic: Sobol points, numbers of samples per pixel (`counts`), and shares of light samples (`auto`). Two more rows
have what no pilot is needed for: the power heuristic, and light samples alone. At several budgets, pilot included, on
the thesis's four scenes and on the two that are held out: no constant was chosen on those.

The error of independent points falls as 1 / time, so over that baseline mean squared error times CPU seconds is the
ratio in equal time. Over Sobol points, whose error falls faster, it is
`equal_time_ratio`. Tables have a column for relMSE and one for MSE; in that `counts` and `auto` make the MSE least.

Each render is one line of ``docs/tables/points.csv``, written as soon as it is made; a run that was interrupted goes on
after the last. Remove the file to measure again. The first budget takes the most seeds: it is that of the thesis.

With ``--scene-dir`` the original pbrt-v2 scenes are measured instead, and have a file of their own. With ``--page
docs/tables.md`` this page gets the table of all budgets, of the shipped scenes only, and measurements.md beside it what
each step saves.
"""

import csv
import sys
from dataclasses import asdict, fields
from datetime import date
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, TABLES, machine, options, replace_table, show
from equal_time import equal_time_ratio
from front_table import write_front_table

import dmis
from dmis.experiment.convergence import MEASURES, Interval, Measure
from dmis.experiment.runs import Run, measure

PAGE = ROOT / "docs" / "tables.md"
RESULTS = ROOT / "docs" / "tables" / "points.csv"
ORIGINAL = RESULTS.with_name("points-original.csv")
"""Results of the original scenes."""
HELD_OUT = {"veach-mis": 2, "ten-lights": 2}
"""Held-out scenes, and how much smaller than by default they are rendered."""
PINNED, SOBOL = "balance:sampler=independent", "balance:sampler=sobol"
COUNTS, AUTO = "counts:sampler=sobol", "auto:sampler=sobol"
RULES = {
    PINNED: "balance, independent",
    SOBOL: "balance, Sobol",
    "pbrt:sampler=sobol": "power heuristic",
    "fixed:1,sampler=sobol": "light samples alone",
    COUNTS: "counts",
    AUTO: "auto",
}
"""Rules, and what the table calls them."""
ABSOLUTE = {rule: f"{rule},error=absolute" for rule in (COUNTS, AUTO)}
"""Rules whose MSE is measured in place of these rules'."""
STEPS = {
    "low-discrepancy points": (SOBOL, PINNED),
    "numbers of samples": (COUNTS, SOBOL),
    "shares": (AUTO, COUNTS),
    "all three": (AUTO, PINNED),
}
"""Steps from the baseline to `auto`: a rule, and the rule that it is compared with."""
MORE_SEEDS = {"killeroo-gold": 4}
"""Seeds more than for other scenes, where few pixels have most of the error."""

opts, given = options(
    __file__,
    "low-discrepancy points, numbers of samples and shares, in equal time",
    seeds={"type": int, "default": 3, "help": "number of seeds (default 3)"},
    most={"type": int, "default": 5, "help": "number of seeds at 128 samples (default 5)"},
    budgets={"type": int, "nargs": "+", "help": "camera samples per pixel (default 128 16 32 64 512)"},
    scenes={"nargs": "+", "help": "only these scenes (default: all)"},
    csv={"type": Path, "help": "results; those in it are not measured again (default: docs/tables/points.csv)"},
    page={"type": Path, "help": "docs/tables.md; it, measurements.md beside it and README get their tables"},
)
BUDGETS = given.budgets or opts.pick((32, 16), (128, 16, 32, 64, 512))
BEYOND = 2 * max(BUDGETS)
"""Budget of `SOBOL` alone, because other rules take up to twice as long."""
COLUMNS = ("scene", *(field.name for field in fields(Run)))
KIND = "" if opts.scene_dir is None else " original"
results = given.csv or (ORIGINAL if KIND else RESULTS)
names = given.scenes or [*TABLES, *(() if KIND else HELD_OUT)]

# %%
# Results of earlier runs are read, and not measured again.
kinds = {field.name: {"int": int, "float": float, "str": str}[str(field.type)] for field in fields(Run)}
kept: dict[str, list[Run]] = {}
results.parent.mkdir(parents=True, exist_ok=True)
if results.exists():
    with results.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            kept.setdefault(row.pop("scene"), []).append(Run(**{key: kinds[key](text) for key, text in row.items()}))
else:
    results.write_text(",".join(COLUMNS) + "\n", "utf-8")


def write(name: str, run: Run) -> None:
    """Add a run to the results."""
    with results.open("a", newline="", encoding="utf-8") as file:
        csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow({"scene": name, **asdict(run)})


def over(name: str, rule: str, spp: int, base: str, measure: Measure) -> Interval:
    """Return the error of a rule in equal time over that of the rule `base`; independent points need one budget."""
    budgets = [spp] if base == PINNED else [*BUDGETS, BEYOND] if base == SOBOL else BUDGETS
    if measure == "mse":
        rule, base = ABSOLUTE.get(rule, rule), ABSOLUTE.get(base, base)
    return equal_time_ratio(measured[name, rule, spp], [measured[name, base, n] for n in budgets], measure)


def cell(value: float, low: float, high: float) -> str:
    """Return a ratio and its interval, bold if all of it is below 1."""
    text = f"{value:.3f} ({low:.3f}–{high:.3f})"
    return f"**{text}**" if high < 1 else text


# %%
# One thread, CPU seconds, all rules in turns.
measured: dict[tuple[str, str, int], list[Run]] = {}
sizes, titles = {}, {}
for name in names:
    if name in TABLES:
        scene = opts.scene(name, TABLES[name] * opts.pick(12, 1))
    else:
        width, height = dmis.load_scene(name).camera.resolution
        shrink = HELD_OUT.get(name, 2) * opts.pick(8, 1)
        scene = dmis.load_scene(name, resolution=(width // shrink, height // shrink))
    sizes[name] = "×".join(map(str, scene.camera.resolution))
    titles[name] = scene.name if KIND else name
    key, done = f"{name} {sizes[name]}", kept.get(f"{name} {sizes[name]}", [])
    seeds = {
        spp: (given.most if spp == 128 else given.seeds) + MORE_SEEDS.get(name, 0) * (spp == 128) for spp in BUDGETS
    }
    rules = [*RULES, *ABSOLUTE.values()]
    seeds[BEYOND] = given.seeds
    wanted = {(rule, spp, seed) for rule in rules for spp in BUDGETS for seed in range(seeds[spp])}
    wanted |= {(SOBOL, BEYOND, seed) for seed in range(seeds[BEYOND])}
    reference = None
    if wanted - {(run.rule, run.spp, run.seed) for run in done}:
        reference = dmis.make_reference(scene, opts.pick(16, 1024), progress=show(name))
    for spp in (BEYOND, *BUDGETS):
        runs = measure(
            scene,
            [(rule, spp) for rule in (rules if spp in BUDGETS else [SOBOL])],
            range(seeds[spp]),
            reference,
            done=done,
            record=lambda run, _, key=key: write(key, run),
            parallel=1,
            progress=show(f"{name} {spp} spp"),
        )
        measured |= {(name, *budget): of for budget, of in runs.items()}
        for rule in RULES if spp in BUDGETS else ():
            ratios = (over(name, rule, spp, PINNED, measure).text() for measure in MEASURES)
            print(name, spp, RULES[rule], *ratios, flush=True)


# %%
# Ratios with 95 % intervals over seeds; bold where the interval is below 1.
def title(name: str) -> str:
    """Return the first cell of a row."""
    return f"{titles[name]} {sizes[name]}{', held out' if name in HELD_OUT else ''}"


def table() -> list[str]:
    """Return the lines of the table of all rules by scene and budget: first Sobol over independent points."""
    budgets = sorted(BUDGETS)
    lines = [
        "| scene | rule | "
        + " | ".join(f"{spp} spp, {error}" for spp in budgets for error in MEASURES.values())
        + " |",
        "|---|---|" + "---|---|" * len(budgets),
    ]
    for name in names:
        for rule in list(RULES)[1:]:
            base = PINNED if rule == SOBOL else SOBOL
            cells = [cell(*over(name, rule, spp, base, measure)) for spp in budgets for measure in MEASURES]
            told = f"{RULES[rule]} / {RULES[base]}" if rule == SOBOL else RULES[rule]
            lines.append(f"| {title(name)} | {told} | {' | '.join(cells)} |")
    return lines


def steps() -> list[str]:
    """Return the lines of the table of `STEPS`, at the budget of the most seeds."""
    titles = [f"{step}, {error}" for step in STEPS for error in MEASURES.values()]
    lines = [f"| scene | {' | '.join(titles)} |", "|---" * (1 + len(titles)) + "|"]
    for name in names:
        pairs = [(*step, measure) for step in STEPS.values() for measure in MEASURES]
        cells = [cell(*over(name, rule, BUDGETS[0], base, measure)) for rule, base, measure in pairs]
        lines.append(f"| {title(name)} | {' | '.join(cells)} |")
    return lines


number = f"{given.seeds} seeds ({given.most} or more at 128 spp)"
about = f"Made on {date.today()} with {number}, one thread, on {machine()}."
for page, mark, lines in (("tables.md", "points", table()), ("measurements.md", f"steps{KIND}", steps())):
    print("", about, "", *lines, sep="\n")
    if given.page is not None and (mark != "points" or not KIND):
        replace_table(given.page.with_name(page), mark, about, "", *lines)

# %%
# For README, what `auto` saves at 128 samples.
if given.page is not None and given.page.resolve() == PAGE and 128 in BUDGETS and not KIND:
    write_front_table()
