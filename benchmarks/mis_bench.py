"""Make the data of MIS-Bench, validate its scores by renders, and write its table of results (docs/mis-bench.md).

Run: python benchmarks/mis_bench.py                      (makes what is missing of the data, about ten minutes)
     python benchmarks/mis_bench.py --validate           (compares predicted and measured errors; of --rules RULE ...)
     python benchmarks/mis_bench.py --page               (scores the baselines, and writes the table of the page)
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.atomic_files import replacing
from dmis.base.patches import PATCH
from dmis.base.vectors import Array
from dmis.cli.bench_rules import rules_of
from dmis.estimator.allocation import shares_of
from dmis.estimator.cost import camera_sample_cost
from dmis.estimator.settings import Settings
from dmis.experiment.bench.data import (
    GRID,
    PACKAGED,
    SCENES,
    VERSION,
    Pilots,
    Truth,
    checksum,
    path_of,
    read_pilots,
    read_truth,
)
from dmis.experiment.bench.decide import decide
from dmis.experiment.bench.judge import BASELINES, error_time, random_shares, report, score
from dmis.experiment.bench.rendered import BOUND, SECONDS, fmt, load, measure
from dmis.experiment.bench.samples import COLUMNS, samples
from dmis.experiment.reference import REFERENCE_SEED
from dmis.fit.fixed import Fixed
from dmis.fit.round import Round, pilot_settings
from dmis.pipeline.job import resolve
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.feature_buffers import render_feature_buffers
from dmis.scene.scene import Scene
from dmis.variance.curves import Curves
from dmis.variance.tilt_curves import TiltCurves

ROOT = Path(__file__).resolve().parents[1]
PILOTS = ((0.0, 2, 2), (0.5, 6, 4), (1.0, 2, 2))
"""Each pilot's w, camera samples per pixel, and shading samples of a camera sample."""
SPP = 2048
"""Camera samples per pixel of the curves of shares; as many for tilts and for the power heuristic."""
DIGITS = 10
"""Binary digits of 23 that floating-point columns of pilot tables keep: a relative error of 0.05 %."""


# Scenes and pilots --------------------------------------------------------------------------------------------------


def draw_pilots(scene: Scene, settings: Settings, seed: int) -> Pilots:
    """Return the pilots of one seed."""
    tables = {
        w: samples(scene, spp=spp, weight=w, seed=3 * seed + k, settings=replace(settings, shading_samples=s))
        for k, (w, spp, s) in enumerate(PILOTS)
    }
    return Pilots(tables, render_feature_buffers(scene)[0])


# Converged curves ---------------------------------------------------------------------------------------------------


def measure_truth(scene: Scene, settings: Settings, spp: int = SPP) -> Truth:
    """Return converged variance and cost of each patch, from `spp` camera samples per pixel."""
    job = resolve(scene, Fixed(0.5), spp, REFERENCE_SEED + 4, settings)
    job.scene.prepare()
    settings, paired = job.settings, pilot_settings(job.settings, paired=True)
    height, width = job.budget.shape
    variances, powers, costs = [], [], []
    for number, (y, x) in enumerate(np.ndindex(-(-height // PATCH), -(-width // PATCH))):
        area = ((y * PATCH, min((y + 1) * PATCH, height)), (x * PATCH, min((x + 1) * PATCH, width)))
        tile = partial(Tile, job.seed, 0, number, rows=area[0], columns=area[1])
        measure = partial(_measure, job.scene, tile, spp)
        all_shares, ends = np.array([0, *GRID, 1], np.float32), np.array([0, 0.5, 1], np.float32)
        shares, rays, radiance = measure(paired, partial(Curves, grid=all_shares))
        power, *_ = measure(paired, partial(Curves, combiner="power", grid=ends))
        tilts, *_ = measure(settings, partial(TiltCurves, grid=GRID))
        # V(w) = curve + Var_y(I)
        variance = np.stack([shares["curve"][1:-1] + shares["position"], tilts["curve"]])
        # mean over the patch's pixels of V, and of V / (I^2 + e)
        weights = (
            np.stack([np.ones(radiance.size), 1 / ((radiance * job.gain) ** 2 + BOUND)]) * job.gain**2 / radiance.size
        )
        variances.append(np.einsum("mp,wgp->mwg", weights, variance))
        powers.append(weights @ (power["curve"][1] + power["position"]))
        n = settings.shading_samples
        costs.append(camera_sample_cost(rays, np.stack([GRID, 1 - GRID]), 2 * n, n, settings.techniques))
    grids = (np.moveaxis(np.array(a), 0, -1) for a in (variances, powers, costs))
    v, p, c = (a.reshape(*a.shape[:-1], y + 1, x + 1) for a in grids)
    return Truth(v, p, c, (height, width))


def _measure(
    scene: Scene, tile: Callable[..., Tile], spp: int, settings: Settings, make: Callable[..., Any]
) -> tuple[dict[str, Array], Mapping[str, int], Array]:
    """Return the sums per pixel of a statistic, the rays, and the mean radiance ``(P,)`` of a patch's samples."""
    statistics: list[Any] = []

    def keep(pixels: int, shading_samples: int) -> Any:
        statistics.append(make(pixels, shading_samples))
        return statistics[-1]

    film = render_tile(scene, tile(round=Round(spp, shares_of(0.5), settings, statistic=keep)))
    radiance: Array = film.mean.mean(axis=2).reshape(-1)
    return statistics[0].sums(), film.rays, radiance


# Files --------------------------------------------------------------------------------------------------------------


def write_pilots(path: Path, pilots: Pilots) -> None:
    """Write the pilots of a scene and seed to a file."""
    arrays = {f"feature {name}": values.astype(np.float16) for name, values in pilots.features.items()}
    about = []
    for w, table in pilots.tables.items():
        kinds = table.pixel, table.camera_sample, table.sample_index, table.technique, table.light
        table = table.rows(np.lexsort(kinds))  # rows of one kind in sequence, which compresses well
        arrays |= {f"{w} {name}": _rounded(getattr(table, name)) for name in COLUMNS}
        numbers = {name: getattr(table, name) for name in ("shape", "spp", "shading_samples", "rays")}
        about.append({"w": w, **numbers})
    _write(path, about, arrays)


def write_truth(path: Path, truth: Truth) -> None:
    """Write the converged curves of a scene to a file."""
    _write(path, truth.shape, {name: getattr(truth, name).astype(np.float32) for name in ("variance", "power", "cost")})


def _rounded(column: np.ndarray) -> np.ndarray:
    """Return a column in the smallest integers, or in float32 whose mantissa has `DIGITS` digits and zeros."""
    if column.dtype.kind != "f":
        return column.astype(np.promote_types(*map(np.min_scalar_type, (column.min(), column.max()))))
    rest = np.uint32(1 << 23 - DIGITS)
    return (column.astype(np.float32).view(np.uint32) + rest // 2 & ~(rest - 1)).view(np.float32)


def _write(path: Path, about: Any, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays and what the header says about them."""
    header = json.dumps({"mis-bench": VERSION, "about": about, "checksum": checksum(arrays)})
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial_path, open(partial_path, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, header=np.array(header), **arrays)


def make_data(scenes: Sequence[str], seeds: Sequence[int]) -> None:
    """Make the files of scenes and seeds that are missing, see `dmis.experiment.bench.data.path_of`."""
    for name, seed in [(name, seed) for name in scenes for seed in (None, *seeds) if not path_of(name, seed).exists()]:
        print(path_of(name, seed), flush=True)
        if seed is None:
            write_truth(path_of(name), measure_truth(*load(name)))
        else:
            write_pilots(path_of(name, seed), draw_pilots(*load(name), seed))


# Renders ------------------------------------------------------------------------------------------------------------

REQUIRED = ("fixed:0.25", "balance", "fixed:0.75", "random", "thesis")
"""Rules whose predictions are validated; those of `OTHERS` with less precision, for the order of all ten."""
OTHERS = ("thesis:weigh=samples", "second-moment", "auto", "pbrt", "fixed:1")


def validate(scenes: Sequence[str], rules: Sequence[str] = (*REQUIRED, *OTHERS)) -> None:
    """Print predicted over measured error times cost of maps, and the rank correlation of their order."""
    pairs, agreeing = np.zeros((2, 2))
    named = [item for rule in rules for item in rules_of(rule).items()]
    for name in scenes:
        truth, pilots = read_truth(path_of(name)), read_pilots(path_of(name, 0))
        rows = []
        for text, rule in named:
            final = decide(random_shares if text == "random" else rule, pilots)
            # at few samples, whole numbers of samples cost error where shares are near 0 or 1
            spp = 256 if text == "random" else 32
            value, error = measure(*load(name), final, SECONDS if text in REQUIRED else SECONDS / 2, spp)
            predicted = np.array([error_time(final, truth, m) for m in range(2)])
            rows.append((predicted, value, error))
            ratio = fmt(predicted / value)
            print(
                f"{name:18} {text:21} predicted {fmt(predicted)}, over measured {ratio}, s.e. {fmt(error)}", flush=True
            )
        predicted, value, error = (np.array(a) for a in zip(*rows, strict=True))
        i, j = np.triu_indices(len(rows), 1)
        apart = np.abs(value[i] - value[j]) > 1.96 * (error * value)[i] + 1.96 * (error * value)[j]
        same = np.sign(value[i] - value[j]) == np.sign(predicted[i] - predicted[j])
        pairs, agreeing = pairs + apart.sum(axis=0), agreeing + (apart & same).sum(axis=0)
        tau = (2 * (apart & same).sum(axis=0) - apart.sum(axis=0)) / np.maximum(apart.sum(axis=0), 1)
        print(f"{name:18} pairs with disjoint intervals {apart.sum(axis=0)}, Kendall's tau {fmt(tau)}", flush=True)
    print(f"all scenes: pairs {pairs}, Kendall's tau {fmt((2 * agreeing - pairs) / pairs)}")


def write_page(scenes: Sequence[str]) -> None:
    """Score the baselines and replace the table of the page."""
    sys.path.insert(0, str(ROOT / "examples"))
    from common import replace_table

    scores = {name: score(rule, scenes) for name, rule in BASELINES.items()}
    replace_table(ROOT / "docs" / "mis-bench.md", "mis-bench", report(scores, "markdown").partition("\n\n")[0])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0],
        epilog=f"The data take ten minutes and 50 MB in {path_of(SCENES[0]).parent} (set DMIS_CACHE to move it).",
    )
    parser.add_argument("--scenes", default=",".join(SCENES), help="scenes separated by commas (default: all eight)")
    parser.add_argument("--seeds", type=int, default=4, help="number of seeds of the pilots (default 4)")
    parser.add_argument("--validate", action="store_true", help="compare predicted and measured errors")
    parser.add_argument(
        "--rules", nargs="+", default=(*REQUIRED, *OTHERS), metavar="RULE", help="rules or Python files to validate"
    )
    parser.add_argument("--page", action="store_true", help="write the table of docs/mis-bench.md")
    options = parser.parse_args()
    names = options.scenes.split(",")
    if unknown := set(names) - {*SCENES, *PACKAGED}:
        parser.error(f"--scenes: there is no {', '.join(sorted(unknown))}; choose from {', '.join(SCENES)}")
    make_data([name for name in names if name in SCENES], range(options.seeds))
    make_data([name for name in names if name in PACKAGED], [0])
    if options.validate:
        validate(names, options.rules)
    if options.page:
        write_page(names)
