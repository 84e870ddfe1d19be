"""Make the data of MIS-Bench, and validate its scores by renders (docs/mis-bench.md).

Run: python benchmarks/mis_bench.py                      (makes what is missing of the data, about ten minutes)
     python benchmarks/mis_bench.py --validate           (compares predicted and measured errors; of --rules RULE ...)
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mis_bench_renders import BOUND, SECONDS, fmt, load, measure
from rows import read_rows, write_rows
from show_weights import OTHERS, REQUIRED, VALIDATED_CSV, VALIDATED_FIELDS, ordered_pairs, validated
from tilt_curves import TiltCurves
from weight_bounds import draw, patch_probabilities

from dmis.base.atomic_files import replacing
from dmis.base.patches import PATCH
from dmis.base.plugins import load_plugin
from dmis.base.vectors import Array
from dmis.bench.data import (
    FULL,
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
from dmis.bench.decide import decide
from dmis.bench.judge import error_time, random_shares
from dmis.bench.samples import COLUMNS, samples
from dmis.cli.checks import rules_of
from dmis.estimator.allocation import shares_of
from dmis.estimator.cost import camera_sample_cost, count_camera_samples
from dmis.estimator.settings import Settings
from dmis.experiment.reference import REFERENCE_SEED
from dmis.fit.fixed import Fixed
from dmis.fit.round import Round, pilot_settings
from dmis.pipeline.job import resolve
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.feature_buffers import render_feature_buffers
from dmis.scene.scene import Scene
from dmis.variance.curves import Curves

ROOT = Path(__file__).resolve().parents[1]
PILOTS = ((0.0, 2, 2), (0.5, 6, 4), (1.0, 2, 2))
"""Each pilot's w, camera samples per pixel, and shading samples of a camera sample."""
SPP = 2048
"""Camera samples per pixel of the curves of shares; as many for tilts and for the power heuristic."""
DIGITS, DIGITS_OF_BLOCKS = 10, 8
"""Binary digits of 23 that floating-point columns of pilot tables keep: a relative error of 0.05 %, of blocks 0.2 %."""
CORE = 16
"""Pixels of a side of the part of a block that is judged, in its middle: a patch of ``thesis``."""
BLOCKS = {"full-tt": (12, 48), "full-veach-mis": (12, 32), "full-ten-lights": (12, 32), "full-cornell-path": (12, 48)}
"""Blocks of an image at its full size, and pixels of a side of each, so that files stay below 8 MB."""
USUAL_BLOCKS = 24, 48
"""The same of other scenes; 48 pixels are the core with a patch of ``thesis`` on every side."""


# Scenes and pilots --------------------------------------------------------------------------------------------------


def draw_pilots(scene: Scene, settings: Settings, seed: int) -> Pilots:
    """Return the pilots of one seed."""
    tables = {
        w: samples(scene, spp=spp, weight=w, seed=3 * seed + k, settings=replace(settings, shading_samples=s))
        for k, (w, spp, s) in enumerate(PILOTS)
    }
    return Pilots(tables, render_feature_buffers(scene)[0])


# Converged curves ---------------------------------------------------------------------------------------------------


def measure_truth(scene: Scene, settings: Settings, spp: int = SPP, seed: int = 0) -> Truth:
    """Return converged variance and cost of each patch, from `spp` camera samples per pixel."""
    job = resolve(scene, Fixed(0.5), spp, REFERENCE_SEED + 4 + seed, settings).alone
    job.scene.prepare()
    settings, paired = job.settings, pilot_settings(job.settings, paired=True)
    height, width = job.given_scene.camera.resolution[::-1]
    variances, powers, costs = [], [], []
    for number, (y, x) in enumerate(np.ndindex(-(-height // PATCH), -(-width // PATCH))):
        area = slice(y * PATCH, min((y + 1) * PATCH, height)), slice(x * PATCH, min((x + 1) * PATCH, width))
        tile = partial(Tile, job.seed, 0, number, area=area)
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


# Blocks of an image at its full size ---------------------------------------------------------------------------------


def draw_blocks(scene: Scene, settings: Settings, blocks: int, side: int) -> tuple[np.ndarray, np.ndarray, Array]:
    """Return top left pixels of blocks of the image, and of their cores in them, ``(blocks, 2)`` each, row and column;
    and the number of the image's pixels that a pixel of each core stands for.
    """
    places, weight = draw(patch_probabilities(scene, settings, CORE), blocks, REFERENCE_SEED + 8)
    # a block at the border of the image has its core nearer to the border
    last = [(n - side) // PATCH * PATCH for n in scene.camera.resolution[::-1]]
    corners = np.clip(places * CORE - (side - CORE) // 2, 0, last)
    return corners, places * CORE - corners, weight


def cropped(scene: Scene, corner: np.ndarray, side: int) -> Scene:
    """Return a scene of a square of the image, from its top left pixel on."""
    y, x = corner.tolist()
    return replace(scene, camera=scene.camera.crop((x, y, x + side, y + side)))


def truth_of_blocks(scene: Scene, settings: Settings, blocks: int, side: int, spp: int = SPP) -> Truth:
    """Return the truth of the cores of blocks of the image; it is 0 elsewhere."""
    truths = []
    for k, (corner, core, weight) in enumerate(zip(*draw_blocks(scene, settings, blocks, side), strict=True)):
        truth = measure_truth(cropped(scene, corner + core, CORE), settings, spp, 100 * (k + 1))
        weights = np.full(truth.power.shape[1:], weight * PATCH**2)
        margins = [(a // PATCH, (side - CORE - a) // PATCH) for a in core.tolist()]
        arrays = truth.variance, truth.power, truth.cost, weights
        truths.append([np.pad(a, [*[(0, 0)] * (a.ndim - 2), *margins]) for a in arrays])
    variance, power, cost, weights = (np.concatenate(a, axis=-2) for a in zip(*truths, strict=True))
    return Truth(variance, power, cost, (blocks * side, side), weights, blocks)


def pilots_of_blocks(scene: Scene, settings: Settings, blocks: int, side: int, seed: int) -> Pilots:
    """Return the pilots of one seed of blocks of the image, with its rays."""
    corners, _, weight = draw_blocks(scene, settings, blocks, side)
    parts = [
        draw_pilots(cropped(scene, corner, side), settings, 1000 * (seed + 1) + k) for k, corner in enumerate(corners)
    ]
    tables = {}
    for w in parts[0].tables:
        of_blocks = [replace(part.tables[w], pixel=part.tables[w].pixel + k * side**2) for k, part in enumerate(parts)]
        columns = {column: np.concatenate([getattr(t, column) for t in of_blocks]) for column in COLUMNS}
        # rays of the image, as many as its blocks would have; those of a part of it are of whole tiles
        kinds = sorted(set().union(*(t.rays for t in of_blocks)))
        numbers = np.array([[t.rays.get(kind, 0) / count_camera_samples(t.rays) for kind in kinds] for t in of_blocks])
        per_sample = np.average(numbers, axis=0, weights=weight)
        rays = {kind: round(n * blocks * side**2 * of_blocks[0].spp) for kind, n in zip(kinds, per_sample, strict=True)}
        tables[w] = replace(of_blocks[0], shape=(blocks * side, side), rays=rays, **columns)  # type: ignore[arg-type]
    # materials are numbered by what an image shows, so features are cut from those of the whole image
    whole = render_feature_buffers(scene)[0]
    squares = [[slice(a // PATCH, (a + side) // PATCH) for a in corner] for corner in corners.tolist()]
    features = {key: np.concatenate([a[:, y, x] for y, x in squares], axis=1) for key, a in whole.items()}
    return Pilots(tables, features)


# Files --------------------------------------------------------------------------------------------------------------


def write_pilots(path: Path, pilots: Pilots, digits: int = DIGITS) -> None:
    """Write the pilots of a scene and seed to a file, with some binary digits."""
    arrays = {f"feature {name}": values.astype(np.float16) for name, values in pilots.features.items()}
    about = []
    for w, table in pilots.tables.items():
        kinds = table.pixel, table.camera_sample, table.sample_index, table.technique, table.light
        table = table.rows(np.lexsort(kinds))  # rows of one kind in sequence, which compresses well
        arrays |= {f"{w} {name}": _rounded(getattr(table, name), digits) for name in COLUMNS}
        numbers = {name: getattr(table, name) for name in ("shape", "spp", "shading_samples", "rays")}
        about.append({"w": w, **numbers})
    _write(path, about, arrays)


def write_truth(path: Path, truth: Truth) -> None:
    """Write the converged curves of a scene to a file."""
    names = ("variance", "power", "cost") if truth.weight is None else ("variance", "power", "cost", "weight")
    about = truth.shape if truth.blocks == 1 else (*truth.shape, truth.blocks)
    _write(path, about, {name: getattr(truth, name).astype(np.float32) for name in names})


def _rounded(column: np.ndarray, digits: int) -> np.ndarray:
    """Return a column in the smallest integers, or in float32 whose mantissa has some digits and zeros."""
    if column.dtype.kind != "f":
        return column.astype(np.promote_types(*map(np.min_scalar_type, (column.min(), column.max()))))
    rest = np.uint32(1 << 23 - digits)
    return (column.astype(np.float32).view(np.uint32) + rest // 2 & ~(rest - 1)).view(np.float32)


def _write(path: Path, about: Any, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays and what the header says about them."""
    header = json.dumps({"mis-bench": VERSION, "about": about, "checksum": checksum(arrays)})
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial_path, open(partial_path, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, header=np.array(header), **arrays)


def make_data(scenes: Sequence[str], seeds: Sequence[int]) -> None:
    """Make the files of scenes and seeds that are missing, see `dmis.bench.data.path_of`."""
    for name, seed in [(name, seed) for name in scenes for seed in (None, *seeds) if not path_of(name, seed).exists()]:
        print(path_of(name, seed), flush=True)
        if name in FULL:
            if seed is None:
                write_truth(path_of(name), truth_of_blocks(*load(name), *BLOCKS.get(name, USUAL_BLOCKS)))
            else:
                pilots = pilots_of_blocks(*load(name), *BLOCKS.get(name, USUAL_BLOCKS), seed)
                write_pilots(path_of(name, seed), pilots, DIGITS_OF_BLOCKS)
        elif seed is None:
            write_truth(path_of(name), measure_truth(*load(name)))
        else:
            write_pilots(path_of(name, seed), draw_pilots(*load(name), seed))


# Renders ------------------------------------------------------------------------------------------------------------


def validate(scenes: Sequence[str], rules: Sequence[str] = (*REQUIRED, *OTHERS)) -> None:
    """Write predicted and measured error times cost of maps of rules, and print how many pairs are in one order."""
    load_plugin("objectives")
    rows: list[Mapping[str, object]] = [*read_rows(VALIDATED_CSV)]
    present = {(row["scene"], row["rule"]) for row in rows}
    named = {name: rule for text in rules for name, rule in rules_of(text).items()}
    for name in scenes:
        truth, pilots = read_truth(path_of(name)), read_pilots(path_of(name, 0))
        for text, rule in ((text, rule) for text, rule in named.items() if (name, text) not in present):
            final = decide(random_shares if text == "random" else rule, pilots)
            # at few samples, whole numbers of samples cost error where shares are near 0 or 1
            spp = 256 if text == "random" else 32
            value, error = measure(*load(name), final, SECONDS if text in REQUIRED else SECONDS / 2, spp)
            numbers = *(error_time(final, truth, m) for m in range(2)), *value, *error
            rows.append(dict(zip(VALIDATED_FIELDS, (name, text, *(f"{x:.5g}" for x in numbers)), strict=True)))
            write_rows(VALIDATED_CSV, rows, VALIDATED_FIELDS)
            print(f"{name:18} {text:21} predicted, measured, s.e.: {fmt(np.array(numbers))}", flush=True)
    validated.cache_clear()
    pairs, agreeing = ordered_pairs(scenes, named)
    print(f"pairs with disjoint intervals {pairs}, in the predicted order {agreeing}")


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
    options = parser.parse_args()
    names = options.scenes.split(",")
    if unknown := set(names) - {*SCENES, *FULL, *PACKAGED}:
        parser.error(f"--scenes: there is no {', '.join(sorted(unknown))}; choose from {', '.join((*SCENES, *FULL))}")
    make_data([name for name in names if name in SCENES], range(options.seeds))
    make_data([name for name in names if name in (*FULL, *PACKAGED)], [0])
    if options.validate:
        validate(names, options.rules)
