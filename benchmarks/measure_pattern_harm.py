"""
Harm of the pattern alone
=========================

In how many lit patches of 4×4 pixels is the pattern of light and BRDF samples that ``auto`` chose worse than 1:1? A
pattern is worse if its V Cᵃ (`dmis.fit.best_pattern`) is larger. V is the variance of the mean of 16 camera samples
with Sobol points, over renders with other seeds than those that the pattern was chosen from, so that the noise of the
choice is in no estimate. Takes some minutes of one core.

The variances have noise, which alone would make nearly half of all patches look worse where both patterns are equally
good. So the distribution of the true logarithms of the ratios is estimated from the measured ones and their standard
errors, by maximum likelihood on a grid of steps of 0.1. A patch is harmed if it belongs to a point above 0: its ratio
is above 1.05, the least that so many renders can tell from 1. Patches whose pixels all have 1:1 are not harmed. *Their
error* is the share of the image's variance with 1:1 that harmed patches have. The same for two halves of the renders
with 1:1, where nothing is harmed, shows the noise that is left. Rows go to docs/tables/pattern-harm.csv.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, SCENES, options
from pieces import FOUR
from rows import markdown, read_rows, write_rows

import dmis
from dmis.base.patches import PATCH, patch_sum
from dmis.estimator.allocation import shares_of
from dmis.estimator.cost import pattern_costs
from dmis.estimator.patterns import EQUAL, FIRST, PATTERNS, PatternMap
from dmis.fit.auto import Auto
from dmis.fit.round import Round
from dmis.fit.sample_density import EXPONENT
from dmis.pipeline.job import resolve
from dmis.pipeline.passes import Passes

SHRINK = {"teapot-area-light": 10, "killeroo-diffuse": 16, "killeroo-gold": 16, "tt": 17}
"""How much smaller than in the thesis the scenes are rendered."""
GRID = np.arange(-60, 31) / 10
"""Logarithms of true ratios."""

CSV = ROOT / "docs" / "tables" / "pattern-harm.csv"
FIELDS = ("scene", "patches", "ratio", "at 1:1", "at 2:2", "worse", "worse error", "of variance", "null", "null error")
BUDGET, SAMPLES = 128, 16
"""Camera samples per pixel from which auto chooses, and camera samples of each pixel in V."""


def choose(scene: dmis.Scene, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the pattern of each pixel that `auto` chooses, and its cost over that of 1:1."""
    job = resolve(scene, "auto", BUDGET, seed, dmis.Settings(sampler="sobol"))
    assert isinstance(job.rule, Auto), f"no first round of {scene.name}, {BUDGET} spp"
    rounds = job.rule.rounds(job.budget)
    with Passes(job, 1) as passes:
        pilot = passes.render(next(rounds))
    lights = len(pilot.sums["lights"][0]) - 1 if "lights" in pilot.sums else 1
    cost, _ = pattern_costs(pilot.rays, pilot.shading_samples, pilot.techniques, lights)
    patterns = rounds.send(pilot).patterns
    if patterns is None:
        return np.full(scene.camera.resolution[::-1], EQUAL, np.uint8), np.ones(scene.camera.resolution[::-1])
    return patterns.pattern, cost[patterns.pattern]


def squared_deviations(scene: dmis.Scene, pattern: np.ndarray, seeds: range) -> np.ndarray:
    """Return squared deviations of pixels from their mean over seeds, ``(seeds, H, W)``; their mean is V."""
    patterns = PatternMap(PATTERNS, pattern)
    job = resolve(scene, "balance", SAMPLES, 0, dmis.Settings(sampler="sobol"))
    equal_numbers = Round(SAMPLES, shares_of(0.5), job.settings, patterns=patterns, stage="final")
    images = []
    for seed in seeds:
        with Passes(replace(job, seed=seed), 1) as passes:
            images.append(passes.render(equal_numbers).mean)
    deviations = np.array(images, np.float64)
    deviations -= deviations.mean(axis=0)
    return np.square(deviations).mean(axis=-1) * len(images) / (len(images) - 1)


def patch_worth(squares: np.ndarray, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return V times a factor of each pixel, summed over patches, ``(patches,)``, and its relative standard error."""
    worth = patch_sum(squares * factor, PATCH).reshape(len(squares), -1)
    mean = worth.mean(axis=0)
    error = worth.std(axis=0, ddof=1) / np.sqrt(len(worth))
    return mean, np.divide(error, mean, out=np.zeros_like(mean), where=mean > 0)


def share_above(
    log_ratio: np.ndarray, error: np.ndarray, weight: np.ndarray, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Return the share of the ratios that belong above 1, its standard error, and their share of the weight.

    The standard error is that of the bootstrap over patches.
    """
    if not len(log_ratio):
        return 0.0, 0.0, 0.0
    z = (log_ratio[:, None] - GRID) / error[:, None]
    likelihood = np.exp(-0.5 * (z**2 - (z**2).min(axis=1, keepdims=True)))
    shares = []
    for k in range(21):  # all patches first, then samples of them
        chosen = np.arange(len(z)) if k == 0 else rng.integers(len(z), size=len(z))
        of, density = likelihood[chosen], np.full(len(GRID), 1 / len(GRID))
        for _ in range(200):  # expectation maximisation
            belongs = of * density / (of @ density)[:, None]
            density = belongs.mean(axis=0)
        above = belongs[:, GRID > 0].sum(axis=1)
        shares.append((above.mean(), np.average(above, weights=weight[chosen])))
    share, of_weight = shares[0]
    return float(share), float(np.std([s for s, _ in shares[1:]], ddof=1)), float(of_weight)


def harm(ratio: np.ndarray, error: np.ndarray, base: np.ndarray, harmed: np.ndarray) -> tuple[float, float, float]:
    """Return the share of all patches that are harmed, its standard error, and their share of the variance.

    `harmed` are the patches that can be: others have 1:1 everywhere.
    """
    share, share_error, of_base = share_above(
        np.log(ratio[harmed]), error[harmed], base[harmed], np.random.default_rng(1)
    )
    part = np.mean(harmed)
    return share * part, share_error * part, of_base * base[harmed].sum() / base.sum()


def judge(name: str, scene: dmis.Scene, seeds: int) -> dict[str, object]:
    """Return the row of a scene: what the pattern of `auto` does to its patches."""
    shape = scene.camera.resolution[::-1]
    equal = squared_deviations(scene, np.full(shape, EQUAL, np.uint8), range(1000, 1000 + 2 * seeds))
    half, other = (patch_worth(equal[k::2], np.ones(shape)) for k in (0, 1))
    lit = (half[0] > 0) & (other[0] > 0)
    pattern, cost = choose(scene, 0)
    worth, error = patch_worth(squared_deviations(scene, pattern, range(2000, 2000 + seeds)), cost**EXPONENT)
    base, base_error = patch_worth(equal, np.ones(shape))
    changed = patch_sum((pattern != EQUAL).astype(float), PATCH).reshape(-1) > 0
    some = lit & (worth > 0)
    ratio = worth / np.maximum(base, 1e-300)
    worse = harm(ratio[some], np.hypot(error, base_error)[some], base[some], changed[some])
    null_ratio, null_error = half[0] / np.maximum(other[0], 1e-300), np.hypot(half[1], other[1])
    null = harm(null_ratio[lit], null_error[lit], half[0][lit], np.ones(lit.sum(), bool))
    title = "{} {}×{}".format(name, *scene.camera.resolution)
    numbers = worth.sum() / base.sum(), (pattern == EQUAL).mean(), (pattern == FIRST).mean(), *worse, *null[:2]
    return dict(zip(FIELDS, (title, lit.sum(), *(f"{number:.5g}" for number in numbers)), strict=True))


def tables() -> dict[str, list[str]]:
    """Return the lines of the block."""
    lines = []
    for row in sorted(read_rows(CSV), key=lambda row: FOUR.index(row["scene"].split()[0])):
        value = {field: float(row[field]) for field in FIELDS[1:]}
        lines.append(
            [
                row["scene"],
                row["patches"],
                f"{value['ratio']:.2f}",
                f"{value['at 1:1']:.0%}",
                f"{value['at 2:2']:.0%}",
                f"{value['worse']:.1%} ± {value['worse error']:.1%}",
                f"{value['of variance']:.1%}",
                f"{value['null']:.1%} ± {value['null error']:.1%}",
            ]
        )
    head = ["scene", "lit patches", "V·Cᵃ over 1:1", "pixels at 1:1", "at 2:2", "worse", "their error", "by chance"]
    return {"measurements.md: pattern harm": markdown(head, lines)}


def main() -> None:
    """Measure, one scene after the other, on one thread."""
    opts, given = options(
        __file__,
        "share of patches that the pattern of auto makes worse",
        seeds={"type": int, "default": 24, "help": "renders with each choice, and twice as many with 1:1 (default 24)"},
        scenes={"nargs": "+", "default": list(SHRINK), "help": "only these scenes"},
        csv={"type": Path, "default": CSV, "help": "rows of results"},
    )
    rows: list = read_rows(given.csv)
    for name in given.scenes:
        size = (side // (SHRINK[name] * opts.pick(4, 1)) // PATCH * PATCH for side in SCENES[name].size)
        scene = dmis.load_scene(name, resolution=tuple(size))
        if not any(row["scene"] == "{} {}×{}".format(name, *scene.camera.resolution) for row in rows):
            rows.append(judge(name, scene, given.seeds))
            print(rows[-1], flush=True)
            write_rows(given.csv, rows, FIELDS)


if __name__ == "__main__":
    main()
