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

import sys
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import SCENES, machine, options, replace_table, show

import dmis
from dmis.base.patches import patch_mean
from dmis.experiment.metrics import ratio_over_blocks
from dmis.filter import gaussian

opts, given = options(
    __file__,
    "errors without a texture, and with a splatted Gaussian",
    seeds={"type": int, "default": 8, "help": "number of seeds (default 8)"},
    page={"type": Path, "help": "gets the table between its marks 'floors'"},
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


def cell(errors, base):
    """Return a ratio of mean errors with its interval."""
    ratio, half = ratio_over_blocks(errors, base)
    return f"{ratio:.3f} ± {half:.3f}"


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
lines = []
for label, tried in (("as it is", scene), ("floor without texture", plain)):
    base = variance([render(tried, "balance", 32, k)[0] for k in range(given.seeds)])
    cells = []
    for weigh in WEIGHS:
        rule = f"thesis:weigh={weigh}"
        images = [render(tried, rule, 38, k)[0] for k in range(given.seeds)]
        cells.append(cell(variance(images) * (128 / 122), base))
    label = f"KILLEROO DIFFUSE, {label} (32 spp)"
    lines.append(f"| {label} | {base.mean():.2e} | {' | '.join(cells)} |")

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
    cells = [cell(error[k] * (128 / 122), base[k]) for error in errors]
    lines.append(
        f"| TEAPOT AREA LIGHT, {label} | {base[k].mean():.2e} | {' | '.join(cells)} |"
    )

# %%
# Publish the table.
ratios = " and ".join(
    f"{SCENES[name].equal_samples:.3f}"
    for name in ("killeroo-diffuse", "teapot-area-light")
)
about = f"Made on {date.today()} on {machine()}: {given.seeds} seeds, half of the"
about += f" thesis's side length; the thesis has {ratios}."
head = "| scene | MSE of balance | heuristic / balance | samples / balance |"
table = [about, "", head, "|---|---|---|---|", *lines]
print("", *table, sep="\n")
if given.page is not None:
    replace_table(given.page, "floors", *table)
