"""What a comparison keeps in its folder, so that an interrupted one goes on: ``results.csv`` with a row for each
render, ``comparison.json`` with what it was measured on, ``images/`` with an EXR file for each rule and budget.
"""

from __future__ import annotations

import csv
import hashlib
import inspect
import io
import json
import os
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from dmis import __version__
from dmis.experiment import Budget, Run
from dmis.image import read_exr
from dmis.reference import Reference
from dmis.render import fingerprint
from dmis.rules import make_rule
from dmis.scene import Scene
from dmis.settings import Settings
from dmis.vec import Array

COLUMNS = (
    "scene", "rule", "spp", "seed", "rays", "pilot_seconds", "fit_seconds", "render_seconds", "seconds",
    "mse", "relmse", "mse_over_balance", "mse_error", "cpu_seconds",
)  # fmt: skip


def conditions(
    scene: Scene, reference: Reference, threads: int | None, settings: Settings | None = None
) -> dict[str, Any]:
    """What must be the same for rows to stand in one table: the image, what it is measured against, and threads."""
    settings = scene.plan.settle(settings or Settings())
    halves = hashlib.sha256(np.stack([reference.first, reference.second]).tobytes())
    return {
        "dmis": __version__,
        "scene": scene.name,
        "scene_hash": fingerprint(scene),
        "resolution": list(scene.camera.resolution),
        "reference": halves.hexdigest()[:16],
        "threads": threads or os.cpu_count() or 1,
        **{name: list(value) if isinstance(value, tuple) else value for name, value in asdict(settings).items()},
    }


def definition(rule: str) -> str:
    """A short hash of what the rule called so is: its options and the source of its class."""
    made = make_rule(rule)
    try:
        source = inspect.getsource(type(made))
    except (OSError, TypeError):  # typed in, not in a file
        source = ""
    return hashlib.sha256(f"{made!r} {source}".encode()).hexdigest()[:16]


def cells(scene: str, run: Run, balance: Run) -> list[str]:
    """A row: `run`, and that of the balance heuristic with the same samples and seed."""
    seconds = (run.pilot_seconds, run.fit_seconds, run.render_seconds, run.seconds)
    with np.errstate(divide="ignore", invalid="ignore"):  # a black image has no error
        over_balance = np.divide(run.mse, balance.mse)
    return [
        scene, run.rule, str(run.spp), str(run.seed), str(run.rays), *(f"{t:.4f}" for t in seconds),
        f"{run.mse:.6g}", f"{run.relmse:.6g}", f"{over_balance:.5f}", f"{run.mse_error:.3g}",
        f"{run.cpu_seconds:.4f}",
    ]  # fmt: skip


class Results:
    """The rows of ``results.csv`` in `folder`, which is made if it is not there.

    Parameters
    ----------
    about
        See `conditions`.
    rules
        Those that are to be measured.

    Raises
    ------
    ValueError
        If there are rows already that were measured under other conditions, or of a rule that was another then, or
        that cannot be read.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any], rules: Iterable[str] = ()) -> None:
        self.folder, self.about = folder, {**about, "rules": {rule: definition(rule) for rule in rules}}
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "results.csv"
        self.runs = self._read()
        self._beside("comparison.json", json.dumps(self.about, indent=2) + "\n")
        text = io.StringIO()
        csv.writer(text).writerow(COLUMNS)
        self._beside("results.csv", text.getvalue() + "".join(self._row(run) for run in self.runs))

    def append(self, run: Run) -> None:
        """Write a row. That of the balance heuristic with the same samples and seed must be there."""
        self.runs.append(run)
        with open(self._path, "a", newline="", encoding="utf-8") as file:
            file.write(self._row(run))

    def image(self, budget: Budget) -> Path:
        """Where the picture of a budget is."""
        rule, spp = budget
        name = re.sub(r"[^A-Za-z0-9.=-]+", "-", rule)
        if name != rule.replace(":", "-").replace(",", "-") or len(name) > 120:  # another rule's may be the same
            name = f"{name[:120]}-{zlib.crc32(rule.encode()):08x}"
        return self.folder / "images" / f"{name}-{spp}spp.exr"

    def layers(self, budgets: Iterable[Budget]) -> dict[Budget, dict[str, Array]]:
        """The pictures that there are, with their layers RGB, weight, variance, samples."""
        return {budget: read_exr(self.image(budget))[0] for budget in budgets if self.image(budget).exists()}

    def _row(self, run: Run) -> str:
        base = next(r for r in self.runs if (r.rule, r.spp, r.seed) == ("balance", run.spp, run.seed))
        text = io.StringIO()
        csv.writer(text).writerow(cells(self.about["scene"], run, base))
        return text.getvalue()

    def _read(self) -> list[Run]:
        if not self._path.exists():
            return []
        with open(self._path, newline="", encoding="utf-8") as file:
            whole, _, _ = file.read().rpartition("\n")  # an interruption may have cut the last line
        if not whole:
            return []
        self._compare_conditions()
        rows = csv.reader(whole.splitlines())
        if (header := tuple(next(rows))) != COLUMNS:
            raise self._refuse(f"has the columns {','.join(header)} in place of {','.join(COLUMNS)}")
        runs = []
        for line, row in enumerate(rows, 2):
            try:
                runs.append(_run(row))
            except ValueError as error:
                raise self._refuse(f"cannot be read in line {line} ({error})") from error
        balanced = {(run.spp, run.seed) for run in runs if run.rule == "balance"}
        return [run for run in runs if (run.spp, run.seed) in balanced]

    def _compare_conditions(self) -> None:
        try:
            before = json.loads((self.folder / "comparison.json").read_text("utf-8"))
        except (OSError, ValueError) as error:
            raise self._refuse("has no readable comparison.json beside it that says what it was measured on") from error
        rules = before.get("rules", {})
        if changed := [name for name, now in self.about["rules"].items() if rules.get(name, now) != now]:
            raise self._refuse(f"was measured with another rule {', '.join(changed)}: its options or its class changed")
        self.about["rules"] = rules | self.about["rules"]
        now = {name: value for name, value in self.about.items() if name != "rules"}
        differences = [f"{k} was {before.get(k)}, now is {v}" for k, v in now.items() if before.get(k) != v]
        if differences:
            raise self._refuse(f"was measured under other conditions: {'; '.join(differences)}")

    def _refuse(self, reason: str) -> ValueError:
        return ValueError(f"{self._path} {reason}; remove it, or choose another directory")

    def _beside(self, name: str, text: str) -> None:
        """Write a file of the folder; an interruption leaves the previous one whole."""
        partial = self.folder / f"{name}.partial"
        with open(partial, "w", newline="", encoding="utf-8") as file:
            file.write(text)
        os.replace(partial, self.folder / name)


def _run(row: list[str]) -> Run:
    if len(row) != len(COLUMNS):
        raise ValueError(f"{len(row)} values for {len(COLUMNS)} columns")
    value = dict(zip(COLUMNS, row, strict=True))
    return Run(
        rule=value["rule"],
        spp=int(value["spp"]),
        seed=int(value["seed"]),
        rays=int(value["rays"]),
        pilot_seconds=float(value["pilot_seconds"]),
        fit_seconds=float(value["fit_seconds"]),
        render_seconds=float(value["render_seconds"]),
        mse=float(value["mse"]),
        mse_error=float(value["mse_error"]),
        relmse=float(value["relmse"]),
        cpu_seconds=float(value["cpu_seconds"]),
    )
