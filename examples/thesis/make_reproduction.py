"""
Table 4.1 as a grid
===================

Repeats the thesis's Table 4.1 under several conditions that its text leaves open, and
writes the table of ``docs/tables.md``. The thesis names neither its sampler nor
its samples per light, and gives only a range of patch sizes, 4 to 32 pixels. So every
scene is rendered in two set-ups, with patches of four sizes:

* *one sample each*: independent points, one light and one BRDF sample at each surface;
* *as in the file*: pbrt-v2's low-discrepancy points, as many light samples as the
  public scene file asks for, and as many BRDF samples. With these points pbrt-v2 rounds
  the 122 samples of the final pass up to 128, and so does this set-up; *6 + 122* takes
  the first 122 of the shuffled points instead.

KILLEROO GOLD and TT are also rendered by paths, with the patch size that is best in
direct lighting. All renders use the preset ``thesis``.

Each comparison is one line of ``docs/tables/reproduction.csv``, written as soon as it
is finished. An interrupted run continues after the last line. Lines stay valid, because
no later version changes the preset. At half the thesis's side length the script takes
about two hours on two cores. With ``--large 1`` the setting of each scene whose ratio
and error are nearest to the thesis's is also rendered at the thesis's own resolution,
with one seed.
"""

import csv
import sys
from collections.abc import Callable
from datetime import date
from functools import cache, partial
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
    scenes={
        "nargs": "+",
        "default": [*SCENES, "tt-overcast"],
        "help": "only these scenes",
    },
    finished={
        "action": "store_true",
        "help": "render nothing: tables of the settings that are in the results",
    },
    large={
        "type": int,
        "default": 0,
        "help": "seeds of the nearest setting at the thesis's resolution (default 0)",
    },
    csv={
        "type": Path,
        "default": RESULTS,
        "help": "results; those in it are not made again",
    },
    page={
        "type": Path,
        "help": "gets the table between its marks 'grid'; reproduction.md beside it "
        "the nearest settings",
    },
)
PATCHES = (4, 8, 16, 32)
PILOT = 6
"""Camera samples of the rule's pilot."""
UNROUNDED = "as in the file, 6 + 122"
"""Set-up that shows the cost of 122 in place of 128 points, with one size of patches.
"""
LIGHT_SAMPLES = {
    "teapot-area-light": 16,
    "killeroo-diffuse": 4,
    "killeroo-gold": 4,
    "tt": 8,
    "tt-overcast": 8,
}
"""``nsamples`` of the public pbrt-v2 files; KILLEROO DIFFUSE has no file and takes that
of KILLEROO GOLD.
"""
BY_PATHS = ("killeroo-gold", "tt", "tt-overcast")
SHRINK = {("tt", "path"): 4, ("tt-overcast", "direct"): 4, ("tt-overcast", "path"): 4}
"""Divisors of the thesis's side length other than 2, by scene and integrator. There is
no TT without a sun in the thesis.
"""
LAMP = {"teapot-area-light": 8.0}
"""Radiance of a visible lamp; pixels that contain it are the lamp's edge."""
TOLD = {
    "teapot-area-light": (1.244e-6, 9.975e-7),
    "killeroo-diffuse": (3.250e-4, 3.040e-4),
    "killeroo-gold": (5.751e-3, 6.436e-3),
    "tt": (8.252e-6, 1.061e-5),
}
"""The thesis's mean squared errors with equal samples: balance heuristic, its rule."""
MEASURES = {
    "all": "all pixels",
    "no_edge": "without the lamp's edge",
    "clipped": "clipped to [0, 1]",
}
"""The pixels and values that enter a mean squared error."""
KEY = ("scene", "size", "setup", "integrator", "patch", "seed")
COLUMNS = (
    *KEY,
    "seconds",
    *(f"{m}_{what}" for m in MEASURES for what in ("balance", "rule", "half")),
)


def setups(name: str, integrator: str) -> dict[str, dict]:
    """Return the settings of each set-up; a share of w = 1/2 divides S shading samples
    into two halves. Paths of pbrt-v2 take one of each, whatever the file asks for.
    """
    light_samples = LIGHT_SAMPLES[name] if integrator == "direct" else 1
    in_file = {"sampler": "lowdiscrepancy", "shading_samples": 2 * light_samples}
    return {
        "one sample each": {"sampler": "independent", "shading_samples": 2},
        "as in the file": in_file,
        UNROUNDED: in_file,
    }


def error_maps(
    name: str, image: np.ndarray, reference: dmis.Reference
) -> dict[str, np.ndarray]:
    """Return the squared errors of pixels that each of `MEASURES` averages."""
    errors = squared_error(image, reference.first, reference.second)
    lamp = reference.mean.min(axis=2) > 0.99 * LAMP.get(name, np.inf)
    edge = (
        binary_dilation(lamp, np.ones((3, 3))) & ~lamp
    )  # neighbours of pixels that see nothing but the lamp
    clipped = squared_error(
        *(np.clip(x, 0, 1) for x in (image, reference.first, reference.second))
    )
    return dict(
        zip(MEASURES, (errors, np.where(edge, 0, errors), clipped), strict=True)
    )


# %%
# Read the finished lines. The first line of the file has the names of the columns.
rows: dict[tuple, dict] = {}
given.csv.parent.mkdir(parents=True, exist_ok=True)
if given.csv.exists():
    with given.csv.open(newline="", encoding="utf-8") as file:
        rows = {
            tuple(row[column] for column in KEY): row for row in csv.DictReader(file)
        }
else:
    given.csv.write_text(",".join(COLUMNS) + "\n", "utf-8")


def scene_of(name: str, shrink: int) -> tuple[dmis.Scene, str]:
    """Return a scene at the thesis's side length over `shrink`, and its size."""
    if name in SCENES:
        scene = opts.scene(name, shrink)
    else:
        width, height = SCENES["tt"].size
        scene = dmis.load_scene(
            name, resolution=(round(width / shrink), round(height / shrink))
        )
    return scene, "x".join(map(str, scene.camera.resolution))


def reference_of(
    name: str, scene: dmis.Scene, integrator: str, spp: int
) -> Callable[[], dmis.Reference]:
    """Return the function that renders the reference, once.

    References have Sobol points and the shading samples of the file: their own noise is
    small beside the errors. It is in no mean, because the two halves are independent;
    large images average more of it, and do with fewer samples.
    """
    samples = setups(name, integrator)["as in the file"]["shading_samples"]
    settings = dmis.Settings(integrator=integrator, shading_samples=samples)
    progress = show(f"reference of {name}, {integrator}")
    return cache(
        partial(
            dmis.make_reference,
            scene,
            spp,
            settings=settings,
            progress=progress,
        )
    )


def compare(
    name: str,
    scene: dmis.Scene,
    setup: str,
    integrator: str,
    patches,
    reference: Callable[[], dmis.Reference],
    seeds,
) -> None:
    """Render the rule with each patch size and the balance heuristic; write one line
    per size and seed.

    `reference` is only called if a line is missing.
    """
    size = "x".join(map(str, scene.camera.resolution))
    fields = {
        "preset": "thesis",
        "integrator": integrator,
        **setups(name, integrator)[setup],
    }
    for seed in range(seeds):
        todo = [
            p
            for p in patches
            if (name, size, setup, integrator, str(p), str(seed)) not in rows
        ]
        if not todo:
            continue
        converged = reference()
        more = {
            "seed": seed,
            "progress": show(f"{name}, {setup}, {integrator}, seed {seed}"),
            **fields,
        }
        balance = error_maps(
            name, dmis.render(scene, "balance", opts.spp, **more).image, converged
        )
        for patch in todo:
            spp = opts.spp + (PILOT if setup == "as in the file" else 0)
            result = dmis.render(scene, f"thesis:patch={patch}", spp, **more)
            ours = error_maps(name, result.image, converged)
            row = dict(
                zip(
                    KEY,
                    (name, size, setup, integrator, str(patch), str(seed)),
                    strict=True,
                )
            )
            row["seconds"] = f"{result.seconds['total']:.1f}"
            for measure in MEASURES:
                row[f"{measure}_balance"] = f"{balance[measure].mean():.6e}"
                row[f"{measure}_rule"] = f"{ours[measure].mean():.6e}"
                row[f"{measure}_half"] = (
                    f"{ratio_over_blocks(ours[measure], balance[measure])[1]:.6e}"
                )
            rows[tuple(row[column] for column in KEY)] = row
            with given.csv.open("a", newline="", encoding="utf-8") as file:
                csv.DictWriter(file, COLUMNS, lineterminator="\n").writerow(row)


def is_finished(name: str, size: str, setting: tuple, seeds: int) -> bool:
    """Return whether the results have a line for each seed."""
    keys = ((name, size, *map(str, setting), str(seed)) for seed in range(seeds))
    return all(key in rows for key in keys)


def pooled(
    name: str,
    size: str,
    setup: str,
    integrator: str,
    patch: int,
    measure: str,
    seeds: int,
) -> tuple:
    """Return the errors of balance and rule, means over seeds, their ratio, and half of
    its 95 % interval.

    The intervals of the seeds, over blocks of pixels, are independent: half² = Σ
    (half_k balance_k)² / (Σ balance_k)².
    """
    keys = [
        (name, size, setup, integrator, str(patch), str(seed)) for seed in range(seeds)
    ]
    base, ours, half = (
        np.array([float(rows[key][f"{measure}_{what}"]) for key in keys])
        for what in ("balance", "rule", "half")
    )
    return (
        base.mean(),
        ours.mean(),
        ours.sum() / base.sum(),
        np.sqrt(((half * base) ** 2).sum()) / base.sum(),
    )


def nearest(name: str, settings: dict[tuple, list[tuple]]) -> tuple[tuple, str]:
    """Return the setting and the measure that are nearest to the thesis's ratio and
    error.

    Nearest in error (by its logarithm) among those whose interval covers the thesis's
    ratio, and of several with this error nearest in ratio; if none covers it, nearest
    in ratio. Points of the unrounded set-up are not the thesis's.
    """
    error, ratio = TOLD[name][0], TOLD[name][1] / TOLD[name][0]
    candidates = [
        (
            abs(value - ratio) > half,
            (
                abs(np.log(base / error))
                if abs(value - ratio) <= half
                else abs(value - ratio)
            ),
            abs(value - ratio),
            *at,
        )
        for setting, values in settings.items()
        for at, (base, _, value, half) in zip(
            ((setting, m) for m in MEASURES), values, strict=True
        )
        if setting[0] != UNROUNDED
    ]
    return min(candidates)[3:]


def verdict(name: str, size: str, setting: tuple, measure: str, seeds: int) -> str:
    """Return the line of a setting beside the thesis."""
    setup, integrator, patch = setting
    base, _, ratio, half = pooled(name, size, setup, integrator, patch, measure, seeds)
    error, thesis = TOLD[name][0], TOLD[name][1] / TOLD[name][0]
    covers = (
        "yes"
        if abs(ratio - thesis) <= half
        else f"no, by {abs(ratio - thesis) - half:.3f}"
    )
    how = f"{setup}, {integrator}, patch {patch}, {MEASURES[measure]}"
    return (
        f"| {name} {size} | {how} | {ratio:.3f} ± {half:.3f} | {thesis:.3f} | {covers} "
        f"| {base:.3e} | {error:.3e} | {base / error:.2g} |"
    )


# %%
# Each scene: the set-ups, four sizes of patches; then paths with the best of them; then
# the nearest to the thesis.
lines = [
    "| scene | set-up | patch | rule / balance | without the lamp's edge"
    " | clipped to [0, 1] | MSE of balance |",
    "|---" * 7 + "|",
]
verdicts = [
    (
        "| scene | nearest setting | rule / balance | thesis | covered | MSE of balance"
        " | thesis | ours / thesis |"
    ),
    "|---" * 8 + "|",
]
for name in given.scenes:
    settings: dict[tuple, list[tuple]] = {}
    for integrator in ("direct", "path") if name in BY_PATHS else ("direct",):
        shrink = SHRINK.get((name, integrator), 2)
        scene, size = scene_of(name, opts.pick(32, shrink, 1))
        reference = reference_of(name, scene, integrator, opts.pick(16, 128))
        for setup in setups(name, integrator):
            tried = {
                key[2]: values[0][2]
                for key, values in settings.items()
                if key[:2] == (setup, "direct")
            }
            if integrator == "direct":
                patches = (16,) if setup == UNROUNDED else PATCHES
            else:
                patches = (min(tried, key=tried.__getitem__),) if tried else ()
            if setup == UNROUNDED and integrator == "path":
                continue
            if given.finished:
                patches = [
                    p
                    for p in patches
                    if is_finished(name, size, (setup, integrator, p), given.seeds)
                ]
            compare(name, scene, setup, integrator, patches, reference, given.seeds)
            for patch in patches:
                values = [
                    pooled(name, size, setup, integrator, patch, m, given.seeds)
                    for m in MEASURES
                ]
                settings[setup, integrator, patch] = values
                ratios = [f"{value:.3f} ± {half:.3f}" for _, _, value, half in values]
                if name not in LAMP:
                    ratios[list(MEASURES).index("no_edge")] = "–"
                lines.append(
                    f"| {name} {size} | {setup}, {integrator} | {patch} |"
                    f" {' | '.join(ratios)} | {values[0][0]:.3e} |"
                )
                print(lines[-1], flush=True)
    if not settings or name not in SCENES:
        continue
    setting, measure = nearest(name, settings)
    shrink = SHRINK.get((name, setting[1]), 2)
    _, size = scene_of(name, opts.pick(32, shrink, 1))
    verdicts.append(verdict(name, size, setting, measure, given.seeds))
    if given.large:
        scene, size = scene_of(name, opts.pick(16, 1))
        setup, integrator, patch = setting
        if not given.finished:
            compare(
                name,
                scene,
                setup,
                integrator,
                (patch,),
                reference_of(name, scene, integrator, 32),
                given.large,
            )
        if is_finished(name, size, setting, given.large):
            verdicts.append(verdict(name, size, setting, measure, given.large))
    print(verdicts[-1], flush=True)

# %%
# The tables; intervals are 95 %, over blocks of pixels.
seeds = f"{given.seeds} seed{'' if given.seeds == 1 else 's'}"
about = (
    f"Made on {date.today()} with {seeds} at {opts.spp} camera samples per pixel, on"
    f" {machine()}."
)
print("", about, "", *verdicts, "", *lines, sep="\n")
if given.page is not None:
    large = " (1 at the thesis's resolution)" if given.large == 1 else ""
    replace_table(
        given.page.with_name("reproduction.md"),
        "nearest",
        about.replace(seeds, seeds + large),
        "",
        *verdicts,
    )
    replace_table(given.page, "grid", about, "", *lines)
