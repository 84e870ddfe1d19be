"""Scores of weight rules by converged curves, and their tables: error times counted cost of the learned shares."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dmis.base.patches import PATCH, patch_mean, patch_spread
from dmis.base.validate import one_of
from dmis.base.vectors import TINY, Array
from dmis.experiment.bench.data import GRID, HALF, SCENES, Truth, path_of, read_pilots, read_truth, seeds_of
from dmis.experiment.bench.decide import SETTINGS, SPP, AnyRule, decide
from dmis.experiment.bench.samples import SampleTable
from dmis.experiment.metrics import mean_and_error
from dmis.experiment.oracle import HARM_LIMIT, Oracle
from dmis.fit.objectives import OBJECTIVE_NAMES
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
    **{name: name for name in ("second-moment", *OBJECTIVE_NAMES)},
    "shares of auto": "auto", "oracle": "oracle", "oracle, samples": "oracle-samples",
}  # fmt: skip
"""Rules of the table of results, by their names there."""


@dataclass(frozen=True, eq=False)
class Score:
    """Score of a rule: its name, and by scene `COLUMNS` of each seed, ``(seeds, 6)``."""

    rule: str
    values: Mapping[str, Array]

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
        `dmis.experiment.bench.samples.SampleTable`, that returns shares of light samples ``(H, W)``, or a pair of these
        and numbers of camera samples in proportion ``(H, W)``.
    scenes
        Names of `dmis.experiment.bench.data.SCENES`, or of `dmis.experiment.bench.data.PACKAGED`, such as ``small``,
        which come with dmis; or paths of data files of one's own, see docs/bench-files.md.
    seeds
        Seeds of the pilots. Of packaged scenes, and of one's own, those without a file are left out.
    """
    seeds = list(seeds)
    name, values = rule if isinstance(rule, str) else getattr(rule, "__name__", rule_text(rule)), {}
    for scene in [os.fspath(scene) for scene in scenes]:
        truth = read_truth(path_of(scene))
        values[scene] = np.array([_columns(rule, scene, seed, truth) for seed in seeds_of(scene, seeds)])
    return Score(name, values)


def _columns(rule: AnyRule, scene: str, seed: int, truth: Truth) -> list[float]:
    """Return `COLUMNS` of a rule that learns from the pilots of one seed."""
    oracle = isinstance(rule, str) and rule in ORACLES
    final = None if oracle else decide(rule, read_pilots(path_of(scene, seed)), seed)
    adaptive = ORACLES[str(rule)] if final is None else np.ndim(final.spp) > 0 and final.patterns is None
    balance = Budget(SPP, truth.shape, SETTINGS).final(Fit(0.5))
    ratios, savings = [], []
    for measure in range(2):
        curves = Oracle(truth.variance[measure, 0], truth.cost, PATCH, SPP, truth.shape)
        least = curves.limit_with_counts() if adaptive else curves.limit(costly=True)
        of_balance = error_time(balance, truth, measure)
        ratios.append(least if final is None else error_time(final, truth, measure) / of_balance)
        savings.append((1 - ratios[-1]) / (1 - least) if least < 1 else np.nan)
    products = truth.variance[0, 0] * truth.cost
    lit = products[HALF] > 0
    least_product = product = products.min(axis=0)
    if final is not None:
        variance, cost, _ = of_pixels(final, truth, 0)
        product = patch_mean(variance, PATCH) * patch_mean(cost, PATCH)
    regret, harm = (a[lit] / products[HALF][lit] for a in (product - least_product, product))
    return [*ratios, *savings, float(regret.mean()), float((harm > HARM_LIMIT).mean())]


def shares_and_samples(final: Round) -> tuple[Array, Array | int]:
    """Return the shares w of a final round, or its tilts, and its numbers of camera samples.

    Of patterns, whole numbers of samples, the shares count alone: at equal numbers of camera samples.
    """
    if final.patterns is None:
        return (final.shares if final.tilt is None else final.tilt)[0], np.add(final.spp, final.begin)
    _, light, brdf = final.technique_samples()
    return light / np.maximum(light + brdf, 1), 1


def of_pixels(final: Round, truth: Truth, measure: int) -> tuple[Array, Array, Array]:
    """Return variance and cost of a camera sample, and numbers of samples, of each pixel, ``(H, W)``.

    A ValueError if the combiner is not ``balance``, nor ``power`` at w = 1/2.
    """
    shares, samples = (np.broadcast_to(a, truth.shape) for a in shares_and_samples(final))
    y, x = np.ix_(*(np.arange(n) // PATCH for n in truth.shape))
    if final.settings.combiner == "power" and (shares == 0.5).all():
        return truth.power[measure, y, x], truth.cost[HALF, y, x], samples
    one_of("combiner of a rule", final.settings.combiner, ("balance", "power with w = 1/2"))
    # between the points of the grid V is like 1 / (a + b w), as that of one direction is, and C is linear
    shares = np.clip(shares, GRID[0], GRID[-1])
    k = np.clip(np.searchsorted(GRID, shares, "right") - 1, 0, len(GRID) - 2)
    t = (shares - GRID[k]) / (GRID[k + 1] - GRID[k])
    cost = truth.cost if final.tilt is None else np.broadcast_to(truth.cost[HALF], truth.cost.shape)
    curves = truth.variance[measure, 0 if final.tilt is None else 1], cost
    (v_low, v_high), (c_low, c_high) = ((curve[k, y, x], curve[k + 1, y, x]) for curve in curves)
    variance = v_low * v_high / np.maximum((1 - t) * v_high + t * v_low, TINY)
    return variance, (1 - t) * c_low + t * c_high, samples


def error_time(final: Round, truth: Truth, measure: int) -> float:
    """Return error times cost of a round's image, ``mean(V / n) mean(n C)``; measure 0 is absolute, 1 relative."""
    variance, cost, n = of_pixels(final, truth, measure)
    return float((variance / n).mean() * (n * cost).mean())


STYLES = {"text": ("", "  ", ""), "markdown": ("| ", " | ", " |"), "latex": ("", " & ", r" \\"), "json": ("", "", "")}
"""Forms of the tables: how a row begins, what is between its cells, and how it ends."""


def report(scores: Mapping[str, Score], style: str = "text") -> str:
    """Return tables of scores by name: means over seeds, with half the width of their 95 % intervals.

    The first has all columns over all scenes, the second absolute and relative error times cost over that of balance in
    each scene. As JSON, the columns of each seed by scene.
    """
    if style == "json":
        columns = {name: {k: v.T.tolist() for k, v in score.values.items()} for name, score in scores.items()}
        return json.dumps({"columns": COLUMNS, "scores": columns})
    scenes = tuple(next(iter(scores.values())).values)
    heading = "all scenes" if scenes == SCENES else ", ".join(scenes)
    total = [[heading, *COLUMNS], *([name, *map(_cell, s.over_scenes().T)] for name, s in scores.items())]
    by_scene = [["absolute, relative", *scenes]]
    for name, score in scores.items():
        by_scene.append([name, *(f"{_cell(v[:, 0])}, {_cell(v[:, 1])}" for v in score.values.values())])
    return "\n\n".join(_lay_out(rows, style) for rows in (total, by_scene))


def _cell(values: Array) -> str:
    """Return the mean of the values of seeds, and half the width of its interval if there is one."""
    from scipy.stats import t  # imported where used: scipy.stats takes half a second

    mean, error = mean_and_error(values)
    width = t.ppf(0.975, max(len(values) - 1, 1)) * error
    return f"{mean:.3g} ± {width:.1g}" if width > 5e-4 * abs(mean) else f"{mean:.3g}"


def _lay_out(rows: Sequence[Sequence[str]], style: str) -> str:
    """Return a table, whose first row is its head; of LaTeX the rows of a ``tabular``."""
    begin, between, end = STYLES[style]
    widths = np.max([[len(cell) for cell in row] for row in rows], axis=0) * (style == "text")
    lines = [begin + between.join(map(str.ljust, row, widths.tolist())).rstrip() + end for row in rows]
    if style == "markdown":
        lines.insert(1, f"|{'---|' * len(rows[0])}")
    return "\n".join(lines).replace("±", r"$\pm$" if style == "latex" else "±")
