"""Files of a comparison, from which an interrupted one is resumed.

``results.csv`` has a row for each render, ``comparison.json`` the conditions of the measurement, ``images/`` an EXR
file for each rule and budget.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import re
import warnings
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dmis import __version__
from dmis.base.atomic_files import naming, replacing
from dmis.base.vectors import Array
from dmis.base.window import window_area
from dmis.estimator.settings import Settings
from dmis.experiment import alarm
from dmis.experiment.convergence import MEASURES, Measure
from dmis.experiment.metrics import mse, relative_error, relmse, share_of_few, squared_error
from dmis.experiment.oracle import Oracle
from dmis.experiment.reference import Reference, load_reference
from dmis.experiment.runs import PINNED, Budget, Run, Turn
from dmis.fit.registry import make_rule
from dmis.fit.rule import merge_settings
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


def conditions(
    scene: Scene,
    reference: Reference,
    parallel: Parallel = None,
    settings: Settings | None = None,
    crop: Sequence[int] | None = None,
) -> dict[str, Any]:
    """Return what all rows of a table must share: scene, reference, crop, settings, executor, and the code of dmis."""
    settings = merge_settings(settings or Settings(), scene)[0]
    window_area(crop, scene.camera.resolution)  # a bad one is refused before anything is written
    halves = hashlib.sha256(np.stack([reference.first, reference.second]).tobytes())
    return {
        "dmis": __version__,
        "package_hash": package_hash(),
        "scene": scene.name,
        "scene_hash": fingerprint(scene),
        "resolution": list(scene.camera.resolution),
        "reference": halves.hexdigest()[:16],
        "crop": None if crop is None else list(crop),
        "parallel": describe_parallel(parallel),
        **sampling_hashes(vars(settings)),
        **{name: list(value) if isinstance(value, tuple) else value for name, value in asdict(settings).items()},
    }


def run_by_key(runs: Iterable[Run]) -> dict[tuple[str, int, int], Run]:
    """Return `runs` by rule, samples per pixel and seed."""
    return {(run.rule, run.spp, run.seed): run for run in runs}


def cells(scene: str, run: Run, runs: Mapping[tuple[str, int, int], Run]) -> list[str]:
    """Return the cells of a row: `run`, over the baselines with the same samples and seed, which are among `runs`.

    Both ratios of the pinned baseline's own rows are 1: it is a balance heuristic, with independent points.
    """
    pinned = runs[PINNED, run.spp, run.seed]
    balance = pinned if run.rule == PINNED else runs["balance", run.spp, run.seed]
    seconds = (run.pilot_seconds, run.fit_seconds, run.render_seconds, run.seconds)
    with np.errstate(divide="ignore", invalid="ignore"):  # a black image has no error
        over_balance, over_pinned = np.divide(run.mse, [balance.mse, pinned.mse])
        relative = np.divide(run.relmse, [balance.relmse, pinned.relmse])
    return [
        scene, run.rule, str(run.spp), str(run.seed), str(run.rays), *(f"{t:.4f}" for t in seconds),
        f"{run.mse:.6g}", f"{run.relmse:.6g}", f"{over_balance:.5f}", f"{run.mse_error:.3g}",
        f"{run.cpu_seconds:.4f}", f"{run.mean_z:.3f}", f"{over_pinned:#.5g}",
        *(f"{ratio:#.5g}" for ratio in relative),
    ]  # fmt: skip


class Results:
    """Table ``results.csv`` in `folder`, which is created if it does not exist.

    A ValueError if the folder has rows that were measured under other conditions than `about` (see `conditions`), rows
    of one of the `rules` to measure that has changed since, or rows that cannot be read or be right.
    """

    def __init__(
        self, folder: Path, about: Mapping[str, Any], rules: Iterable[str] = (), reference: Reference | None = None
    ) -> None:
        self.folder = folder
        self._path = folder / "results.csv"
        self.provenance: dict[Budget, Mapping[str, Any]] = {}
        self._area = window_area(about.get("crop"), about["resolution"])
        self._least = dict.fromkeys(("mse", "relmse", "mean_z"), -math.inf)
        if reference is not None:  # (x - r1)(x - r2) is least where x is the mean of both
            window = reference.cropped(self._area)
            self._least |= {"mse": mse(window.mean, window), "relmse": relmse(window.mean, window)}
        self.about = {**about, "rules": {rule: _rule_hash(rule) for rule in rules}}
        (folder / REFERENCE).parent.mkdir(parents=True, exist_ok=True)
        self.runs = self._read() if self._path.exists() else []
        lines = [_line(COLUMNS), *map(self._row, self.runs)]
        files = {"comparison.json": json.dumps(self.about, indent=2) + "\n", "results.csv": "".join(lines)}
        for name, text in files.items():
            with replacing(folder / name) as partial:
                partial.write_text(text, "utf-8", newline="")
        if reference is not None:
            reference.save(folder / REFERENCE)

    def append(self, run: Run, result: Result | None = None) -> None:
        """Add and write a row, and the image of a budget's first render.

        Both baselines with the same samples and seed must have a row, the pinned one first.
        """
        budget = run.rule, run.spp
        if result is not None and budget not in {(other.rule, other.spp) for other in self.runs}:
            self.image(budget).parent.mkdir(exist_ok=True)
            write_image(self.image(budget), result)
        self.runs.append(run)
        with naming(self._path), open(self._path, "a", newline="", encoding="utf-8") as file:
            file.write(self._row(run))

    def image(self, budget: Budget) -> Path:
        """Return the path of the image of a budget."""
        return image_path(self.folder, budget)

    def layers(
        self, budgets: Iterable[Budget], reference: Reference, again: Callable[[Turn], tuple[Result, float]]
    ) -> dict[Budget, dict[str, Array]]:
        """Return the images of `budgets`, with their layers RGB, weight, variance, samples and so on.

        One that cannot be read, or whose error is in no row, is rendered `again` with a seed; a UserWarning says so.
        `provenance` gets that of each.
        """
        images = {}
        for budget in budgets:
            path, rows = self.image(budget), [run for run in self.runs if (run.rule, run.spp) == budget]
            try:
                images[budget], self.provenance[budget] = read_image(path, rows, self.about, reference)
            except (OSError, ValueError) as reason:
                warnings.warn(f"{path} is rendered again: {reason}", stacklevel=3)
                path.parent.mkdir(exist_ok=True)
                result, _ = again((*budget, rows[0].seed))
                write_image(path, result)
                images[budget], self.provenance[budget] = read_exr(path)[0], result.provenance
        return images

    def _row(self, run: Run) -> str:
        """Return the line of ``results.csv`` of a run."""
        return _line(cells(self.about["scene"], run, run_by_key(self.runs)))

    def _read(self) -> list[Run]:
        """Return the runs that ``results.csv`` has, without a last line that an interruption has cut."""
        if self._path.stat().st_size:
            self._compare_conditions()
        runs = list(
            run_by_key(read_runs(self._path, self._least)).values()
        )  # one of rows that two processes have written
        pinned, balance = ({(r.spp, r.seed) for r in runs if r.rule == rule} for rule in (PINNED, "balance"))
        return [r for r in runs if r.rule == PINNED or (r.spp, r.seed) in pinned & balance]

    def _compare_conditions(self) -> None:
        """Check that the rows were measured under the same conditions and with the same rules."""
        try:
            before = dict(json.loads((self.folder / "comparison.json").read_text("utf-8")))
        except (OSError, ValueError, TypeError) as error:
            raise refusal(
                self._path, "has no readable comparison.json with the conditions of its measurement"
            ) from error
        rules = before.get("rules", {})
        if changed := [name for name, now in self.about["rules"].items() if rules.get(name, now) != now]:
            raise refusal(
                self._path,
                f"was measured with another rule {', '.join(changed)}: its options or its class changed, or its "
                f"sampler or techniques",
            )
        self.about["rules"] = rules | self.about["rules"]
        now = {name: value for name, value in self.about.items() if name != "rules"}
        differences = [f"{k} was {before.get(k)}, now is {v}" for k, v in now.items() if before.get(k) != v]
        if differences:
            raise refusal(self._path, f"was measured under other conditions: {'; '.join(differences)}")


def refusal(path: Path, reason: str) -> ValueError:
    """Return the error that refuses a table."""
    return ValueError(f"{path} {reason}; remove it, or choose another directory")


def read_runs(path: Path, least: Mapping[str, float]) -> list[Run]:
    """Return the runs of a ``results.csv``; `least` has the least values of columns that may be negative."""
    line, runs = 1, []
    try:
        text = path.read_text("utf-8")
        for line, row in enumerate(csv.reader(text.splitlines(keepends=True)), 1):
            if line == 1 and tuple(row) != COLUMNS:
                raise ValueError(f"its columns must be {','.join(COLUMNS)}")
            if line > 1 and text.count("\n") >= line:  # the last line may be cut
                runs.append(_run(row, least))
    except (ValueError, csv.Error) as error:
        raise refusal(path, f"cannot be read in line {line} ({error})") from error
    return runs


def read_image(
    path: Path, runs: Sequence[Run], about: Mapping[str, Any], reference: Reference
) -> tuple[dict[str, Array], Mapping[str, Any]]:
    """Return the layers of an image and its provenance.

    A ValueError unless it is of one of the `runs` of a rule and budget, under the conditions `about`.
    """
    layers, attributes = read_exr(path)
    if missing := {"RGB", "weight", "light_samples", "brdf_samples"} - set(layers):
        raise ValueError(f"it has no layer {', '.join(sorted(missing))}")
    provenance = json.loads(attributes.get("dmis.provenance", "{}"))
    rule = "balance" if runs[0].rule == PINNED else runs[0].rule
    keys = [{"scene_hash": about["scene_hash"], "rule": rule, "spp": run.spp, "seed": run.seed} for run in runs]
    key = {name: provenance.get(name) for name in keys[0]}
    if key not in keys:
        raise ValueError(f"its provenance must have one of {keys}; got {key}")
    area = window_area(about.get("crop"), about["resolution"])
    error = mse(layers["RGB"][area], reference.cropped(area))
    if not any(math.isclose(error, run.mse, rel_tol=1e-5) for run in runs):
        raise ValueError(f"its mean squared error is {error:.6g}, that of no row of its rule and samples")
    return layers, provenance


def image_path(folder: Path, budget: Budget) -> Path:
    """Return the path of the image of a budget in the folder of a comparison."""
    rule, spp = budget
    name = re.sub(r"[^A-Za-z0-9.=-]+", "-", rule)
    if name != rule.replace(":", "-").replace(",", "-") or len(name) > 120:  # another rule may have the same name
        name = f"{name[:120]}-{zlib.crc32(rule.encode()):08x}"
    return folder / "images" / f"{name}-{spp}spp.exr"


def _rule_hash(text: str) -> str:
    """Return a hash of a rule's options, and of code that dmis does not ship: its class, own sampler and techniques."""
    rule = make_rule(text)
    return digest([rule, sampling_hashes({"techniques": (), **rule.settings})], f"rule {text}")


def _line(cells: Iterable[str]) -> str:
    """Return a line of a CSV file."""
    text = io.StringIO()
    csv.writer(text).writerow(cells)
    return text.getvalue()


def _run(row: list[str], least: Mapping[str, float]) -> Run:
    """Return the run of a row of ``results.csv``; `least` has the least values of columns that may be negative."""
    if len(row) != len(COLUMNS):
        raise ValueError(f"{len(row)} values for {len(COLUMNS)} columns")
    value, parse = dict(zip(COLUMNS, row)), {"str": str, "int": int, "float": float}
    run = Run(**{field.name: parse[str(field.type)](value[field.name]) for field in fields(Run)})
    for name, number in asdict(run).items():
        low = least.get(name, 0)
        is_unknown = name == "rule" or (name in ("mse_error", "cpu_seconds", "mean_z") and math.isnan(number))
        if not is_unknown and not (math.isfinite(number) and number >= low - 1e-4 * abs(low)):
            raise ValueError(f"{name} must be finite and at least {low:.4g}; got {number}")
    return run


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
    oracle
        Oracle of the scene; None: not rendered.
    provenance
        Provenance of each of `pictures`.
    """

    about: Mapping[str, Any]
    runs: Mapping[Budget, Sequence[Run]]
    pictures: Mapping[Budget, Mapping[str, Array]]
    reference: Reference
    oracle: Oracle | None
    provenance: Mapping[Budget, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return str(self.about["scene"])

    @property
    def area(self) -> tuple[slice, slice]:
        """Rows and columns of the image of which errors were measured."""
        return window_area(self.about.get("crop"), self.reference.first.shape[1::-1])

    @property
    def window(self) -> Reference:
        """Reference of `area`."""
        return self.reference.cropped(self.area)

    @cached_property
    def concentrated(self) -> dict[Measure, float]:
        """Measures by which 1 % of the pixels of balance's image have most of the error, with their share of it."""
        image = self.pictures.get(("balance", max(spp for _, spp in self.runs)))
        if image is None:
            return {}
        shown = image["RGB"][self.area]
        errors = relative_error(shown, self.window), squared_error(shown, self.window)
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
        noise = alarm.reference_noise(self.window, errors)
        means = alarm.summary(run for by_seed in self.runs.values() for run in by_seed)
        pilots = {budget: costly_pilot(provenance) for budget, provenance in self.provenance.items()}
        return [noise, means, *(f"{rule} at {spp} spp: {text}." for (rule, spp), text in pilots.items() if text)]

    @property
    def seeds(self) -> int:
        """Number of seeds."""
        return max(len(by_seed) for by_seed in self.runs.values())


def read_comparison(folder: str | os.PathLike[str]) -> Comparison:
    """Return the comparison that a folder of ``compare`` holds, as its files tell it: nothing is rendered.

    Raises
    ------
    FileNotFoundError
        If there is none, or its reference or an image is missing.
    ValueError
        If a file is damaged.
    """
    folder = Path(folder)
    path, reference = folder / "results.csv", folder / REFERENCE
    again = "the command 'compare' that made the folder, run again, renders what is missing"
    if not path.is_file():
        raise FileNotFoundError(
            f"{folder} has no results.csv: give a folder that dmis compare SCENE -o DIR has written"
        )
    try:
        about = dict(json.loads((folder / "comparison.json").read_text("utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(f"{folder / 'comparison.json'} cannot be read ({error}): {again}") from error
    by_budget: dict[Budget, list[Run]] = {}
    for run in run_by_key(read_runs(path, dict.fromkeys(("mse", "relmse", "mean_z"), -math.inf))).values():
        by_budget.setdefault((run.rule, run.spp), []).append(run)
    if not by_budget:
        raise ValueError(f"{path} has no rows: {again}")
    # as `compare` has them: by samples, and the pinned baseline last
    in_order = sorted(by_budget, key=lambda budget: (budget[1], budget[0] == PINNED))
    runs = {budget: sorted(by_budget[budget], key=lambda run: run.seed) for budget in in_order}
    seeds = {budget: [run.seed for run in of] for budget, of in runs.items()}
    if unlike := [budget for budget, of in seeds.items() if of != seeds.get(("balance", budget[1]))]:
        rule, spp = unlike[0]
        raise ValueError(f"{path} has other seeds of {rule} than of balance at {spp} samples per pixel: {again}")
    truth, pictures, provenance = load_reference(reference), {}, {}
    for budget, by_seed in runs.items():
        path = image_path(folder, budget)
        try:
            pictures[budget], provenance[budget] = read_image(path, by_seed, about, truth)
        except (OSError, ValueError, KeyError) as reason:
            raise ValueError(f"{path} must be the image of a run of results.csv: {reason}; {again}") from reason
    return Comparison(about, runs, pictures, truth, None, provenance)
