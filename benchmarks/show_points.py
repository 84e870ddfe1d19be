"""Tables of README and docs/results.md from the rows of make_points_table.py and against_mitsuba.py."""

from __future__ import annotations

import math
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
PLAIN, PLAIN_SOBOL = "balance:sampler=independent,compensation=0", "balance:sampler=sobol,compensation=0"
PINNED, SOBOL = "balance:sampler=independent", "balance:sampler=sobol"
COUNTS, AUTO = "counts:sampler=sobol", "auto:sampler=sobol"
ABSOLUTE = {rule: f"{rule},error=absolute" for rule in (COUNTS, AUTO)}
"""Rules whose MSE is measured in place of these rules'."""
UNLEARNED = {"pbrt:sampler=sobol": "power heuristic", "fixed:1,sampler=sobol": "light samples alone"}
"""Rules without a pilot, and what tables call them."""
TILT, SHARES = (f"thesis:weigh={w},sampler=independent" for w in ("heuristic", "samples"))
SECOND_MOMENT = "second-moment:sampler=sobol"
RULES = (*UNLEARNED, COUNTS, AUTO, TILT, SHARES, SECOND_MOMENT)
"""Rules that are compared with `balance` with Sobol points."""
STEPS = {
    "Sobol / independent points": (PLAIN_SOBOL, PLAIN),
    "sky compensation": (SOBOL, PLAIN_SOBOL),
    "numbers of samples": (COUNTS, SOBOL),
    "learned shares": (AUTO, COUNTS),
}
"""Steps from the thesis's baseline to `auto`: a rule, and the rule that it is compared with."""
SKY = ("tt",)
"""Scenes with a sky: on the others compensation changes no bit, and is not rendered."""
HELD_OUT = ("veach-mis", "ten-lights", "interior", "interior-glasses", "interior-door")
SPP = 128
"""Budget of the steps and of README."""
FEW = (16, 32, 64, SPP)
"""Budgets of the table of losses."""
HEAD = (
    *("scene", "relMSE over `balance`", "MSE over `balance`", "relMSE over independent points"),
    *("relMSE over Mitsuba's best", "MSE over Mitsuba's best", "worst seed over `balance`'s worst"),
)
"""Columns of the table of results."""


@cache
def measured(csv: Path | None = None) -> dict[str, dict[tuple[str, int], list[Run]]]:
    """Return the runs of each scene by rule and samples per pixel; those without a sky stand for both settings."""
    scenes: dict[str, dict[tuple[str, int], list[Run]]] = {}
    order = (*FOUR, *HELD_OUT)
    for scene, runs in sorted(read_runs(csv or CSV).items(), key=lambda item: order.index(item[0].split()[0])):
        of_scene = scenes.setdefault(scene, {})
        for run in runs:
            of_scene.setdefault((run.rule, run.spp), []).append(run)
        if scene.split()[0] not in SKY:
            for plain, rule in ((PLAIN, PINNED), (PLAIN_SOBOL, SOBOL)):
                of_scene |= {(plain, spp): runs for (name, spp), runs in of_scene.items() if name == rule}
    return scenes


def over(scene: str, rule: str, base: str, measure: Measure, spp: int = SPP, csv: Path | None = None) -> Interval:
    """Return the error of a rule over that of another in equal CPU time.

    That of independent points falls as 1 / time, and needs one budget.
    """
    runs = measured(csv)[scene]
    if measure == "mse":
        rule, base = ABSOLUTE.get(rule, rule), ABSOLUTE.get(base, base)
    budgets = [of for (name, n), of in runs.items() if name == base and (n == spp or base not in (PLAIN, PINNED))]
    return equal_time_ratio(runs[rule, spp], budgets, measure)


def cell(value: float, low: float, high: float) -> str:
    """Return a ratio and its interval, bold if all of it is below 1; dashes where there are too few seeds for them."""
    if math.isnan(value):
        return "–"
    if not high <= 100 * low:
        return f"{value:.3f} (–)"
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


def losses() -> list[str]:
    """Return the table of `auto` where an interval at some budget lies above 1."""
    rows = []
    for measure, error in MEASURES.items():
        for scene in measured():
            ratios = [over(scene, AUTO, SOBOL, measure, spp) for spp in FEW]
            if any(ratio.low > 1 for ratio in ratios):
                rows.append([f"{title(scene)}, {error}", *(cell(*ratio) for ratio in ratios)])
    return markdown(["scene, error", *(f"{spp} samples" for spp in FEW)], rows)


def over_mitsuba(scene: str, measure: Measure) -> str:
    """Return the error of `auto` over that of Mitsuba's best set-up: by `balance`, which both were compared with.

    The ratio of `balance` and Mitsuba was measured on another machine; a dash where there is none.
    """
    best = show_mitsuba.best(read_rows(show_mitsuba.ERRORS), scene.split()[0], measure)
    if best is None:
        return "–"
    ours, theirs = over(scene, AUTO, SOBOL, measure), float(best["ratio"])
    # variances of the logarithms of the two ratios add up
    half = math.hypot(math.log(ours.high / ours.low) / 2, float(best["half"]) / theirs)
    value = ours.value * theirs
    return cell(value, value * math.exp(-half), value * math.exp(half))


def results() -> list[str]:
    """Return the table of `auto` over the balance heuristic and over Mitsuba's best set-up, on all scenes."""
    rows = []
    for scene, runs in measured().items():
        cells = [cell(*over(scene, AUTO, SOBOL, measure)) for measure in MEASURES]
        cells.append(cell(*over(scene, AUTO, PLAIN, "relmse")))
        cells += [over_mitsuba(scene, measure) for measure in MEASURES]
        worst, of_balance = (max(run.relmse for run in runs[rule, SPP]) for rule in (AUTO, SOBOL))
        rows.append([title(scene), *cells, f"{worst / of_balance:.2f}"])
    return markdown(HEAD, rows)


def front() -> list[str]:
    """Return the table of README: `auto` over the balance heuristic with the same settings, and over Mitsuba's best."""
    rows = []
    for scene in measured():
        cells = [cell(*over(scene, AUTO, SOBOL, measure)) for measure in MEASURES]
        rows.append([title(scene), *cells, over_mitsuba(scene, "relmse")])
    heads = ("`auto`: relMSE over `balance`", "`auto:error=absolute`: MSE over `balance`")
    return markdown(["scene", *heads, "`auto`: relMSE over Mitsuba's best sampler"], rows)


def claims(csv: Path | None = None) -> dict[str, Interval]:
    """Return what `auto` leaves of the errors of `balance`, and each of the `STEPS` of those of the step before."""
    pairs = {"auto / independent points": (AUTO, PLAIN, SPP), **{name: (*pair, SPP) for name, pair in STEPS.items()}}
    pairs |= {f"auto / balance at {spp}": (AUTO, SOBOL, spp) for spp in FEW}
    return {
        f"{scene}, {name}, {error}": over(scene, rule, base, measure, spp, csv)
        for scene in measured(csv)
        for name, (rule, base, spp) in pairs.items()
        for measure, error in MEASURES.items()
        if name != "sky compensation" or scene.split()[0] in SKY
    }


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
    few = [[run.overhead / run.seconds for run in of[AUTO, FEW[0]]] for of in measured().values()]
    overhead = sorted(100 * median(of_scene) for of_scene in few)
    return {
        "README.md": [
            f"{saved['relmse'][0]:.0f} to {saved['relmse'][-1]:.0f} %",
            f"{saved['mse'][0]:.0f} to {saved['mse'][-1]:.0f} % on all nine",
            f"`auto` has {thesis[0]:.0f} to {thesis[-1]:.0f} % of the relMSE of this baseline",
        ],
        "results.md": [
            "lowers the relMSE of `balance` by {:.0f} to {:.0f} %".format(saved["relmse"][0], saved["relmse"][-1]),
            "the MSE by {:.0f} to {:.0f} %".format(saved["mse"][0], saved["mse"][-1]),
            f"{overhead[0]:.0f} to {overhead[-1]:.0f} % of the time of `auto` at {FEW[0]} samples",
            f"On KILLEROO GOLD `auto` has {of_gold.text()} times the relMSE",
            f"The worst seed has {max(errors) / median(errors):.2f} times the median error",
        ],
    }
