"""
The tables of the reproduction, from its table of results
=========================================================

Makes the tables of docs/reproduction.md from docs/tables/reproduction.csv, a row of
which is a render of ``make_score.py``. The score of a row of ratios is

    score = sqrt(mean over scenes of ln(our ratio / the thesis's ratio)²),

where a ratio is the mean squared error of the rule over that of the balance heuristic.
0 is the thesis's table, 0.1 is off by a tenth.
"""

import csv
import itertools
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import ROOT, SCENES, options, replace_table

opts, given = options(
    __file__,
    "tables of the reproduction",
    csv={"type": Path, "help": "results (default docs/tables/reproduction.csv)"},
    page={"type": Path, "help": "gets the tables between its marks"},
)
CSV = given.csv or ROOT / "docs" / "tables" / "reproduction.csv"
MEASURES = "linear", "clipped"
OWN_ROWS = "balance", "power", "tilt", "shares"
"""Rules with rows of their own; the others are choices where the thesis is silent."""


@dataclass(frozen=True)
class Group:
    """Renders of a set-up at a size: what a row of the page's tables is about."""

    setup: str
    divisor: int = 4
    scenes: str = "shipped"

    def rows(self, scene: str, rule: str) -> dict[int, dict[str, str]]:
        """Return the rows of a scene and rule, by seed."""
        key = self.setup, self.scenes, str(self.divisor), scene, rule
        return {int(r["seed"]): r for r in RESULTS if tuple(r.values())[:5] == key}

    def seeds(self, scene: str, *rules: str) -> list[int]:
        """Return the seeds that all the rules have."""
        return sorted(set.intersection(*(set(self.rows(scene, r)) for r in rules)))

    def total(self, scene: str, rule: str, column: str, seeds: list[int]) -> float:
        """Return the sum of a column over seeds."""
        rows = self.rows(scene, rule)
        return sum(float(rows[seed][column]) for seed in seeds)

    def mse(self, scene: str, rule: str = "balance", measure: str = "linear") -> float:
        """Return the mean squared error; NaN without renders."""
        seeds = self.seeds(scene, rule)
        column = f"{measure} mse"
        return self.total(scene, rule, column, seeds) / len(seeds) if seeds else np.nan

    def slower(self, scene: str, rule: str) -> float:
        """Return CPU seconds of a rule over those of balance, medians over seeds."""
        seeds = self.seeds(scene, "balance", rule)
        seconds = [
            np.median([float(self.rows(scene, r)[seed]["seconds"]) for seed in seeds])
            for r in (rule, "balance")
        ]
        return seconds[0] / seconds[1]

    def ratio(
        self, scene: str, rule: str, measure: str = "linear", other: str = ""
    ) -> tuple[float, float, float]:
        """Return r = MSE of a rule / MSE of balance, the variance of ln r, and its
        covariance with that of the tilt; NaN without renders.

        With errors a and b of n independent blocks, the variance of ln(Σ a / Σ b) is
        Σ (a / Σ a - b / Σ b)² n / (n - 1).
        """
        seeds = self.seeds(scene, "balance", rule, *([other] if other else []))
        if not seeds:
            return np.nan, np.nan, np.nan

        def of(r: str, moment: str) -> float:
            return self.total(scene, r, f"{measure} {moment}", seeds)

        a, b = of(rule, "mse"), of("balance", "mse")
        n = self.total(scene, rule, "blocks", seeds)
        scale = n / (n - 1)
        ab, bb = of(rule, "balance") / (a * b), of("balance", "own") / b**2
        variance = scale * (of(rule, "own") / a**2 - 2 * ab + bb)
        if not other:
            return a / b, variance, np.nan
        c = of(other, "mse")
        ac, cb = of(rule, other) / (a * c), of(other, "balance") / (c * b)
        return a / b, variance, scale * (ac - ab - cb + bb)

    def cell(self, scene: str, rule: str, measure: str = "linear") -> str:
        """Return a ratio with its 95 % interval."""
        value, variance, _ = self.ratio(scene, rule, measure)
        return (
            "–"
            if np.isnan(value)
            else f"{value:.3f} ± {1.96 * value * variance**0.5:.3f}"
        )

    def score(self, *rules: str) -> str:
        """Return the score of a rule with its 95 % interval, or that of the difference
        of the scores of the tilt and another rule."""
        rng = np.random.default_rng(0)
        logs = []
        for scene in SCENES:
            ratios = [
                self.ratio(scene, r, other=rules[0] if r != rules[0] else "")
                for r in rules
            ]
            mean = np.log([ratio[0] for ratio in ratios])
            covariance = np.diag([ratio[1] for ratio in ratios])
            if len(rules) > 1:
                covariance[0, 1] = covariance[1, 0] = ratios[1][2]
            if np.isnan(mean).any():
                return "–"
            draws = rng.multivariate_normal(mean, covariance, 10_000)
            logs.append(np.concatenate([[mean], draws]))
        values = scores(np.exp(np.transpose(logs)))
        values = values[0] - values[1] if len(rules) > 1 else values[0]
        low, high = np.quantile(values[1:], (0.025, 0.975))
        return f"{values[0]:.3f} ({low:.3f} – {high:.3f})"


def scores(ratios: np.ndarray) -> np.ndarray:
    """Return the scores of ratios, whose last axis is that of the scenes."""
    told = np.array([about.equal_samples for about in SCENES.values()])
    return np.sqrt((np.log(ratios / told) ** 2).mean(axis=-1))


def publish(marks: str, head: str, lines: list[str]) -> None:
    """Print a table, and put it into the page."""
    table = [head, "|---" * (head.count("|") - 1) + "|", *lines]
    print("", *table, sep="\n", flush=True)
    if given.page is not None:
        replace_table(given.page, marks, *table)


with open(CSV, newline="", encoding="utf-8") as file:
    RESULTS = list(csv.DictReader(file))
TITLES = " | ".join(about.title for about in SCENES.values())
MAIN = [
    group
    for group in (
        Group(s, divisor) for s in ("independent", "nearest") for divisor in (1, 4)
    )
    if any(group.seeds(scene, "balance", "tilt") for scene in SCENES)
]


def size_of(group: Group, scene: str) -> str:
    """Return what a row is about: set-up, share of the side length, seeds."""
    seeds = len(group.seeds(scene, "balance", "tilt"))
    size = {1: "full", 4: "1/4"}[group.divisor]
    return f"{group.setup}, {size}, {seeds} {'seed' if seeds == 1 else 'seeds'}"


# %%
# Table 4.1: errors, ratios and seconds of both set-ups. Where points are independent
# and errors fall as 1 / time, error times CPU seconds is the error in equal time.
lines = []
for (name, about), group in itertools.product(SCENES.items(), MAIN):
    mse = group.mse(name)
    if np.isnan(mse):
        continue
    value, variance, _ = group.ratio(name, "tilt")
    covered = abs(about.equal_samples - value) <= 1.96 * value * variance**0.5
    slower = group.slower(name, "tilt")
    cells = [
        about.title,
        size_of(group, name),
        f"{mse:.2e} ({mse / about.mse:.2g})",
        f"{group.cell(name, 'tilt')} ({about.equal_samples:.3f})",
        "yes" if covered else "no",
        f"{value * slower:.3f} ({about.equal_time:.3f})",
        f"{slower - 1:+.0%} ({about.overhead:+.0%})",
        group.cell(name, "tilt", "clipped"),
        group.cell(name, "shares"),
    ]
    lines.append(f"| {' | '.join(cells)} |")
publish(
    "table 4.1",
    "| scene | set-up, side length, seeds | MSE of balance (over the thesis's) |"
    " tilt / balance (the thesis's) | covered | × CPU time (the thesis's, equal time) |"
    " more CPU time | tilt / balance, clipped | shares / balance |",
    lines,
)

# %%
# Scores, and what a score is worth: that of no effect at all, and that of the thesis's
# own other row, in equal time, whose samples are 119 in place of 122.
told = np.array([about.equal_samples for about in SCENES.values()])
equal_time = np.array([about.equal_time for about in SCENES.values()]) * 119 / 122
lines = [
    f"| {label} | {' | '.join(f'{r:.3f}' for r in row)} | {scores(row):.3f} |"
    for label, row in (
        ("thesis, equal samples", told),
        ("thesis, equal time × 119 / 122", equal_time),
        ("no effect", np.ones(4)),
    )
]
for group in MAIN:
    if np.isnan([group.mse(scene, "shares") for scene in SCENES]).any():
        continue
    label = size_of(group, "tt")
    for rule in ("tilt", "shares"):
        cells = " | ".join(group.cell(scene, rule) for scene in SCENES)
        lines.append(f"| {label}: {rule} | {cells} | {group.score(rule)} |")
    cells = " | " * len(SCENES)
    lines.append(
        f"| {label}: tilt minus shares {cells}| {group.score('tilt', 'shares')} |"
    )
publish("score", f"| ratios | {TITLES} | score |", lines)

# %%
# From one set-up to the other: errors of the balance heuristic over the thesis's.
STEPS = {
    "independent": (Group("independent"), "balance"),
    "numbers of the file": (Group("file"), "balance"),
    "pbrt-v2's points": (Group("points"), "balance"),
    "both": (Group("points-file"), "balance"),
    "both, killeroos by paths: nearest": (Group("nearest"), "balance"),
    "nearest, original meshes": (Group("nearest", 4, "original"), "balance"),
    "nearest, power heuristic": (Group("nearest"), "power"),
}
lines = []
for label, (group, rule) in STEPS.items():
    cells = []
    for name, about in SCENES.items():
        both = [group.mse(name, rule, m) / about.mse for m in MEASURES]
        cells.append("–" if np.isnan(both[0]) else "{:.2g} ({:.2g})".format(*both))
    lines.append(f"| {label} | {' | '.join(cells)} |")
publish("set-ups", f"| set-up | {TITLES} |", lines)

# %%
# Other choices where the thesis is silent, with independent points.
lines = []
group = Group("independent")
choices = [r["rule"] for r in RESULTS if r["rule"] not in OWN_ROWS]
for rule in ("tilt", *dict.fromkeys(choices)):
    cells = " | ".join(group.cell(scene, rule) for scene in SCENES)
    lines.append(
        f"| {rule.replace('tilt', 'as shipped')} | {cells} | {group.score(rule)} |"
    )
publish("choices", f"| choice | {TITLES} | score |", lines)

# %%
# The same car with and without the sun in its sky.
lines = []
for name in ("tt", "tt-overcast"):
    group = Group("independent")
    cells = [
        f"{group.mse(name):.2e}",
        group.cell(name, "tilt"),
        group.cell(name, "shares"),
    ]
    lines.append(f"| {name} | {' | '.join(cells)} |")
publish("sun", "| scene | MSE of balance | tilt / balance | shares / balance |", lines)
