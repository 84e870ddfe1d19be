"""Files of a comparison, which the same command continues.

``results.csv`` has a row for each render, ``comparison.json`` the conditions of the measurement, ``images/`` the
reference and an EXR file for each rule and budget.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dmis import __version__
from dmis.base.atomic_files import naming, replacing
from dmis.base.vectors import Array
from dmis.estimator.settings import Settings
from dmis.experiment import alarm
from dmis.experiment.convergence import MEASURES, Measure
from dmis.experiment.metrics import relative_error, share_of_few, squared_error
from dmis.experiment.reference import Reference, load_reference
from dmis.experiment.runs import PINNED, Budget, Run, Turn
from dmis.fit.registry import make_rule
from dmis.fit.rule import merge_settings, needed_settings
from dmis.image import read_exr
from dmis.pipeline.executor import Parallel, describe_parallel
from dmis.pipeline.fingerprint import digest, fingerprint, package_hash, sampling_hashes
from dmis.pipeline.result import Result, costly_pilot, write_image
from dmis.scene.scene import Scene

COLUMNS = (
    "scene", "rule", "spp", "seed", "rays", "pilot_seconds", "fit_seconds", "render_seconds", "seconds",
    "mse", "relmse", "mse_over_balance", "mse_error", "cpu_seconds",
    "mean_z", "mse_over_pinned", "relmse_over_balance", "relmse_over_pinned",
)  # fmt: skip
REFERENCE = Path("images", "reference.exr")
"""The reference in the folder of a comparison."""
FEW_LIMIT = 0.5
"""Share of an error in 1 % of the pixels, above which a comparison says that few pixels decide it."""
AGAIN = "the command 'compare' that made the folder, run again, renders what is missing"
"""Advice of errors about a folder that lacks something."""


def conditions(
    scene: Scene,
    reference: Reference,
    parallel: Parallel = None,
    settings: Settings | None = None,
    rules: Iterable[str] = (),
) -> dict[str, Any]:
    """Return what all rows of a table must share: scene, reference, settings, executor, and all code.

    A rule has a hash of its options, and of its class, sampler and techniques if dmis does not ship these.
    """
    settings = merge_settings(settings or Settings(), scene)[0]
    about = {
        "dmis": __version__,
        "package_hash": package_hash(),
        "scene": scene.name,
        "scene_hash": fingerprint(scene),
        "resolution": scene.camera.resolution,
        "reference": hashlib.sha256(np.stack([reference.first, reference.second]).tobytes()).hexdigest()[:16],
        "parallel": describe_parallel(parallel),
        **sampling_hashes(vars(settings)),
        **asdict(settings),
    }
    for text in rules:
        rule = make_rule(text)
        about[f"rule {text}"] = digest(
            [rule, sampling_hashes({"techniques": (), **needed_settings(rule)})], f"rule {text}"
        )
    return dict(json.loads(json.dumps(about)))  # as a file has it: lists in the place of tuples


def run_by_key(runs: Iterable[Run]) -> dict[Turn, Run]:
    """Return `runs` by rule, samples per pixel and seed; of several with one key the last."""
    return {(run.rule, run.spp, run.seed): run for run in runs}


def cells(scene: str, run: Run, runs: Mapping[Turn, Run]) -> list[str]:
    """Return the cells of a row: `run`, over the baselines with the same samples and seed, which are among `runs`.

    Ratios of the pinned baseline's own rows are 1: it is a balance heuristic, with independent points.
    """
    pinned = runs[PINNED, run.spp, run.seed]
    balance = pinned if run.rule == PINNED else runs["balance", run.spp, run.seed]
    values = {"scene": scene, "seconds": run.seconds, **asdict(run)}
    for measure in MEASURES:
        for name, baseline in (("balance", balance), ("pinned", pinned)):
            with np.errstate(divide="ignore", invalid="ignore"):  # a black image has no error
                values[f"{measure}_over_{name}"] = np.divide(values[measure], getattr(baseline, measure))
    return [_text(values[name]) for name in COLUMNS]


def _text(value: object) -> str:
    """Return a value as text, numbers that are not whole with six digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class Results:
    """Table ``results.csv`` in `folder`, to which rows are added; without one, a new table.

    `runs` are those of its rows. A ValueError if these cannot be read, or were measured under other conditions than
    `about`, see `conditions`; conditions of other rules stay.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any]) -> None:
        self.folder = folder
        self._path = folder / "results.csv"
        self.about = dict(about)
        self.runs: dict[Turn, Run] = {}
        rows = f"{','.join(COLUMNS)}\n"
        if self._path.exists():
            before = read_conditions(folder)
            changes = [f"{k} was {before[k]}, now is {v}" for k, v in about.items() if before.get(k, v) != v]
            if changes:
                raise refusal(self._path, f"was measured under other conditions: {'; '.join(changes)}")
            self.about = before | self.about
            self.runs = read_runs(self._path)
            rows = _whole_lines(self._path)
        (folder / "images").mkdir(parents=True, exist_ok=True)
        for name, text in (("comparison.json", json.dumps(self.about, indent=2) + "\n"), ("results.csv", rows)):
            with replacing(folder / name) as partial:
                partial.write_text(text, "utf-8", newline="")

    def append(self, run: Run, result: Result | None = None) -> None:
        """Add the row of a run, and the image if it is the first of its budget.

        Both baselines with the same samples and seed must have a row, the pinned one first.
        """
        budget = run.rule, run.spp
        path = image_path(self.folder, budget)
        if result is not None and not (path.exists() and budget in {key[:2] for key in self.runs}):
            write_image(path, result)
        digits: dict[str, Any] = {
            name: float(_text(value)) for name, value in asdict(run).items() if isinstance(value, float)
        }
        run = replace(run, **digits)  # as it will be read
        self.runs[run.rule, run.spp, run.seed] = run
        with naming(self._path), open(self._path, "a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerow(cells(self.about["scene"], run, self.runs))

    def finished(self) -> list[Run]:
        """Return the runs of the budgets that have an image."""
        return [run for run in self.runs.values() if image_path(self.folder, (run.rule, run.spp)).exists()]


def refusal(path: Path, reason: str) -> ValueError:
    """Return the error that refuses a table."""
    return ValueError(f"{path} {reason}; remove it, or choose another directory")


def read_conditions(folder: Path) -> dict[str, Any]:
    """Return the conditions of the comparison in a folder; a ValueError if its file is missing or damaged."""
    try:
        return dict(json.loads((folder / "comparison.json").read_text("utf-8")))
    except (OSError, ValueError, TypeError) as error:
        reason = f"has no readable comparison.json with the conditions of its measurement ({error})"
        raise refusal(folder / "results.csv", reason) from error


def _whole_lines(path: Path) -> str:
    """Return a file without a last line that an interruption has cut."""
    text = path.read_text("utf-8", errors="replace")
    return text[: text.rfind("\n") + 1]


def read_runs(path: Path) -> dict[Turn, Run]:
    """Return the runs of a ``results.csv``, see `run_by_key`."""
    rows = csv.DictReader(_whole_lines(path).splitlines())
    try:
        if tuple(rows.fieldnames or ()) != COLUMNS:
            raise ValueError(f"its columns must be {','.join(COLUMNS)}")
        return run_by_key([Run.read(row) for row in rows])
    except (ValueError, csv.Error) as error:
        raise refusal(path, f"cannot be read in line {rows.line_num} ({error})") from error


def image_path(folder: Path, budget: Budget) -> Path:
    """Return the path of the image of a budget in the folder of a comparison."""
    rule, spp = budget
    name = re.sub(r"[^A-Za-z0-9.=-]+", "-", rule)
    if name != rule.replace(":", "-").replace(",", "-") or len(name) > 120:  # another rule may have the same name
        name = f"{name[:120]}-{zlib.crc32(rule.encode()):08x}"
    return folder / "images" / f"{name}-{spp}spp.exr"


@dataclass(frozen=True, eq=False)
class Comparison:
    """Runs of several rules on one scene, with their images; `dmis.report.page` shows it as a page.

    Attributes
    ----------
    about
        Conditions of the measurement, see `conditions`.
    runs
        Runs of each rule and budget, in the order of the seeds, as in ``results.csv``.
    pictures
        One image of each rule and budget, with the layers RGB, weight, variance, samples.
    provenance
        Provenance of each of `pictures`.
    """

    about: Mapping[str, Any]
    runs: Mapping[Budget, Sequence[Run]]
    pictures: Mapping[Budget, Mapping[str, Array]]
    reference: Reference
    provenance: Mapping[Budget, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return str(self.about["scene"])

    @cached_property
    def concentrated(self) -> dict[Measure, float]:
        """Measures by which 1 % of the pixels of balance's image have most of the error, with their share of it."""
        image = self.pictures.get(("balance", max(spp for _, spp in self.runs)))
        if image is None:
            return {}
        errors = (of(image["RGB"], self.reference) for of in (relative_error, squared_error))
        shares = zip(MEASURES, map(share_of_few, errors), strict=True)
        return {measure: share for measure, share in shares if share > FEW_LIMIT}

    def few_pixels(self) -> str:
        """Return a sentence for each measure in `concentrated`; else ""."""
        return " ".join(
            f"{share:.0%} of balance's {MEASURES[measure]} lies in 1 % of the pixels (first seed, "
            f"{max(spp for _, spp in self.runs)} samples per pixel): its standard errors and the intervals of its "
            f"ratios may be much too short, and no ratio is bold."
            for measure, share in self.concentrated.items()
        )

    def alarms(self) -> list[str]:
        """Return lines about a reference that is too noisy, images with another mean, and costly pilots; or ""."""
        errors = (float(np.mean([run.mse for run in by_seed])) for by_seed in self.runs.values())
        noise = alarm.reference_noise(self.reference, errors)
        means = alarm.summary(run for by_seed in self.runs.values() for run in by_seed)
        pilots = {budget: costly_pilot(provenance) for budget, provenance in self.provenance.items()}
        return [noise, means, *(f"{rule} at {spp} spp: {text}." for (rule, spp), text in pilots.items() if text)]

    @property
    def seeds(self) -> int:
        """Number of seeds."""
        return max(len(by_seed) for by_seed in self.runs.values())


def make_comparison(
    folder: Path,
    about: Mapping[str, Any],
    runs: Mapping[Budget, Sequence[Run]],
    reference: Reference,
) -> Comparison:
    """Return the comparison of runs whose images are in `folder`; a ValueError if one cannot be read."""
    pictures, provenance = {}, {}
    for budget in runs:
        path = image_path(folder, budget)
        try:
            pictures[budget], attributes = read_exr(path)
            provenance[budget] = json.loads(attributes["dmis.provenance"])
        except (OSError, ValueError, KeyError) as error:
            raise ValueError(
                f"{path} must be an image that dmis rendered ({error!r}); remove it, and {AGAIN}"
            ) from error
    return Comparison(about, runs, pictures, reference, provenance)


def read_comparison(folder: str | os.PathLike[str]) -> Comparison:
    """Return the comparison that a folder of ``compare`` holds, as its files tell it: nothing is rendered.

    Raises
    ------
    FileNotFoundError
        If there is none, or its reference is missing.
    ValueError
        If a file is damaged, or an image or a row is missing.
    """
    folder = Path(folder)
    path = folder / "results.csv"
    if not path.is_file():
        raise FileNotFoundError(
            f"{folder} has no results.csv: give a folder that dmis compare SCENE -o DIR has written"
        )
    about = read_conditions(folder)
    rows = sorted(read_runs(path).values(), key=lambda run: (run.spp, run.rule == PINNED, run.seed))
    if not rows:
        raise ValueError(f"{path} has no rows: {AGAIN}")
    runs: dict[Budget, list[Run]] = {}
    for run in rows:
        runs.setdefault((run.rule, run.spp), []).append(run)
    for (rule, spp), by_seed in runs.items():
        if [run.seed for run in by_seed] != [run.seed for run in runs.get(("balance", spp), [])]:
            raise ValueError(f"{path} has other seeds of {rule} than of balance at {spp} samples per pixel: {AGAIN}")
    return make_comparison(folder, about, runs, load_reference(folder / REFERENCE))
