"""Scores of weight rules by converged curves, and their tables: error times counted cost of the learned shares."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dmis.base.patches import PATCH, patch_mean, patch_spread, patch_sum
from dmis.base.validate import one_of
from dmis.base.vectors import TINY, Array
from dmis.bench.data import FULL, GRID, HALF, SCENES, Truth, path_of, read_pilots, read_truth, seeds_of
from dmis.bench.decide import SETTINGS, SPP, AnyRule, decide
from dmis.bench.samples import SampleTable
from dmis.experiment.metrics import mean_and_error
from dmis.experiment.oracle import HARM_LIMIT, Oracle
from dmis.fit.round import Budget, Fit, Round
from dmis.fit.rule import rule_text

COLUMNS = ("absolute", "relative", "saving, abs.", "saving, rel.", "regret", "harm")
"""Error times cost over that of balance, in both measures; the share of the oracle's saving in both; mean over patches
of V C beyond the least, over that of balance; share of the patches where V C is above 1.02 times that of balance.
"""
ORACLES = {"oracle": False, "oracle-samples": True}
"""Rules computed from the converged curves; True: with numbers of samples as well."""


def random_shares(tables: Mapping[float, SampleTable]) -> Array:
    """Return a random share for each patch."""
    rows, columns = (-(-n // PATCH) for n in tables[0.5].shape)
    shares = np.random.default_rng(len(tables[0.5].pixel)).random((rows, columns))
    return patch_spread(shares, PATCH, tables[0.5].shape)


BASELINES: Mapping[str, AnyRule] = {
    "balance": "balance", "power, 1 + 1": "pbrt", "light only": "fixed:1", "BRDF only": "fixed:0",
    "random": random_shares, "thesis": "thesis", "thesis, shares": "thesis:weigh=samples",
    "second-moment": "second-moment", "shares of auto": "auto", "oracle": "oracle", "oracle, samples": "oracle-samples",
}  # fmt: skip
"""Rules of the table of results, by their names there."""


@dataclass(frozen=True, eq=False, repr=False)
class Score:
    """Score of a rule: its name, and by scene `COLUMNS` of each seed, ``(seeds, 6)``.

    With `blocks`, scenes are blocks of larger images, and `COLUMNS` are means over seeds without one group of the
    blocks, ``(groups, 6)``: a jackknife.
    """

    rule: str
    values: Mapping[str, Array]
    blocks: bool = False

    def __repr__(self) -> str:
        """Return the tables of `report`."""
        return report({self.rule: self})

    def over_scenes(self) -> Array:
        """Return the columns of each seed over all scenes, ``(seeds, 6)``: of ratios geometric means, else means."""
        every = np.stack(list(self.values.values()))
        return np.concatenate([np.exp(np.log(every[..., :2]).mean(axis=0)), every[..., 2:].mean(axis=0)], axis=1)


def score(rule: AnyRule, scenes: Iterable[str | os.PathLike[str]] = SCENES, seeds: Iterable[int] = range(4)) -> Score:
    """Return the score of a rule on scenes of MIS-Bench (docs/mis-bench.md); nothing is rendered.

    Parameters
    ----------
    rule
        A `dmis.Rule` or its text; or a function of the pilot tables by w, ``{0.0: table, 0.5: table, 1.0: table}``, see
        `dmis.bench.samples.SampleTable`, that returns shares of light samples ``(H, W)``, or a pair of these
        and numbers of camera samples in proportion ``(H, W)``. Of blocks of a larger image, a rule decides in one after
        the other, and only shares count.
    scenes
        Names of `dmis.bench.data.SCENES`, of `dmis.bench.data.PACKAGED`, such as ``small``, or of
        `dmis.bench.data.FULL`; or paths of data files of one's own, see docs/mis-bench.md. All are blocks of larger
        images, or none.
    seeds
        Seeds of the pilots. Of other scenes than `dmis.bench.data.SCENES`, those without a file are left out.
    """
    seeds = list(seeds)
    truths = {scene: read_truth(path_of(scene)) for scene in [os.fspath(scene) for scene in scenes]}
    blocks = {scene: truth.blocks for scene, truth in truths.items()}
    if len({number > 1 for number in blocks.values()}) > 1:
        raise ValueError(f"scenes must all be blocks of larger images, or none; got these numbers of blocks: {blocks}")
    values = {}
    for scene, truth in truths.items():
        columns = np.stack([_columns(rule, scene, seed, truth) for seed in seeds_of(scene, seeds)])
        values[scene] = columns[:, 0] if truth.blocks == 1 else columns.mean(axis=0)
    name = rule if isinstance(rule, str) else getattr(rule, "__name__", rule_text(rule))
    return Score(name, values, max(blocks.values()) > 1)


def _columns(rule: AnyRule, scene: str, seed: int, truth: Truth) -> Array:
    """Return `COLUMNS` of a rule that learns from the pilots of one seed, ``(1, 6)``; of an image of blocks, those
    without each group of them, ``(groups, 6)``.
    """
    blocks = truth.split()
    of_balance = _maps([Budget(SPP, block.shape, SETTINGS).final(Fit(0.5)) for block in blocks], blocks)
    of_rule, adaptive = None, rule == "oracle-samples"
    if not (isinstance(rule, str) and rule in ORACLES):
        pilots = read_pilots(path_of(scene, seed), truth.shape)
        finals = [decide(rule, part, seed) for part in pilots.split(len(blocks))]
        of_rule = _maps(finals, blocks)
        adaptive = len(blocks) == 1 and np.ndim(finals[0].spp) > 0 and finals[0].patterns is None
    return np.array([_of_image(of_rule, of_balance, adaptive, part) for part in truth.leave_one_out()])


def _maps(finals: Sequence[Round], blocks: Sequence[Truth]) -> Array:
    """Return what `of_pixels` returns of the rounds of blocks, by measure, ``(2, 3, H, W)``."""
    maps = np.stack(
        [np.concatenate([of_pixels(*item, m) for item in zip(finals, blocks, strict=True)], axis=1) for m in range(2)]
    )
    if len(blocks) > 1:  # numbers of samples are decided for a whole image
        maps[:, 2] = 1
    return maps


def _of_image(of_rule: Array | None, of_balance: Array, adaptive: bool, truth: Truth) -> list[float]:
    """Return `COLUMNS` from what `_maps` returns; None: of the oracle."""
    ratios, savings = [], []
    for measure in range(2):
        curves = Oracle(truth.variance[measure, 0], truth.cost, PATCH, SPP, truth.shape, weight=truth.weight)
        ratio = least = curves.limit_with_counts() if adaptive else curves.limit(costly=True)
        if of_rule is not None:
            ratio = _error_time(of_rule[measure], truth) / _error_time(of_balance[measure], truth)
        ratios.append(ratio)
        savings.append((1 - ratio) / (1 - least) if least < 1 else np.nan)
    products = truth.variance[0, 0] * truth.cost
    half = products[HALF]
    product = least_product = products.min(axis=0)
    if of_rule is not None:
        variance, cost, _ = of_rule[0]
        product = patch_mean(variance, PATCH) * patch_mean(cost, PATCH)
    lit = half > 0
    weight = None if truth.weight is None else truth.weight[lit]
    regret = np.average((product - least_product)[lit] / half[lit], weights=weight)
    harm = np.average(product[lit] / half[lit] > HARM_LIMIT, weights=weight)
    return [*ratios, *savings, float(regret), float(harm)]


def shares_and_samples(final: Round) -> tuple[Array, Array | int]:
    """Return the shares w of a final round, or its tilts, and its numbers of camera samples.

    Of patterns, whole numbers of samples, the shares count alone: at equal numbers of camera samples.
    """
    if final.patterns is None:
        return (final.shares if final.tilt is None else final.tilt)[0], np.add(final.spp, final.begin)
    _, light, brdf = final.technique_samples()
    return light / np.maximum(light + brdf, 1), 1


def of_pixels(final: Round, truth: Truth, measure: int) -> Array:
    """Return variance and cost of a camera sample, and numbers of samples, of each pixel, ``(3, H, W)``.

    A ValueError if the combiner is not ``balance``, nor ``power`` at w = 1/2.
    """
    shares, samples = (np.broadcast_to(a, truth.shape) for a in shares_and_samples(final))
    y, x = np.ix_(*(np.arange(n) // PATCH for n in truth.shape))
    if final.settings.combiner == "power" and (shares == 0.5).all():
        return np.stack([truth.power[measure, y, x], truth.cost[HALF, y, x], samples])
    one_of("combiner of a rule", final.settings.combiner, ("balance", "power with w = 1/2"))
    # between the points of the grid V is like 1 / (a + b w), as that of one direction is, and C is linear
    shares = np.clip(shares, GRID[0], GRID[-1])
    k = np.clip(np.searchsorted(GRID, shares, "right") - 1, 0, len(GRID) - 2)
    t = (shares - GRID[k]) / (GRID[k + 1] - GRID[k])
    cost = truth.cost if final.tilt is None else np.broadcast_to(truth.cost[HALF], truth.cost.shape)
    curves = truth.variance[measure, 0 if final.tilt is None else 1], cost
    (v_low, v_high), (c_low, c_high) = ((curve[k, y, x], curve[k + 1, y, x]) for curve in curves)
    variance = v_low * v_high / np.maximum((1 - t) * v_high + t * v_low, TINY)
    return np.stack([variance, (1 - t) * c_low + t * c_high, samples])


def error_time(final: Round, truth: Truth, measure: int) -> float:
    """Return error times cost of a round's image, ``mean(V / n) mean(n C)``; measure 0 is absolute, 1 relative."""
    return _error_time(of_pixels(final, truth, measure), truth)


def _error_time(maps: Array, truth: Truth) -> float:
    """Return ``mean(V / n) mean(n C)`` of what `of_pixels` returns."""
    variance, cost, n = maps
    weight = None
    if truth.weight is not None:
        weight = patch_spread(truth.weight / patch_sum(np.ones(truth.shape), PATCH), PATCH, truth.shape)
    return float(np.average(variance / n, weights=weight) * np.average(n * cost, weights=weight))


def report(scores: Mapping[str, Score]) -> str:
    """Return tables of scores by name: means over seeds, with half the width of their 95 % intervals.

    The first has all columns over all scenes, the second absolute and relative error times cost over that of balance in
    each scene.
    """
    scenes = tuple(next(iter(scores.values())).values)
    heading = {SCENES: "all scenes", FULL: "all scenes at full size"}.get(scenes, ", ".join(scenes))
    total = [[heading, *COLUMNS]]
    by_scene = [["absolute, relative", *scenes]]
    for name, score in scores.items():
        cell = partial(_cell, blocks=score.blocks)
        total.append([name, *map(cell, score.over_scenes().T)])
        by_scene.append([name, *(f"{cell(v[:, 0])}, {cell(v[:, 1])}" for v in score.values.values())])
    return "\n\n".join(map(_lay_out, (total, by_scene)))


def report_json(scores: Mapping[str, Score]) -> str:
    """Return the columns of each seed by scene, as JSON."""
    columns = {name: {k: v.T.tolist() for k, v in score.values.items()} for name, score in scores.items()}
    return json.dumps({"columns": COLUMNS, "scores": columns})


def interval(values: Array, blocks: bool) -> tuple[float, float]:
    """Return the mean of a column of a `Score` and half of its 95 % interval; of `blocks`, by the jackknife."""
    from scipy.stats import t  # imported where used: scipy.stats takes half a second

    mean, error = map(float, mean_and_error(values))
    others = max(len(values) - 1, 1)
    # of a jackknife, sqrt((B - 1) / B sum (x - mean)^2) = (B - 1) times the standard error of independent values
    return mean, float(t.ppf(0.975, others)) * error * (others if blocks else 1)


def _cell(values: Array, blocks: bool) -> str:
    """Return the mean of a column, and half the width of its interval if there is one."""
    mean, width = interval(values, blocks)
    return f"{mean:.3g} ± {width:.1g}" if width > 5e-4 * abs(mean) else f"{mean:.3g}"


def _lay_out(rows: Sequence[Sequence[str]]) -> str:
    """Return a table in columns, whose first row is its head."""
    widths = np.max([[len(cell) for cell in row] for row in rows], axis=0).tolist()
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
