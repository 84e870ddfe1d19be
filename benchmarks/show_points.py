"""Tables of README and docs/results.md from the rows of make_points_table.py, field.py and against_mitsuba.py."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from statistics import median

import show_mitsuba
from common import ROOT
from equal_time import equal_time_ratio
from pieces import FOUR
from rows import markdown, read_rows, read_runs

from dmis.experiment.convergence import MEASURES, Interval, Measure
from dmis.experiment.runs import Run

CSV = ROOT / "docs" / "tables" / "points.csv"
FIELD = CSV.with_name("field.csv")
PLAIN, PLAIN_SOBOL = "balance:sampler=independent,compensation=0", "balance:sampler=sobol,compensation=0"
PINNED, SOBOL = "balance:sampler=independent", "balance:sampler=sobol"
COUNTS, AUTO = "counts:sampler=sobol", "auto:sampler=sobol"
ABSOLUTE = {rule: f"{rule},error=absolute" for rule in (COUNTS, AUTO)}
"""Rules whose MSE is measured in place of these rules'."""
UNLEARNED = {"pbrt:sampler=sobol": "power heuristic", "fixed:1,sampler=sobol": "light samples alone"}
LEARNED = {COUNTS: "`counts`", AUTO: "`auto`"}
"""Rules that are compared with `balance` with Sobol points, and what tables call them."""
STEPS = {
    "Sobol / independent points": (PLAIN_SOBOL, PLAIN),
    "sky compensation": (SOBOL, PLAIN_SOBOL),
    "numbers of samples": (COUNTS, SOBOL),
    "learned shares": (AUTO, COUNTS),
}
"""Steps from the thesis's baseline to `auto`: a rule, and the rule that it is compared with."""
SKY = ("tt",)
"""Scenes with a sky: on the others compensation changes no bit, and is not rendered."""
HELD_OUT = ("veach-mis", "ten-lights")
SPP = 128
"""Budget of the steps and of README."""
HEAD = ("scene", "relMSE over `balance`", "MSE over `balance`", "worst seed over `balance`'s worst")
"""Columns of `field_rows`."""
BESIDE = ("relMSE over independent points", "relMSE over Mitsuba's best", "MSE over Mitsuba's best")
"""Columns that the table of results has beside these, in front of the last one."""


@cache
def measured() -> dict[str, dict[tuple[str, int], list[Run]]]:
    """Return the runs of each scene by rule and samples per pixel; those without a sky stand for both settings."""
    scenes: dict[str, dict[tuple[str, int], list[Run]]] = {}
    order = (*FOUR, *HELD_OUT)
    for scene, runs in sorted(read_runs(CSV).items(), key=lambda item: order.index(item[0].split()[0])):
        of_scene = scenes.setdefault(scene, {})
        for run in runs:
            of_scene.setdefault((run.rule, run.spp), []).append(run)
        if scene.split()[0] not in SKY:
            for plain, rule in ((PLAIN, PINNED), (PLAIN_SOBOL, SOBOL)):
                of_scene |= {(plain, spp): runs for (name, spp), runs in of_scene.items() if name == rule}
    return scenes


def over(scene: str, rule: str, base: str, measure: Measure, spp: int = SPP) -> Interval:
    """Return the error of a rule over that of another in equal CPU time.

    That of independent points falls as 1 / time, and needs one budget.
    """
    runs = measured()[scene]
    if measure == "mse":
        rule, base = ABSOLUTE.get(rule, rule), ABSOLUTE.get(base, base)
    budgets = [of for (name, n), of in runs.items() if name == base and (n == spp or base not in (PLAIN, PINNED))]
    return equal_time_ratio(runs[rule, spp], budgets, measure)


def cell(value: float, low: float, high: float) -> str:
    """Return a ratio and its interval, bold if all of it is below 1."""
    text = f"{value:.3f} ({low:.3f}–{high:.3f})"
    return f"**{text}**" if high < 1 else text


def title(scene: str) -> str:
    """Return the first cell of a row."""
    return f"{scene}, held out" if scene.split()[0] in HELD_OUT else scene


def steps(measure: Measure) -> list[str]:
    """Return the table of `STEPS` by a measure; a dash where a step changes nothing."""
    rows = []
    for scene in measured():
        skies = scene.split()[0] in SKY
        pairs = [("–" if name == "sky compensation" and not skies else pair) for name, pair in STEPS.items()]
        rows.append([title(scene), *(p if isinstance(p, str) else cell(*over(scene, *p, measure)) for p in pairs)])
    means = ["–" if name == "sky compensation" else f"{mean_of(name, measure):.3f}" for name in STEPS]
    return markdown([MEASURES[measure], *STEPS], [*rows, ["geometric mean", *means]])


def budgets() -> list[int]:
    """Return the numbers of samples per pixel of all rules."""
    return sorted({spp for of in measured().values() for rule, spp in of if rule == AUTO})


def losses() -> list[str]:
    """Return the table of the rules that learn where an interval at some budget lies above 1."""
    rows = []
    for rule in reversed(LEARNED):
        for measure, error in MEASURES.items():
            for scene in measured():
                ratios = [over(scene, rule, SOBOL, measure, spp) for spp in budgets()]
                if any(ratio.low > 1 for ratio in ratios):
                    rows.append([f"{LEARNED[rule]}, {scene.split()[0]}, {error}", *(cell(*ratio) for ratio in ratios)])
    return markdown(["rule, scene, error", *(f"{spp} samples" for spp in budgets())], rows)


def worst(of_auto: Sequence[Run], of_balance: Sequence[Run]) -> str:
    """Return the largest relMSE of `auto` over that of `balance`."""
    return f"{max(run.relmse for run in of_auto) / max(run.relmse for run in of_balance):.2f}"


def field_rows(csv: Path) -> list[list[str]]:
    """Return the rows of scene files: `HEAD` of renders that minimise relMSE."""
    rows = []
    for scene, runs in read_runs(csv).items():
        for spp in sorted({run.spp for run in runs}):
            auto = [run for run in runs if (run.rule, run.spp) == ("auto", spp)]
            balance = [run for run in runs if (run.rule, run.spp) == ("balance", spp)]
            cells = [cell(*equal_time_ratio(auto, [balance], measure)) for measure in MEASURES]
            rows.append([f"{scene}, {spp} samples", *cells, worst(auto, balance)])
    return rows


def results() -> list[str]:
    """Return the table of `auto` over the balance heuristic and over Mitsuba's best set-up, on all scenes."""
    mitsuba = read_rows(show_mitsuba.ERRORS)
    rows = []
    for scene, runs in measured().items():
        cells = [cell(*over(scene, AUTO, SOBOL, measure)) for measure in MEASURES]
        cells.append(cell(*over(scene, AUTO, PLAIN, "relmse")))
        for measure in MEASURES:
            best = show_mitsuba.best(mitsuba, scene.split()[0], "auto", measure)
            cells.append("–" if best is None else show_mitsuba.cell(best))
        rows.append([title(scene), *cells, worst(runs[AUTO, SPP], runs[SOBOL, SPP])])
    rows += [[*row[:-1], *("–" for _ in BESIDE), row[-1]] for row in field_rows(FIELD)]
    return markdown([*HEAD[:-1], *BESIDE, HEAD[-1]], rows)


def front() -> list[str]:
    """Return the table of README: `auto` over the balance heuristic with the same settings, and over Mitsuba's best."""
    mitsuba = read_rows(show_mitsuba.ERRORS)
    rows = []
    for scene in measured():
        best = show_mitsuba.best(mitsuba, scene.split()[0], "auto", "relmse")
        cells = [cell(*over(scene, AUTO, SOBOL, measure)) for measure in MEASURES]
        rows.append([title(scene), *cells, "–" if best is None else show_mitsuba.cell(best)])
    heads = ("`auto`: relMSE over `balance`", "`auto:error=absolute`: MSE over `balance`")
    return markdown(["scene", *heads, "`auto`: relMSE over Mitsuba's best sampler"], rows)


def tables() -> dict[str, list[str]]:
    """Return the lines of the blocks."""
    return {
        "README.md: equal time": front(),
        "results.md: results": results(),
        "results.md: losses": losses(),
        "results.md: steps": [*steps("relmse"), "", *steps("mse")],
    }


def mean_of(step: str, measure: Measure) -> float:
    """Return the geometric mean of a step over the scenes that it concerns."""
    scenes = [s for s in measured() if step != "sky compensation" or s.split()[0] in SKY]
    return math.exp(sum(math.log(over(scene, *STEPS[step], measure).value) for scene in scenes) / len(scenes))


def sentences() -> dict[str, list[str]]:
    """Return fragments of prose with numbers, by page."""
    won = {m: [over(scene, AUTO, SOBOL, m) for scene in measured()] for m in MEASURES}
    saved = {m: sorted(100 * (1 - ratio.value) for ratio in ratios if ratio.high < 1) for m, ratios in won.items()}
    thesis = sorted(100 * over(scene, AUTO, PLAIN, "relmse").value for scene in measured())
    (gold,) = (scene for scene in measured() if scene.startswith("killeroo-gold"))
    of_gold, errors = over(gold, AUTO, SOBOL, "relmse"), [run.relmse for run in measured()[gold][AUTO, SPP]]
    few = [[run.overhead / run.seconds for run in of[AUTO, budgets()[0]]] for of in measured().values()]
    overhead = sorted(100 * median(of_scene) for of_scene in few)
    return {
        "README.md": [
            f"{saved['relmse'][0]:.0f} to {saved['relmse'][-1]:.0f} %",
            f"{saved['mse'][0]:.0f} to {saved['mse'][-1]:.0f} % on all six",
            f"`auto` has {thesis[0]:.0f} to {thesis[-1]:.0f} % of the relMSE of this baseline",
        ],
        "results.md": [
            "lowers the relMSE of `balance` by {:.0f} to {:.0f} %".format(saved["relmse"][0], saved["relmse"][-1]),
            "the MSE by {:.0f} to {:.0f} %".format(saved["mse"][0], saved["mse"][-1]),
            f"{overhead[0]:.0f} to {overhead[-1]:.0f} % of the time of `auto` at {budgets()[0]} samples",
            f"On KILLEROO GOLD `auto` has {of_gold.text()} times the relMSE",
            f"The worst seed has {max(errors) / median(errors):.2f} times the median error",
        ],
    }
