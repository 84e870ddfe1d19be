"""
The tables of the reproduction, from its table of results
=========================================================

Makes the tables of docs/thesis.md from files of docs/tables:
``reproduction.csv``, a row of which is a render of ``make_score.py``;
``reproduction-full.csv``, results of three seeds at the thesis's resolution by commit
c8bbb91; ``floors.csv`` of ``make_floors.py``; ``sun.csv``, results of ``compare`` by
commit 52d6d75. The score of a row of ratios is

    score = sqrt(mean over scenes of ln(our ratio / the thesis's ratio)²),

where a ratio is the mean squared error of the rule over that of the balance heuristic.
0 is the thesis's table, 0.1 is off by a tenth.
"""

import csv
import itertools
import re
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import ROOT, SCENES, replace_tables

TABLES = ROOT / "docs" / "tables"
CSV, ORIGINAL = (TABLES / f"reproduction{of}.csv" for of in ("", "-original"))
"""Rows of the scenes that come with dmis, and of the public pbrt-v2 files."""
MEASURES = "linear", "clipped"
OWN_ROWS = "balance", "power", "tilt", "shares"
"""Rules with rows of their own; the others are choices where the thesis is silent."""


def read(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table."""
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@cache
def measured() -> list[dict[str, str]]:
    """Return the rows of `CSV` and `ORIGINAL`."""
    return [*read(CSV), *read(ORIGINAL)]


FULL = {row["scene"]: row for row in read(TABLES / "reproduction-full.csv")}


@dataclass(frozen=True)
class Group:
    """Renders of a set-up at a size: what a row of the page's tables is about."""

    setup: str
    divisor: int = 4
    scenes: str = "shipped"
    below: int = 100  # seeds

    def rows(self, scene: str, rule: str) -> dict[int, dict[str, str]]:
        """Return the rows of a scene and rule, by seed."""
        key = self.setup, self.scenes, str(self.divisor), scene, rule
        rows = {int(r["seed"]): r for r in measured() if tuple(r.values())[:5] == key}
        return {seed: row for seed, row in rows.items() if seed < self.below}

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

    def seconds(self, scene: str, rule: str) -> float:
        """Return CPU seconds at the thesis's size, median over seeds."""
        rows = self.rows(scene, rule).values()
        return np.median([float(row["seconds"]) for row in rows]) * self.divisor**2

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
        half = 1.96 * value * variance**0.5
        return "–" if np.isnan(value) else f"{value:.3f} ± {half:.3f}"

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
                covariance[0, 1] = covariance[1, 0] = np.nan_to_num(ratios[1][2])
            if np.isnan(mean).any():
                return "–"
            draws = rng.multivariate_normal(mean, covariance, 10_000)
            logs.append(np.concatenate([[mean], draws]))
        values = scores(np.exp(np.transpose(logs)))
        values = values[0] - values[1] if len(rules) > 1 else values[0]
        low, high = np.quantile(values[1:], (0.025, 0.975))
        return f"{values[0]:.3f} ({low:.3f} – {high:.3f})"


class Full(Group):
    """Results at the thesis's resolution: independent points, no clipped errors, and no
    covariances."""

    def seeds(self, scene: str, *rules: str) -> list[int]:
        return [0, 1, 2]

    def mse(self, scene: str, rule: str = "balance", measure: str = "linear") -> float:
        return float(FULL[scene]["mse"])

    def seconds(self, scene: str, rule: str) -> float:
        more = float(FULL[scene]["more time"]) if rule == "tilt" else 0
        return float(FULL[scene]["seconds"]) * (1 + more)

    def ratio(
        self, scene: str, rule: str, measure: str = "linear", other: str = ""
    ) -> tuple[float, float, float]:
        if measure == "clipped":
            return np.nan, np.nan, np.nan
        value, half = (float(FULL[scene][key]) for key in (rule, f"{rule} half"))
        return value, (half / 1.96 / value) ** 2, np.nan


def scores(ratios: np.ndarray) -> np.ndarray:
    """Return the scores of ratios, whose last axis is that of the scenes."""
    of_thesis = np.array([about.equal_samples for about in SCENES.values()])
    return np.sqrt((np.log(ratios / of_thesis) ** 2).mean(axis=-1))


def times(factor: float) -> str:
    """Return a factor with two digits, without an exponent."""
    return f"{factor:.0f}" if factor >= 100 else f"{factor:.2g}"


def table(head: str, rows: list[list[str]]) -> list[str]:
    """Return the lines of a table."""
    return [head, "|---" * (head.count("|") - 1) + "|"] + [
        f"| {' | '.join(row)} |" for row in rows
    ]


TITLES = " | ".join(about.title for about in SCENES.values())


def groups() -> list[Group]:
    """Return what a row of Table 4.1 may be about: a set-up at a size."""
    sizes = [Group("independent"), *(Group("nearest", d) for d in (1, 2, 4))]
    measured = [
        group
        for group in sizes
        if any(group.seeds(scene, "balance", "tilt") for scene in SCENES)
    ]
    return [Full("independent", 1), *measured]


def size_of(group: Group, scene: str) -> str:
    """Return what a row is about: set-up, share of the side length, seeds."""
    seeds = len(group.seeds(scene, "balance", "tilt"))
    size = {1: "full", 2: "1/2", 4: "1/4"}[group.divisor]
    return f"{group.setup}, {size}, {seeds} {'seed' if seeds == 1 else 'seeds'}"


def best_tilts(group: Group, scene: str) -> str:
    """Return the least ratio that tilts of patches reach, from weight-bounds.csv, with
    the samples of the pilot paid for; a dash for a set-up without a bound."""
    if group.setup != "independent":
        return "–"
    size = {1: "full", 4: "quarter"}[group.divisor]
    (bound,) = (
        float(row["value"])
        for row in read(TABLES / "weight-bounds.csv")
        if (row["scene"], row["size"], row["measure"], row["bound"])
        == (scene, size, "absolute", "tilt per patch")
    )
    return f"{bound * 128 / 122:.3f}"


def covers(group: Group, scene: str) -> bool:
    """Return whether the interval of tilt / balance contains the thesis's ratio."""
    value, variance, _ = group.ratio(scene, "tilt")
    half = 1.96 * value * variance**0.5
    return abs(SCENES[scene].equal_samples - value) <= half


def renders_of_4_1() -> list[tuple[str, Group]]:
    """Return the scenes and groups that have rows in Table 4.1."""
    pairs = itertools.product(SCENES, groups())
    return [(name, group) for name, group in pairs if not np.isnan(group.mse(name))]


def table_4_1() -> list[str]:
    """Return Table 4.1: errors and ratios of both set-ups."""
    rows = []
    for name, group in renders_of_4_1():
        about, mse = SCENES[name], group.mse(name)
        of_rule = mse * group.ratio(name, "tilt")[0]
        rows.append(
            [
                about.title,
                size_of(group, name),
                f"{mse:.2e} ({about.mse:.3e}): {times(mse / about.mse)}",
                f"{of_rule:.2e} ({about.mse * about.equal_samples:.2e})",
                f"{group.cell(name, 'tilt')} ({about.equal_samples:.3f})",
                "yes" if covers(group, name) else "no",
                best_tilts(group, name),
                group.cell(name, "shares"),
            ]
        )
    return table(
        "| scene | set-up, side length, seeds |"
        " MSE of balance (the thesis's): quotient | MSE of tilt (the thesis's) |"
        " tilt / balance (the thesis's) | covered | best tilts / balance |"
        " shares / balance |",
        rows,
    )


def table_of_seconds() -> list[str]:
    """Return the CPU seconds of the renders of Table 4.1, and its ratio in equal time.

    Where points are independent and errors fall as 1 / time, error times CPU seconds is
    the error in equal time.
    """
    rows = []
    for name, group in renders_of_4_1():
        about, seconds = SCENES[name], group.seconds(name, "balance")
        slower = group.seconds(name, "tilt") / seconds
        in_time = group.ratio(name, "tilt")[0] * slower
        rows.append(
            [
                about.title,
                size_of(group, name),
                f"{seconds:.0f} {slower - 1:+.0%}"
                f" ({about.seconds} {about.overhead:+.0%})",
                f"{in_time:.3f} ({about.equal_time:.3f})",
            ]
        )
    return table(
        "| scene | set-up, side length, seeds | seconds | × CPU time (equal time) |",
        rows,
    )


def table_of_scores() -> list[str]:
    """Return scores, and what a score is worth: that of no effect at all, and that of
    the thesis's other row, in equal time, whose samples are 119 in place of 122."""
    equal_time = [about.equal_time * 119 / 122 for about in SCENES.values()]
    rows = [
        ["no effect: ratios of 1", f"{scores(np.ones(4)):.3f}", "", ""],
        [
            "thesis, equal time × 119 / 122",
            f"{scores(np.array(equal_time)):.3f}",
            "",
            "",
        ],
    ]
    for group in groups():
        if not np.isnan([group.mse(scene, "shares") for scene in SCENES]).any():
            compared = ["tilt"], ["shares"], ["tilt", "shares"]
            rows.append([size_of(group, "tt"), *(group.score(*r) for r in compared)])
    return table("| ratios | tilt | shares | tilt minus shares |", rows)


STEPS = {
    "independent": (Group("independent"), "balance"),
    "numbers of samples of the file": (Group("file"), "balance"),
    "pbrt-v2's points": (Group("points"), "balance"),
    "both changes": (Group("points-file"), "balance"),
    "both changes, killeroos by paths: nearest": (Group("nearest"), "balance"),
    "nearest, original meshes": (Group("nearest", 4, "original"), "balance"),
    "nearest, power heuristic": (Group("nearest"), "power"),
}
"""Set-ups from one to the other, and a rule."""


def set_ups() -> list[str]:
    """Return errors of the balance heuristic over the thesis's by set-up."""
    rows = []
    for label, (group, rule) in STEPS.items():
        cells = []
        for name, about in SCENES.items():
            both = [group.mse(name, rule, m) / about.mse for m in MEASURES]
            cell = f"{times(both[0])} ({times(both[1])})"
            cells.append("–" if np.isnan(both[0]) else cell)
        if set(cells) != {"–"}:
            rows.append([label, *cells])
    return table(f"| set-up | {TITLES} |", rows)


CHOICES = {
    "tilt": "the choices of dmis",
    "mean of RGB": "mean of RGB, not luminance",
    "pilots of 4": "pilots of 4 camera samples",
}
"""Labels of rules; other rules have their names as labels."""


def choices() -> list[str]:
    """Return ratios and scores of other choices where the thesis is silent, with
    independent points, of equal seeds."""
    others = [row for row in measured() if row["rule"] not in OWN_ROWS]
    seeds = 1 + max((int(row["seed"]) for row in others), default=0)
    group = Group("independent", below=seeds)
    rows = []
    for rule in ("tilt", *dict.fromkeys(row["rule"] for row in others)):
        cells = (group.cell(scene, rule) for scene in SCENES)
        label = CHOICES.get(rule) or re.sub(
            r"patch (\d+)", r"patches of \1×\1 pixels", rule
        )
        rows.append([label, *cells, group.score(rule).split()[0]])
    label = "1 seed" if seeds == 1 else f"{seeds} seeds"
    return table(f"| choice, {label} | {TITLES} | score |", rows)


def sun() -> list[str]:
    """Return the results of the same car with and without the sun in its sky."""
    rows = [
        [
            row["scene"],
            row["mse"],
            f"{row['tilt']} ({row['tilt low']} – {row['tilt high']})",
            f"{row['shares']} ± {row['shares half']}",
        ]
        for row in read(TABLES / "sun.csv")
    ]
    return table("| scene | MSE of balance | tilt / balance | shares / balance |", rows)


def floors() -> list[str]:
    """Return errors without a texture, and with a splatted Gaussian."""
    rows = []
    for row in read(TABLES / "floors.csv"):
        cells = [f"{row[r]} ± {row[f'{r} half']}" for r in ("tilt", "shares")]
        rows.append([row["scene"], row["mse"], *cells])
    return table("| scene | MSE of balance | tilt / balance | shares / balance |", rows)


def tables() -> dict[str, list[str]]:
    """Return the lines of the blocks."""
    return {
        "thesis.md: table 4.1": table_4_1(),
        "thesis.md: seconds": table_of_seconds(),
        "thesis.md: score": table_of_scores(),
        "thesis.md: set-ups": set_ups(),
        "thesis.md: floors": floors(),
        "thesis.md: choices": choices(),
        "thesis.md: sun": sun(),
    }


def sentences() -> dict[str, list[str]]:
    """Return the fragments of prose with numbers."""
    independent, nearest = Full("independent", 1), Group("nearest")
    far = {name: independent.mse(name) / about.mse for name, about in SCENES.items()}
    near = [nearest.mse(name) / about.mse for name, about in SCENES.items()]
    rms = independent.score("tilt").split()[0]
    covered = [name for name in SCENES if covers(nearest, name)]
    titles = " and ".join(SCENES[name].title for name in covered)
    return {
        "thesis.md": [
            f"{times(far['teapot-area-light'])} and {times(far['tt'])} times as large",
            f"{times(min(near))} to {times(max(near))} times the thesis's",
            f"off by {float(rms):.0%} in the root mean square".replace("%", " %"),
            f"intervals contain the thesis's ratios on {titles}",
        ]
    }


if __name__ == "__main__":
    replace_tables(tables())
