"""Measure what weights can save, and how near rules come: docs/results.md and docs/mis-bench.md.

Scores of rules go to docs/tables/mis-bench.csv, bounds to weight-bounds.csv, renders that confirm bounds to
weight-renders.csv; rows that are there are not measured again. `show_weights` makes the tables from these rows.

Run: python benchmarks/measure_weights.py     (minutes, with the data that mis_bench.py makes)
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

import numpy as np
from mis_bench import make_data
from mis_bench_renders import load, measure
from pieces import FOUR
from rows import read_rows, write_rows
from show_weights import (
    BOUND_FIELDS,
    BOUNDS_CSV,
    FILES,
    KINDS,
    LITERATURE,
    MEASURES,
    RENDER_FIELDS,
    RENDERS_CSV,
    SCORE_FIELDS,
    SCORES_CSV,
    TILTS_OF_PATCHES,
    draw_bounds,
)
from weight_bounds import SIZES, bounds, one_of_image, read_bounds, variance, with_interval
from weights_figures import draw_edges

from dmis.base.plugins import load_plugin
from dmis.base.vectors import Array
from dmis.bench.data import FULL, HALF, SCENES, Truth, path_of, read_truth
from dmis.bench.decide import SETTINGS, SPP, AnyRule
from dmis.bench.judge import BASELINES, Score, score
from dmis.fit.round import Budget, Fit

JUDGED = tuple(name.removeprefix("full-") for name in FULL[:6])
"""Scenes whose rules are judged at both sizes: not many-lights, where one share is best everywhere, nor paths."""
CONFIRMED = ("teapot-area-light", "killeroo-diffuse")
"""Scenes rendered with one weight for the image."""


# Scores -------------------------------------------------------------------------------------------------------------


def write_scores() -> None:
    """Score all rules at both sizes: a row for each seed of small images, for each group of blocks of large ones."""
    for name in (*FILES.values(), "objectives"):
        load_plugin(name)
    rows: list[Mapping[str, object]] = [*read_rows(SCORES_CSV)]
    present = {(row["rule"], row["scene"]) for row in rows}
    for size, of in (("", partial(score, seeds=range(4))), ("full-", score_full)):
        for name, rule in {**BASELINES, **LITERATURE}.items():
            scenes = [size + scene for scene in JUDGED if (name, size + scene) not in present]
            if scenes:
                rows += score_rows(name, of(rule, scenes).values)
                write_rows(SCORES_CSV, rows, SCORE_FIELDS)
                print(name, *scenes, flush=True)
    for scene in (f"full-{name}" for name in JUDGED if (TILTS_OF_PATCHES, f"full-{name}") not in present):
        columns = np.full((len(read_truth(path_of(scene)).leave_one_out()), 6), np.nan)
        columns[:, :2] = np.transpose([best_tilts(read_truth(path_of(scene)), measure) for measure in range(2)])
        rows += score_rows(TILTS_OF_PATCHES, {scene: columns})
    write_rows(SCORES_CSV, rows, SCORE_FIELDS)


def score_rows(name: str, values: Mapping[str, Array]) -> list[dict[str, object]]:
    """Return the rows of a rule; its columns are by scene, and then by seed or by group of blocks left out."""
    return [
        dict(zip(SCORE_FIELDS, (name, scene, part, *(f"{x:.5g}" for x in columns)), strict=True))
        for scene, of_scene in values.items()
        for part, columns in enumerate(of_scene)
    ]


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


def best_tilts(truth: Truth, measure: int) -> Array:
    """Return the error of the best tilt of each patch over that of w = 1/2, without each group of blocks."""
    curves = truth.variance[measure, 1]
    ratios = []
    for part in truth.leave_one_out():
        weight = np.ones(curves.shape[1:]) if part.weight is None else part.weight
        ratios.append((curves.min(axis=0) * weight).sum() / (curves[HALF] * weight).sum())
    return np.array(ratios)


# Bounds -------------------------------------------------------------------------------------------------------------


def write_bounds() -> None:
    """Compute the bounds of each scene at both sizes; those of the thesis's scenes at equal samples, too."""
    rows: list[Mapping[str, object]] = [*read_rows(BOUNDS_CSV)]
    present = {(row["scene"], row["size"]) for row in rows}
    for name, size in ((name, size) for name in SCENES for size in SIZES if (name, size) not in present):
        rows += bound_rows(name, size)
        write_rows(BOUNDS_CSV, rows, BOUND_FIELDS)
        print(name, size, flush=True)


def bound_rows(name: str, size: str) -> list[dict[str, object]]:
    """Return a row for each measure and bound of a scene at a size of `SIZES`."""
    width, height = (side // SIZES[size] for side in load(f"full-{name}")[0].camera.resolution)
    found = dict(zip(MEASURES, bounds_of(name, size), strict=True))
    if name in FOUR and size == "full":
        found["absolute, equal samples"] = bounds_of(name, size, equal_samples=True)[0]
    return [
        dict(zip(BOUND_FIELDS, (name, size, width, height, kind, bound, f"{x:.5g}", f"{h:.5g}"), strict=True))
        for kind, (values, halves) in found.items()
        for bound, x, h in zip(KINDS, values, halves, strict=True)
    ]


def bounds_of(name: str, size: str, equal_samples: bool = False) -> Array:
    """Return `KINDS` of a scene at a size of `SIZES` and halves of their intervals, ``(2 measures, 2, kinds)``.

    Errors are compared at equal time, or at equal samples.
    """
    data = read_bounds(name, size)
    if equal_samples:
        data = replace(data, cost=np.ones_like(data.cost))

    def estimate(measure: int, keep: np.ndarray) -> Array:
        weight = data.weight[keep]
        whole = sum(variance(data.terms[h, measure], data.position[h, measure])[HALF, HALF, keep] for h in range(2))
        part = data.position[:, measure, keep].sum(axis=0)
        return np.array([part @ weight / (whole @ weight), *bounds(data, measure, keep)])

    return np.array([with_interval(partial(estimate, measure), len(data.weight)) for measure in range(2)])


# Renders ------------------------------------------------------------------------------------------------------------


def write_renders(spp: int = 4) -> None:
    """Render images at full size with the best tilt and the best share of all."""
    rows: list[Mapping[str, object]] = [*read_rows(RENDERS_CSV)]
    for name in (name for name in CONFIRMED if name not in {row["scene"] for row in rows}):
        data = read_bounds(name, "full")
        scene, settings = load(f"full-{name}")
        budget = partial(Budget, SPP, scene.camera.resolution[::-1], SETTINGS)
        balance, error_of_balance = measure(scene, settings, budget().final(Fit(0.5)), 0, spp)
        for kind, weigh in (("one tilt", "heuristic"), ("one share", "samples")):
            w = one_of_image(data, kind)
            value, error = measure(scene, settings, budget(weigh=weigh).final(Fit(w)), 0, spp)
            ratio = value[0] / balance[0]
            half = 1.96 * ratio * np.hypot(error[0], error_of_balance[0])
            cells = (name, kind, f"{w:.4g}", f"{ratio:.4f}", f"{half:.4f}")
            rows.append(dict(zip(RENDER_FIELDS, cells, strict=True)))
            print(*cells, flush=True)
        write_rows(RENDERS_CSV, rows, RENDER_FIELDS)


if __name__ == "__main__":
    make_data(SCENES, range(4))
    make_data([f"full-{name}" for name in JUDGED], [0])
    write_scores()
    write_bounds()
    write_renders()
    draw_bounds()
    draw_edges()
