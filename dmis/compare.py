"""``python -m dmis compare``: rules side by side, a table in ``results.csv``, a plot of error against time."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from dmis.experiment import Budget, Run, measure, median_seconds
from dmis.fit import RULES, make_rule
from dmis.image import read_exr
from dmis.metrics import ratio
from dmis.reference import Reference
from dmis.scene import Scene

COLUMNS = (
    "scene", "rule", "spp", "seed", "rays", "pilot_seconds", "fit_seconds", "render_seconds", "seconds",
    "mse", "relmse", "mse_over_balance",
)  # fmt: skip


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
        try:
            image = np.load(path, allow_pickle=False)
        except (ValueError, EOFError) as error:
            raise ValueError(f"reference {path} is not readable as a NumPy array: {error}") from error
        layers = {"RGB": image}
    else:
        layers, _ = read_exr(path)
    first = layers.get("first", layers.get("RGB"))
    if first is None or first.ndim != 3 or first.shape[2] != 3:
        raise ValueError(f"reference {path} must hold an image of three channels, or two halves first and second")
    return Reference(first, layers.get("second", first), 0)


def compare(
    scene: Scene,
    rules: Sequence[str],
    spp: Sequence[int],
    seeds: Sequence[int],
    reference: Reference,
    folder: Path,
    *,
    threads: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> str:
    """Measure `rules` at each number of samples; write ``results.csv`` row by row, then ``convergence.png``.

    The balance heuristic is measured whether it is asked for or not. A rule whose pilot does not fit in a budget is
    left out there.

    Returns
    -------
    A table in Markdown: for each budget and rule the ratio of its mean squared error to that of the balance
    heuristic, with its 95 % confidence interval over the seeds.
    """
    width, height = scene.camera.resolution
    if reference.first.shape[:2] != (height, width):
        raise ValueError(f"reference must be of {width}x{height} pixels; got {reference.first.shape[1::-1]}")
    folder.mkdir(parents=True, exist_ok=True)
    budgets = [
        (rule, n) for n in spp for rule in dict.fromkeys(("balance", *rules)) if sum(make_rule(rule).pilot.values()) < n
    ]
    with open(folder / "results.csv", "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        baseline: dict[tuple[int, int], float] = {}

        def record(run: Run) -> None:
            if run.rule == "balance":
                baseline[run.spp, run.seed] = run.mse
            table.writerow(
                [
                    scene.name, run.rule, run.spp, run.seed, run.rays, *(f"{t:.4f}" for t in (
                        run.pilot_seconds, run.fit_seconds, run.render_seconds, run.seconds)),
                    f"{run.mse:.6g}", f"{run.relmse:.6g}", f"{run.mse / baseline[run.spp, run.seed]:.5f}",
                ]
            )  # fmt: skip
            file.flush()

        runs = measure(scene, budgets, seeds, reference, threads=threads, record=record, progress=progress)
    try:
        _draw(scene, runs, folder / "convergence.png")
    except ImportError:
        pass  # the table is there without matplotlib
    return summary(runs)


def summary(runs: dict[Budget, list[Run]]) -> str:
    """The table that `compare` returns."""
    lines = ["| spp | rule | MSE | MSE / balance | seconds | time / balance |", "|---|---|---|---|---|---|"]
    for (rule, spp), mine in runs.items():
        base = runs["balance", spp]
        value, half = ratio(np.array([run.mse for run in mine]), np.array([run.mse for run in base]))
        interval = "" if np.isnan(half) else f" ± {half:.3f}"
        seconds = median_seconds(mine)
        lines.append(
            f"| {spp} | {rule} | {np.mean([run.mse for run in mine]):.3e} | {value:.3f}{interval} | {seconds:.2f} "
            f"| {seconds / median_seconds(base):.2f} |"
        )
    return "\n".join(lines)


def _draw(scene: Scene, runs: dict[Budget, list[Run]], path: Path) -> None:
    """Error against seconds and against rays, a line for each rule."""
    from dmis import plot

    figure, axes = plot.canvas(1, 2, 12, 5)
    for rule in dict.fromkeys(rule for rule, _ in runs):
        mine = [of for (name, _), of in runs.items() if name == rule]
        mse = [np.mean([run.mse for run in of]) for of in mine]
        spread = [np.std([run.mse for run in of]) for of in mine]
        seconds = [median_seconds(of) for of in mine]
        rays = [np.mean([run.rays for run in of]) for of in mine]
        for axis, x in zip(axes[0], (seconds, rays), strict=True):
            axis.errorbar(x, mse, spread, marker="o", markersize=4, capsize=3, label=rule)
    for axis, name in zip(axes[0], ("seconds", "rays"), strict=True):
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel(name)
        axis.set_ylabel("mean squared error (linear RGB²)")
        axis.grid(alpha=0.3, which="both")
        axis.legend(fontsize=8)
    seeds = max(len(of) for of in runs.values())
    plot.save(
        figure,
        path,
        f"{scene.name}: error against time and rays",
        f"""Mean squared error against the reference, mean over {seeds} seeds; bars are the standard deviation between
        seeds. Time is from the pilot to the last sample, fit included.""",
    )
