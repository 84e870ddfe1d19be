"""
What both errors have in common: the texture and the pixel filter
=================================================================

A ratio of errors is nearer to 1 where both errors have a part that no weight changes.
Two such parts may differ between dmis and the thesis's pbrt-v2, and each is tried here,
at half of the thesis's side length, with independent points:

* pbrt-v2 filters textures along the footprint of a camera ray, so that the grid on the
  floor of KILLEROO DIFFUSE adds less noise. At most it adds none: the floor has its
  mean here.
* The public file of the teapot asks for a Gaussian of two pixels, through which pbrt-v2
  splats each sample into 16 pixels. Here pixels are divided into 4x4 parts with 8
  samples each, and the same samples are averaged over a pixel, or by that Gaussian.

All images are unbiased. So the error is the variance over seeds, pilots included, and
no reference is needed.
"""

import csv
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import ROOT, options, show

import dmis
from dmis.base.patches import patch_mean
from dmis.experiment.metrics import ratio_over_blocks
from dmis.filter import gaussian

opts, given = options(
    __file__,
    "errors without a texture, and with a splatted Gaussian",
    seeds={"type": int, "default": 8, "help": "number of seeds (default 8)"},
    csv={"type": Path, "help": "results (default docs/tables/floors.csv)"},
)
WEIGHS = ("heuristic", "samples")
PARTS = 4
"""Parts of a pixel along each side."""
SIGMA = 0.5
"""Standard deviation of pbrt's Gaussian in pixels: exp(-2 d^2)."""


def render(scene, rule, spp, seed):
    """Return an image of the preset, and the weights of its pixels."""
    result = dmis.render(
        scene,
        rule,
        spp,
        seed=seed,
        preset="thesis",
        integrator="direct",
        parallel=opts.threads,
        progress=show(f"{scene.name}, {rule}"),
    )
    return result.image, result.weight


def variance(images):
    """Return the variance of each pixel over seeds, mean of the channels."""
    return np.var(images, axis=0, ddof=1, dtype=np.float64).mean(axis=-1)


def cells(label, base, tilt, shares):
    """Return a row: the error of balance, and ratios of mean errors with intervals."""
    row = [label, f"{base.mean():.2e}"]
    for errors in (tilt, shares):
        row += [f"{value:.3f}" for value in ratio_over_blocks(errors, base)]
    return row


# %%
# The floor of KILLEROO DIFFUSE with and without its texture. Errors fall as 1 / spp, so
# 32 samples of the final pass stand for 122.
scene = opts.scene("killeroo-diffuse", opts.pick(32, 2))
parts = []
for part in scene.parts:
    for lobe in part.material.lobes:
        if isinstance(lobe.reflectance, dmis.Image):
            mean = lobe.reflectance.texels.mean(axis=(0, 1))
            part = replace(part, material=dmis.matte(mean.repeat(3)))
    parts.append(part)
plain = replace(scene, parts=tuple(parts))
rows = []
for label, tried in (("as it is", scene), ("floor without texture", plain)):
    base = variance([render(tried, "balance", 32, k)[0] for k in range(given.seeds)])
    errors = []
    for weigh in WEIGHS:
        rule = f"thesis:weigh={weigh}"
        images = [render(tried, rule, 38, k)[0] for k in range(given.seeds)]
        errors.append(variance(images) * (128 / 122))
    rows.append(cells(f"KILLEROO DIFFUSE, {label} (32 spp)", base, *errors))

# %%
# The teapot, averaged over each pixel and by the Gaussian from the same samples.
shrink = opts.pick(32, 2)
scene, fine = (opts.scene("teapot-area-light", s) for s in (shrink, shrink / PARTS))


def filtered(image):
    """Return the image of pixels, and that of the Gaussian at their centres."""
    box = patch_mean(np.moveaxis(image, -1, 0), PARTS)
    smooth = [gaussian(c, SIGMA * PARTS, 2 * PARTS) for c in np.moveaxis(image, -1, 0)]
    centres = patch_mean(np.array(smooth)[:, 1:-1, 1:-1], 2)[:, ::2, ::2]
    return np.moveaxis(box, 0, -1), np.moveaxis(centres, 0, -1)


def of_seeds(weigh):
    """Return the variances of both filters, of balance or of a rule's weights."""
    images = []
    for seed in range(given.seeds):
        rule = "balance"
        if weigh:
            weight = render(scene, f"thesis:weigh={weigh}", 8, seed)[1]
            weight = weight.repeat(PARTS, axis=0).repeat(PARTS, axis=1)
            rule = dmis.Given(weight, weigh=weigh)
        images.append(filtered(render(fine, rule, 128 // PARTS**2, seed)[0]))
    return [variance(of_filter) for of_filter in zip(*images, strict=True)]


base, *errors = (of_seeds(weigh) for weigh in (None, *WEIGHS))
for k, label in enumerate(("mean over a pixel", "splatted Gaussian")):
    both = [error[k] * (128 / 122) for error in errors]
    rows.append(cells(f"TEAPOT AREA LIGHT, {label}", base[k], *both))

# %%
# Keep the table; ``score_tables.py`` puts it into the page.
tables = opts.output.parent if opts.size == "quick" else ROOT / "docs" / "tables"
path = given.csv or tables / "floors.csv"
with open(path, "w", newline="", encoding="utf-8") as file:
    table = csv.writer(file, lineterminator="\n")
    table.writerow(["scene", "mse", "tilt", "tilt half", "shares", "shares half"])
    table.writerows(rows)
print(path.read_text("utf-8"))
