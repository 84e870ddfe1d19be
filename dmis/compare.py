"""``python -m dmis compare``: rules side by side, ``results.csv``, a plot of error against time, a report."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmis.convergence import gains
from dmis.experiment import Budget, Run, measure
from dmis.fit import settle
from dmis.image import read_exr, write_image
from dmis.oracle import Oracle, cached_oracle
from dmis.reference import Reference
from dmis.render import Result
from dmis.results import COLUMNS as COLUMNS
from dmis.results import Results, conditions
from dmis.rules import RULES, make_rule
from dmis.scene import Scene
from dmis.settings import Settings
from dmis.vec import Array


@dataclass(frozen=True, eq=False)
class Comparison:
    """Rules side by side on one scene: what `dmis.report` makes a page of.

    Attributes
    ----------
    about
        See `dmis.results.conditions`.
    runs
        Of each rule and budget, in the order of the seeds, as they are in ``results.csv``.
    pictures
        One image of each rule and budget, with the layers RGB, weight, variance, samples.
    oracle
        None: not known.
    """

    about: Mapping[str, Any]
    runs: Mapping[Budget, Sequence[Run]]
    pictures: Mapping[Budget, Mapping[str, Array]]
    reference: Reference
    oracle: Oracle | None

    @property
    def scene(self) -> str:
        """Its name."""
        return str(self.about["scene"])

    @property
    def rules(self) -> list[str]:
        """The balance heuristic first."""
        return list(dict.fromkeys(rule for rule, _ in self.runs))

    @property
    def seeds(self) -> int:
        """Number of them."""
        return max(len(of) for of in self.runs.values())


def split_rules(text: str) -> list[str]:
    """Rules separated by commas, which also separate a rule's options: ``balance,thesis:patch=8,filter=none``.

    What begins with the name of a rule is a new rule. ``all`` stands for every rule with its defaults.

    Raises
    ------
    ValueError
        If one of them is not a rule.
    """
    rules: list[str] = []
    for part in text.split(","):
        name = part.partition(":")[0].strip()
        if name == "all":
            rules += [rule for rule in RULES if rule not in ("fixed", "uniform")]
        elif name in RULES or not rules:
            rules.append(part.strip())
        else:
            rules[-1] += f",{part.strip()}"
    for rule in rules:
        make_rule(rule)
    return list(dict.fromkeys(rules))


def load_reference(path: Path) -> Reference:
    """A reference image: an EXR file with layers ``first`` and ``second``, or with one image; or a ``.npy`` array.

    Raises
    ------
    ValueError
        If it is none of these, or not an image.
    """
    if path.suffix == ".npy":
        if not path.is_file():
            raise FileNotFoundError(f"there is no reference {path}")
        try:
            image: Array = np.lib.format.open_memmap(path, mode="r")  # no pickles, no memory for what it says
        except Exception as error:  # whatever its header makes the reader say
            raise ValueError(f"reference {path} is not readable as a NumPy array: {error}") from error
        layers = {"RGB": image}
    else:
        layers, _ = read_exr(path)
    first = layers.get("first", layers.get("RGB"))
    second = layers.get("second", first)
    if first is None or second is None or any(half.ndim != 3 or half.shape[2] != 3 for half in (first, second)):
        raise ValueError(f"reference {path} must hold an image of three channels, or two halves first and second")
    if not all(np.issubdtype(half.dtype, np.floating) and np.isfinite(half).all() for half in (first, second)):
        raise ValueError(f"reference {path} must hold finite numbers, because errors are measured against them")
    return Reference(np.array(first), np.array(second), 0)


def compare(
    scene: Scene,
    rules: Sequence[str],
    spp: Sequence[int],
    seeds: Sequence[int],
    reference: Reference,
    folder: str | os.PathLike[str],
    *,
    settings: Settings | None = None,
    oracle: Oracle | None = None,
    threads: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Comparison:
    """Measure `rules` at each number of samples; write ``results.csv`` row by row, then ``convergence.png`` and
    ``report.html`` (needs matplotlib; left out without).

    The balance heuristic is measured whether it is asked for or not. A rule whose pilot does not fit in a budget is
    left out there. What ``results.csv`` has already is not rendered again.

    Parameters
    ----------
    settings
        Of all rules, and of the reference; see `dmis.render.render`.
    oracle
        For the maps of regret; default: the one that is on disk, if there is.

    Raises
    ------
    ValueError
        If the reference is of another size, or ``results.csv`` was measured under other conditions.
    """
    width, height = scene.camera.resolution
    if reference.first.shape[:2] != (height, width):
        raise ValueError(f"reference must be of {width}x{height} pixels; got {reference.first.shape[1::-1]}")
    if oracle is not None and oracle.variance.shape[1:] != (-(-height // oracle.patch), -(-width // oracle.patch)):
        rows, columns = oracle.variance.shape[1:]
        raise ValueError(
            f"oracle must cover {width}x{height} pixels; got {columns}x{rows} patches of {oracle.patch} pixels"
        )
    rules = tuple(dict.fromkeys(("balance", *rules)))
    for rule in rules:  # which may refuse the settings
        settle(make_rule(rule), rule, settings or Settings())
    folder = Path(folder)
    results = Results(folder, conditions(scene, reference, threads, settings), rules)
    budgets = [(rule, n) for n in spp for rule in rules if sum(make_rule(rule).pilot.values()) < n]
    seen = {(run.rule, run.spp) for run in results.runs}

    def keep(budget: Budget, result: Result) -> None:
        if budget not in seen:
            results.image(budget).parent.mkdir(exist_ok=True)
            write_image(results.image(budget), result)
            seen.add(budget)

    measure(
        scene, budgets, seeds, reference,
        settings=settings, threads=threads, done=tuple(results.runs),
        keep=keep, record=results.append, progress=progress,
    )  # fmt: skip
    written = {(run.rule, run.spp, run.seed): run for run in Results(folder, results.about).runs}
    runs = {(rule, n): [written[rule, n, seed] for seed in seeds] for rule, n in budgets}
    if oracle is None:
        usual = Settings().sampler  # which oracles do not depend on
        oracle = cached_oracle(scene, settings=settings and replace(settings, sampler=usual))
    comparison = Comparison(results.about, runs, results.layers(runs), reference, oracle)
    try:
        from dmis.report import write_report
        from dmis.report_plots import convergence
    except ImportError:
        return comparison  # the table is there without matplotlib
    convergence(comparison, folder / "convergence.png")
    write_report([comparison], folder / "report.html")
    return comparison


def summary(runs: Mapping[Budget, Sequence[Run]]) -> str:
    """A table in Markdown: for each budget and rule the ratio of its mean squared error to that of the balance
    heuristic, with its 95 % confidence interval over the seeds.
    """
    lines = ["| spp | rule | MSE | MSE / balance | seconds | time / balance |", "|---|---|---|---|---|---|"]
    found = gains(runs)
    base = {gain.spp: gain.seconds for gain in found if gain.rule == "balance"}
    for g in found:
        interval = "" if np.isnan(g.interval) else f" ± {g.interval:.3f}"
        lines.append(
            f"| {g.spp} | {g.rule} | {g.mse:.3e} | {g.over_balance:.3f}{interval} | {g.seconds:.2f} "
            f"| {g.seconds / base[g.spp]:.2f} |"
        )
    return "\n".join(lines)
