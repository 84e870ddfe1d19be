"""
Table 4.1 as a grid
===================

Repeats the thesis's Table 4.1 under several conditions that its text leaves open, and writes the table of
``docs/reproduction.md``. The thesis names neither its sampler nor its samples per light, and gives only a range of
patch sizes, 4 to 32 pixels. So every scene is rendered in two set-ups, with patches of four sizes:

* *as today*: independent points, one light and one BRDF sample at each surface;
* *as in the file*: pbrt-v2's low-discrepancy points, as many light samples as the public scene file asks for, and as
  many BRDF samples. With these points pbrt-v2 rounds the 122 samples of the final pass up to 128, and so does this
  set-up; *6 + 122* takes the first 122 of the shuffled points instead.

KILLEROO GOLD and TT are also rendered by paths, with the patch size that is best in direct lighting. All renders use
the preset ``thesis``.

Each comparison is one line of ``docs/tables/reproduction.csv``, written as soon as it is finished. An interrupted run
continues after the last line. Lines stay valid, because no later version changes the preset. At half the thesis's side
length the script takes about two hours on two cores.
"""

import csv
import sys
from datetime import date
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import SCENES, machine, options, replace_table, show
from scipy.ndimage import binary_dilation

import dmis
from dmis.experiment.metrics import ratio_over_blocks, squared_error

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "tables" / "reproduction.csv"

opts, given = options(
    __file__,
    "the thesis's Table 4.1 by set-up and patch size",
    seeds={"type": int, "default": 3, "help": "number of seeds (default 3)"},
    scenes={"nargs": "+", "default": [*SCENES, "tt-overcast"], "help": "only these scenes"},
    csv={"type": Path, "default": RESULTS, "help": "results; those in it are not made again"},
    page={"type": Path, "help": "a page that gets the table between its marks 'grid'"},
)
PATCHES = (4, 8, 16, 32)
PILOT = 6
"""Camera samples of the rule's pilot."""
UNROUNDED = "as in the file, 6 + 122"
"""Set-up that shows the cost of 122 in place of 128 points, with one size of patches."""
LIGHT_SAMPLES = {"teapot-area-light": 16, "killeroo-diffuse": 4, "killeroo-gold": 4, "tt": 8, "tt-overcast": 8}
"""``nsamples`` of the public pbrt-v2 files; KILLEROO DIFFUSE has no file and takes that of KILLEROO GOLD."""
BY_PATHS = ("killeroo-gold", "tt", "tt-overcast")
LAMP = {"teapot-area-light": 8.0}
"""Radiance of a visible lamp; pixels that contain it are the lamp's edge."""
TOLD = {
    "teapot-area-light": (1.244e-6, 9.975e-7),
    "killeroo-diffuse": (3.250e-4, 3.040e-4),
    "killeroo-gold": (5.751e-3, 6.436e-3),
    "tt": (8.252e-6, 1.061e-5),
    "tt-overcast": (8.252e-6, 1.061e-5),
}
"""The thesis's mean squared errors with equal samples: balance heuristic, its rule."""
MEASURES = ("all", "no_edge", "clipped")
"""All pixels; without those at the lamp's edge; of images clipped to [0, 1]."""
KEY = ("scene", "size", "setup", "integrator", "patch", "seed")
COLUMNS = (*KEY, "seconds", *(f"{m}_{what}" for m in MEASURES for what in ("balance", "rule", "half")))


def setups(name: str) -> dict[str, dict]:
    """Return the settings of each set-up; a share of w = 1/2 divides S shading samples into two halves."""
    in_file = {"sampler": "lowdiscrepancy", "shading_samples": 2 * LIGHT_SAMPLES[name]}
    return {"as today": {"sampler": "independent", "shading_samples": 2}, "as in the file": in_file, UNROUNDED: in_file}


def error_maps(name: str, image: np.ndarray, reference: dmis.Reference) -> dict[str, np.ndarray]:
    """Return the squared errors of pixels that each of `MEASURES` averages."""
    errors = squared_error(image, reference.first, reference.second)
    lamp = reference.mean.min(axis=2) > 0.99 * LAMP.get(name, np.inf)
    edge = binary_dilation(lamp, np.ones((3, 3))) & ~lamp  # neighbours of pixels that see nothing but the lamp
    clipped = squared_error(*(np.clip(x, 0, 1) for x in (image, reference.first, reference.second)))
    return dict(zip(MEASURES, (errors, np.where(edge, 0, errors), clipped), strict=True))


# %%
# Read the finished lines. The first line of the file has the names of the columns.
rows: dict[tuple, dict] = {}
given.csv.parent.mkdir(parents=True, exist_ok=True)
if given.csv.exists():
    with given.csv.open(newline="", encoding="utf-8") as file:
        rows = {tuple(row[column] for column in KEY): row for row in csv.DictReader(file)}
else:
    given.csv.write_text(",".join(COLUMNS) + "\n", "utf-8")


def compare(name: str, scene: dmis.Scene, setup: str, integrator: str, patches, reference) -> None:
    """Render the rule with each patch size and the balance heuristic; write one line per size and seed."""
    size = "x".join(map(str, scene.camera.resolution))
    fields = {"preset": "thesis", "integrator": integrator, **setups(name)[setup]}
    for seed in range(given.seeds):
        todo = [p for p in patches if (name, size, setup, integrator, str(p), str(seed)) not in rows]
        if not todo:
            continue
        more = {"seed": seed, "progress": show(f"{name}, {setup}, {integrator}, seed {seed}"), **fields}
        balance = error_maps(name, dmis.render(scene, "balance", opts.spp, **more).image, reference)
        for patch in todo:
            spp = opts.spp + (PILOT if setup == "as in the file" else 0)
            result = dmis.render(scene, f"thesis:patch={patch}", spp, **more)
            ours = error_maps(name, result.image, reference)
            row = dict(zip(KEY, (name, size, setup, integrator, str(patch), str(seed)), strict=True))
            row["seconds"] = f"{result.seconds['total']:.1f}"
            for measure in MEASURES:
                row[f"{measure}_balance"] = f"{balance[measure].mean():.6e}"
                row[f"{measure}_rule"] = f"{ours[measure].mean():.6e}"
                row[f"{measure}_half"] = f"{ratio_over_blocks(ours[measure], balance[measure])[1]:.6e}"
            rows[tuple(row[column] for column in KEY)] = row
            with given.csv.open("a", newline="", encoding="utf-8") as file:
                csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(row)


def pooled(name: str, size: str, setup: str, integrator: str, patch: int, measure: str) -> tuple[float, ...]:
    """Return the errors of balance and rule, means over seeds, their ratio, and half of its 95 % interval.

    The intervals of the seeds, over blocks of pixels, are independent: half² = Σ (half_k balance_k)² / (Σ balance_k)².
    """
    keys = [(name, size, setup, integrator, str(patch), str(seed)) for seed in range(given.seeds)]
    base, ours, half = (
        np.array([float(rows[key][f"{measure}_{what}"]) for key in keys]) for what in ("balance", "rule", "half")
    )
    return base.mean(), ours.mean(), ours.sum() / base.sum(), np.sqrt(((half * base) ** 2).sum()) / base.sum()


# %%
# Render each scene in each set-up with four patch sizes, then by paths with the best size. References have Sobol points
# and the shading samples of the file, so that their own noise is small beside the errors.
lines = [
    "| scene | set-up | patch | rule / balance | without the lamp's edge | clipped to [0, 1] | MSE of balance "
    "| without the edge | of the rule | without the edge | thesis: ratio | thesis: MSE of balance | of its rule |",
    "|---" * 13 + "|",
]
for name in given.scenes:
    about = SCENES.get(name, SCENES["tt"])
    shrink = opts.pick(16, 2, 1)
    if name in SCENES:
        scene = opts.scene(name, shrink)
    else:
        scene = dmis.load_scene(name, resolution=(round(about.size[0] / shrink), round(about.size[1] / shrink)))
    size = "x".join(map(str, scene.camera.resolution))
    best: dict[str, int] = {}
    for integrator in ("direct", "path") if name in BY_PATHS else ("direct",):
        settings = dmis.Settings(integrator=integrator, shading_samples=2 * LIGHT_SAMPLES[name])
        reference = dmis.make_reference(
            scene, opts.pick(64, 128), settings=settings, progress=show(f"reference of {name}, {integrator}")
        )
        for setup in setups(name):
            if setup == UNROUNDED:
                patches = (16,) if integrator == "direct" else ()
            else:
                patches = PATCHES if integrator == "direct" else (best[setup],)
            compare(name, scene, setup, integrator, patches, reference)
            results = {patch: [pooled(name, size, setup, integrator, patch, m) for m in MEASURES] for patch in patches}
            best |= {setup: min(results, key=lambda patch: results[patch][0][2])} if results else {}
            for patch, values in results.items():
                ratios = " | ".join(f"{value:.3f} ± {half:.3f}" for _, _, value, half in values)
                errors = " | ".join(f"{values[k][which]:.3e}" for which in (0, 1) for k in (0, 1))
                told = f"{TOLD[name][1] / TOLD[name][0]:.3f} | {TOLD[name][0]:.3e} | {TOLD[name][1]:.3e}"
                how = f"{setup}, {integrator}"
                lines.append(f"| {name} {size} | {how} | {patch} | {ratios} | {errors} | {told} |")
                print(lines[-1], flush=True)

# %%
# Write the table. Intervals are 95 %, from the spread over blocks of pixels.
seeds = f"{given.seeds} seed{'' if given.seeds == 1 else 's'}"
about = f"Made on {date.today()} with {seeds} at {opts.spp} camera samples per pixel, on {machine()}."
print("", about, "", *lines, sep="\n")
if given.page is not None:
    replace_table(given.page, "grid", about, "", *lines)
