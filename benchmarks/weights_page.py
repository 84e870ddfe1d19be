"""Write tables, CSV files and figures of docs/what-weights-save.md and docs/mis-bench.md, for mis_bench.py."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from weight_bounds import BOUNDS, SIZES, Bounds, bounds, one_of_image, read_bounds, variance, with_interval

from dmis.base.plugins import load_plugin
from dmis.base.vectors import Array
from dmis.experiment.bench.data import FULL, HALF, SCENES, Truth, path_of, read_truth
from dmis.experiment.bench.decide import SETTINGS, SPP, AnyRule
from dmis.experiment.bench.judge import BASELINES, COLUMNS, Score, interval, score
from dmis.experiment.bench.rendered import load
from dmis.experiment.bench.rendered import measure as measure_renders
from dmis.fit.round import Budget, Fit

ROOT = Path(__file__).resolve().parents[1]
TABLES = ROOT / "docs" / "tables"
LITERATURE = {
    "Hua et al. 2025": "hua2025",
    "Grittmann et al. 2019": "grittmann2019",
    "inverse second moments": "inverse-moments",
    "Grittmann et al. 2022 (shares)": "grittmann2022",
}
"""Rules of examples/literature, by their names in tables."""
THESIS = {"teapot-area-light": 0.802, "killeroo-diffuse": 0.935, "killeroo-gold": 1.119, "tt": 1.286}
"""The thesis's MSE over that of the balance heuristic at equal samples, its Table 4.1."""
TILTS = ("thesis", "Hua et al. 2025", "Grittmann et al. 2019")
SHARES = ("light only", "second-moment", "shares of auto")
"""Rules whose distance to the best tilts, and to the best shares, the page shows."""
JUDGED = FULL[:6]
"""Scenes whose rules are judged at full size: not many-lights, where one share is best everywhere, nor paths."""
Rows = Iterable[Sequence[object]]


def write_pages(names: Sequence[str] = SCENES) -> None:
    """Score all rules at both sizes, compute the bounds, and write tables, CSV files and figures."""
    sys.path.insert(0, str(ROOT / "examples"))
    from common import replace_table
    from weights_figures import draw_bounds, draw_edges

    for stem in ("hua2025", "grittmann2019", "inverse_moments", "grittmann2022"):
        load_plugin(ROOT / "examples" / "literature" / f"{stem}.py")
    judged = [name for name in names if f"full-{name}" in JUDGED]
    full = [f"full-{name}" for name in judged]
    rules = {**BASELINES, **LITERATURE}
    small = {name: score(rule, judged) for name, rule in rules.items()}
    large = {name: score_full(rule, full) for name, rule in rules.items()}
    write_csv("mis-bench", ["rule", "scene", *_with_halves(COLUMNS)], score_rows({**small}, {**large}))
    replace_table(ROOT / "docs" / "mis-bench.md", "mis-bench", *_markdown(leading_rows(large, small)))
    found = {(name, size): bounds_of(name, size) for name in names for size in SIZES}
    write_csv("weight-bounds", ["scene", "width", "height", "measure", "bound", "value", "half"], bound_rows(found))
    page = ROOT / "docs" / "what-weights-save.md"
    replace_table(page, "bounds", *_markdown(page_bounds(found, names)))
    replace_table(page, "reached", *_markdown(page_reached(large, full)))
    replace_table(page, "thesis", *_markdown(page_thesis(large)))
    replace_table(page, "order", *_markdown(page_orders(large, small, judged)))
    draw_bounds(found, large, names)
    draw_edges()


# Scores -------------------------------------------------------------------------------------------------------------


def score_full(rule: AnyRule, scenes: Sequence[str]) -> Score:
    """Return the score on blocks of full-size images; the radius of Hua et al. is a share of the image's height."""
    if rule != "hua2025":
        return score(rule, scenes, range(1))
    values: dict[str, Array] = {}
    for scene in scenes:
        height, (side, _) = load(scene)[0].camera.resolution[1], _block_shape(scene)
        values |= score(f"hua2025:radius={32 / 480 * height / side:.4f}", [scene], range(1)).values
    return Score("hua2025", values, True)


def _block_shape(scene: str) -> tuple[int, int]:
    truth = read_truth(path_of(scene))
    return truth.shape[0] // truth.blocks, truth.shape[1]


def leading_rows(large: Mapping[str, Score], small: Mapping[str, Score]) -> Rows:
    """Yield the rows of the table of MIS-Bench: two numbers per rule and size, geometric means of the `JUDGED`."""
    yield ["rule", "full size, absolute", "relative", "100x75, absolute", "relative"]
    for name in large:
        cells = [
            _cell(*interval(scores[name].over_scenes()[:, m], scores[name].blocks))
            for scores in (large, small)
            for m in range(2)
        ]
        yield [name, *cells]


def score_rows(*sizes: Mapping[str, Score]) -> Rows:
    """Yield a row for each rule, scene and size: means and halves of intervals of all columns."""
    for scores in sizes:
        for name, result in scores.items():
            for scene, values in result.values.items():
                pairs = [interval(column, result.blocks) for column in values.T]
                yield [name, scene, *(f"{x:.4g}" for pair in pairs for x in pair)]


def best_tilts(truth: Truth, measure: int) -> Array:
    """Return the error of the best tilt of each patch over that of w = 1/2, without each group of blocks."""
    curves = truth.variance[measure, 1]
    ratios = []
    for part in truth.leave_one_out():
        weight = np.ones(curves.shape[1:]) if part.weight is None else part.weight
        ratios.append((curves.min(axis=0) * weight).sum() / (curves[HALF] * weight).sum())
    return np.array(ratios)


def page_reached(large: Mapping[str, Score], scenes: Sequence[str]) -> Rows:
    """Yield by scene the absolute error of rules over that of the best tilts, or shares, of the same blocks."""
    yield ["scene", *TILTS, *SHARES]
    logs: list[Array] = []
    for scene in scenes:
        least = {"tilts": best_tilts(read_truth(path_of(scene)), 0), "shares": large["oracle"].values[scene][:, 0]}
        ratios = [large[name].values[scene][:, 0] / least["tilts"] for name in TILTS]
        ratios += [large[name].values[scene][:, 0] / least["shares"] for name in SHARES]
        logs.append(np.log(ratios))
        yield [scene.removeprefix("full-"), *(_cell(*interval(ratio, True)) for ratio in ratios)]
    means = np.exp(np.mean(logs, axis=0))
    yield ["geometric mean", *(_cell(*interval(ratio, True)) for ratio in means)]


def page_orders(large: Mapping[str, Score], small: Mapping[str, Score], names: Sequence[str]) -> Rows:
    """Yield by scene how many pairs of rules have a sure order at both sizes, and how many of these differ.

    An order is sure if the interval of the logarithm of the ratio, of the same seeds or blocks, excludes 0.
    """
    yield ["scene", "sure at both sizes", "in another order"]
    rules = [name for name in large if "oracle" not in name]
    for scene in names:
        sure, differ = 0, 0
        for i, first in enumerate(rules):
            for second in rules[i + 1 :]:
                signs = [
                    _order(small[first], small[second], scene),
                    _order(large[first], large[second], f"full-{scene}"),
                ]
                sure += all(signs)
                differ += signs[0] * signs[1] < 0
        yield [scene, sure, differ]


def _order(first: Score, second: Score, scene: str) -> int:
    """Return -1 or 1 if the interval of the absolute error over the other rule's is below or above 1, else 0."""
    ratio = np.log(first.values[scene][:, 0] / second.values[scene][:, 0])
    mean, half = interval(ratio, first.blocks)
    return int(np.sign(mean)) if abs(mean) > max(half, 1e-3) else 0


# Bounds -------------------------------------------------------------------------------------------------------------

Found = tuple[tuple[int, int], Array]
"""Resolution of an image, and values and halves of intervals of `KINDS`, ``(2 measures, 2, kinds)``."""
KINDS = ("camera samples", *BOUNDS)
"""The part of the variance at w = 1/2 that comes from where camera samples meet the scene; and the bounds."""


def bounds_of(name: str, size: str) -> Found:
    """Return the bounds of a scene at a size of `SIZES`."""
    data = read_bounds(name, size)

    def estimate(measure: int, keep: np.ndarray) -> Array:
        weight = data.weight[keep]
        whole = sum(variance(data.terms[h, measure], data.position[h, measure])[HALF, HALF, keep] for h in range(2))
        part = data.position[:, measure, keep].sum(axis=0)
        return np.array([part @ weight / (whole @ weight), *bounds(data, measure, keep)])

    width, height = load(f"full-{name}")[0].camera.resolution
    found = [with_interval(partial(estimate, measure), len(data.weight)) for measure in range(2)]
    return (width // SIZES[size], height // SIZES[size]), np.array(found)


def bound_rows(found: Mapping[tuple[str, str], Found]) -> Rows:
    """Yield a row for each scene, size, measure and bound."""
    for (name, _), (resolution, values) in found.items():
        for measure, (value, half) in zip(("absolute", "relative"), values, strict=True):
            for kind, x, h in zip(KINDS, value, half, strict=True):
                yield [name, *resolution, measure, kind, f"{x:.4f}", f"{h:.4f}"]


def page_bounds(found: Mapping[tuple[str, str], Found], names: Sequence[str]) -> Rows:
    """Yield by scene the absolute bounds at full size (at a quarter of the side), and means of both measures."""
    kinds = KINDS[:-1]
    yield ["scene", "pixels", *kinds]

    def cells(large: Array, small: Array) -> list[str]:
        return [f"{a:.2f} ({b:.2f})" for a, b in zip(large[: len(kinds)], small[: len(kinds)], strict=True)]

    for name in names:
        (width, height), values = found[name, "full"]
        yield [name, f"{width}x{height}", *cells(values[0, 0], found[name, "quarter"][1][0, 0])]
    for measure, kind in enumerate(("absolute", "relative")):
        means = [np.exp(np.log([found[name, size][1][measure, 0] for name in names]).mean(axis=0)) for size in SIZES]
        yield ["*mean*", kind, "", *cells(*means)[1:]]


# Renders ------------------------------------------------------------------------------------------------------------


def confirm(names: Sequence[str], spp: int = 4) -> None:
    """Render images at full size with the best tilt and the best share of all, and write their table."""
    sys.path.insert(0, str(ROOT / "examples"))
    from common import replace_table

    rows = [["scene", "what", "w", "bound", "renders"]]
    for name in names:
        data = read_bounds(name, "full")
        scene, settings = load(f"full-{name}")
        predicted = dict(zip(KINDS, bounds_of(name, "full")[1][0].T, strict=True))
        shape = scene.camera.resolution[::-1]
        balance, error_of_balance = measure_renders(
            scene, settings, Budget(SPP, shape, SETTINGS).final(Fit(0.5)), 0, spp
        )
        for kind, weigh in (("one tilt", "heuristic"), ("one share", "samples")):
            w = one_of_image(data, kind)
            final = Budget(SPP, shape, SETTINGS, weigh=weigh).final(Fit(w))
            value, error = measure_renders(scene, settings, final, 0, spp)
            ratio = value[0] / balance[0]
            half = 1.96 * ratio * np.hypot(error[0], error_of_balance[0])
            rows.append([name, kind, f"{w:.2f}", _cell(*predicted[kind]), _cell(ratio, half)])
            print(rows[-1], flush=True)
    replace_table(ROOT / "docs" / "what-weights-save.md", "renders", *_markdown(rows))


# The thesis ---------------------------------------------------------------------------------------------------------


def page_thesis(large: Mapping[str, Score]) -> Rows:
    """Yield for the thesis's scenes its ratio of errors at equal samples, that of the rule here, and the least ones.

    Of 128 samples 6 are the pilot's, which is not part of the image: all but the thesis's own are times 128 / 122.
    """
    yield ["scene", "the thesis", "`thesis` here", "best tilts", "best shares"]
    for name, ratio in THESIS.items():
        data = read_bounds(name, "full")
        free = replace(data, cost=np.ones_like(data.cost))  # at equal samples, not in equal time

        def least(keep: np.ndarray, free: Bounds = free) -> Array:
            return bounds(free, 0, keep)[[list(BOUNDS).index(f"{kind} per patch") for kind in ("tilt", "share")]]

        reached = interval(large["thesis"].values[f"full-{name}"][:, 0], True)
        cells = [reached, *zip(*with_interval(least, len(data.weight)), strict=True)]
        yield [
            name,
            f"{ratio:.3f}",
            *(_cell(128 / 122 * value, 128 / 122 * half) for value, half in cells),
        ]


# Files --------------------------------------------------------------------------------------------------------------


def write_csv(stem: str, head: Sequence[str], rows: Rows) -> None:
    """Write a table of docs/tables."""
    with open(TABLES / f"{stem}.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(rows)


def _with_halves(columns: Iterable[str]) -> list[str]:
    return [name for column in columns for name in (column, f"{column} ±")]


def _cell(value: float, half: float) -> str:
    digits = 2 if half >= 5e-3 else 3
    return f"{value:.{digits}f}" if half < 5e-4 else f"{value:.{digits}f}±{half:.{digits}f}"


def _markdown(rows: Rows) -> list[str]:
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    lines.insert(1, f"|{'---|' * (lines[0].count('|') - 1)}")
    return lines
