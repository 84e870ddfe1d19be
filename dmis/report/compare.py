"""Comparison of rules on a scene, as ``python -m dmis compare`` runs it: table, plot of error against time, report."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from dmis.base.atomic_files import check_folder, check_writable
from dmis.base.validate import check_package, whole
from dmis.estimator.settings import Settings, make_settings
from dmis.experiment.reference import Reference, make_reference
from dmis.experiment.runs import PINNED, measure, seed_list
from dmis.experiment.table import REFERENCE, Comparison, Results, conditions, make_comparison
from dmis.fit.registry import RULES, make_rule
from dmis.fit.rule import merge_settings, rule_text
from dmis.pipeline.progress import Progress
from dmis.scene.scene import Scene


def parse_rules(text: str) -> list[str]:
    """Return the rules of a text that separates them by commas, such as ``balance,thesis:patch=8,filter=none``.

    Commas also separate the options of a rule, ``name=value``; anything else begins a new rule. ``all`` stands for
    every rule with its defaults. A ValueError if something is no rule, or an option that its rule does not have.
    """
    rules = split_rules(text)
    for rule in rules:
        make_rule(rule)
    return rules


def split_rules(text: str) -> list[str]:
    """Return the rules of a text as `parse_rules` does, without a check: names of one's own need no plug-in."""
    rules: list[str] = []
    for item in map(str.strip, text.split(",")):
        is_option = "=" in item and ":" not in item.partition("=")[0]
        if item == "all":
            rules += [rule for rule in RULES if rule not in ("fixed", "uniform")]
        elif is_option and rules:
            rules[-1] += f",{item}"
        else:
            rules.append(item)
    return list(dict.fromkeys(rules))


def can_draw() -> bool:
    """Return whether the packages of plots and pages are installed."""
    return find_spec("matplotlib") is not None and find_spec("jinja2") is not None


def check_output(folder: str | os.PathLike[str]) -> None:
    """Raise an OSError if a comparison cannot be written into `folder`, a ValueError if OpenEXR is missing.

    Warn if matplotlib or Jinja2 is, so that plot and report are left out.
    """
    folder = Path(folder)
    for inside in (folder, folder / "images"):
        check_folder(inside)
    files = "results.csv", "comparison.json", "convergence.png", "report.html"
    for name in files if folder.exists() else ():
        check_writable(folder / name)
    check_package("OpenEXR", "a comparison, which keeps images as EXR,", "pip install OpenEXR")
    if not can_draw():
        warnings.warn(
            "convergence.png and report.html are left out, because figures need matplotlib and Jinja2: pip install "
            "'dmis[plot]'. The same call then adds them and renders nothing again",
            stacklevel=1,  # the same place for every caller: a command that checks before `compare` warns once
        )


def compare(
    scene: Scene,
    rules: Sequence[str] = ("balance", "thesis", "auto"),
    spp: Sequence[int] = (128,),
    seeds: int | Sequence[int] = 5,
    reference: Reference | None = None,
    folder: str | os.PathLike[str] | None = None,
    *,
    progress: Progress | bool | None = None,
    **options: Any,
) -> Comparison:
    """Render a scene with several rules, numbers of samples and seeds, and write table, plot and report into `folder`.

    ``results.csv`` gets a row after each render, ``convergence.png`` and ``report.html`` follow (extra ``plot``). Two
    baselines are always measured: the balance heuristic with these settings, and the pinned one
    (`dmis.experiment.runs.PINNED`). A rule whose pilot does not fit into a number of samples is left out there. Rows
    that are in ``results.csv`` are not rendered again, unless the image of their rule and budget is missing.

    Parameters
    ----------
    rules, spp, seeds
        Rules as text with options, camera samples per pixel (pilot included), and a list of seeds or the number K of
        the seeds 0 to K - 1: all combinations are rendered.
    reference
        Image that errors are measured against; None: `dmis.make_reference` of 1024 samples per pixel.
    folder
        Output directory; an existing comparison in it is resumed. None: one with the scene's name.
    progress, options
        See `dmis.experiment.runs.measure`.

    Raises
    ------
    ValueError
        If arguments do not fit, files of `folder` are damaged or of other conditions, or OpenEXR is missing.
    OSError
        If a file of `folder` cannot be written.
    """
    parallel = options.pop("parallel", None)
    settings, folder = make_settings(**options), Path(scene.name if folder is None else folder)
    rules, spp, seeds = _check_arguments(scene, rules, spp, seeds, reference, settings)
    check_output(folder)
    reference = reference or make_reference(scene, 1024, settings=settings, parallel=parallel, progress=progress)
    results = Results(folder, conditions(scene, reference, parallel, settings, rules))
    reference.save(folder / REFERENCE)
    pinned = [(PINNED, n) for n in spp]  # first, because rows are relative to it
    budgets = [(rule, n) for n in spp for rule in rules if make_rule(rule).pilot_samples(n) < n]
    measure(
        scene, [*pinned, *budgets], seeds, reference, done=results.finished(), record=results.append,
        progress=progress, parallel=parallel, settings=settings,
    )  # fmt: skip
    in_order = sorted(dict.fromkeys([*budgets, *pinned]), key=lambda budget: spp.index(budget[1]))
    runs = {budget: [results.runs[*budget, seed] for seed in seeds] for budget in in_order}
    comparison = make_comparison(folder, results.about, runs, reference)
    _draw(comparison, folder)
    return comparison


def _check_arguments(
    scene: Scene, rules: Any, spp: Any, seeds: Any, reference: Any, settings: Settings
) -> tuple[list[str], list[int], list[int]]:
    """Return rules, ``balance`` first, numbers of samples and seeds; a ValueError if an argument is not of its form."""
    for name, values, example in (("rules", rules, '["balance", "thesis:patch=8"]'), ("spp", spp, f"[{spp}]")):
        if isinstance(values, str) or not isinstance(values, Iterable):
            raise ValueError(f"{name} must be a list, such as {example}; got {values!r}")
    for rule in rules:
        if not isinstance(rule, str):
            raise ValueError(
                f"a rule of compare must be text, by which results.csv finds its rows; got {rule_text(rule)}. Name a "
                f'class of your own by dmis.register_rule("mine", MyRule), and write "mine:patch=8"'
            )
    if reference is not None:
        check_reference(reference, scene)
    rules = list(dict.fromkeys(("balance", *rules)))
    for rule in rules:
        merge_settings(settings, scene, make_rule(rule), rule)
    return rules, [whole("spp", n, 1) for n in spp], seed_list(seeds)


def check_reference(reference: Any, scene: Scene) -> None:
    """Raise a ValueError unless `reference` is one of the resolution of a scene."""
    width, height = scene.camera.resolution
    is_fitting = isinstance(reference, Reference) and reference.first.shape[:2] == (height, width)
    if not is_fitting:
        got = reference.first.shape[1::-1] if isinstance(reference, Reference) else type(reference).__name__
        raise ValueError(
            f"reference must be a dmis.Reference of {width}x{height} pixels, like the scene, which "
            f"dmis.make_reference(scene) renders; got {got}"
        )


def _draw(comparison: Comparison, folder: Path) -> None:
    """Write plot and report of a comparison, if their packages are installed."""
    if not can_draw():
        return
    from dmis.report.page import write_report  # imported where used: they bring matplotlib
    from dmis.report.plots import convergence

    convergence(comparison, folder / "convergence.png")
    write_report([comparison], folder / "report.html")
