"""
The demo: three rules in the same time
======================================

Renders TEAPOT AREA LIGHT three times in about the same CPU time, always with Sobol points: with the balance heuristic;
with the thesis's rule, which learns from 6 pilot samples per pixel how to weigh light samples against BRDF samples; and
with ``auto``, the default rule, which learns how many of each to take, and how many samples each pixel gets. Prints the
cost and the error of each rule, and draws the picture of README.

The reference, ``data/teapot-area-light-400x400.exr``, comes from `make_reference.py`.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import dmis
from dmis.experiment.metrics import mean_over_blocks, squared_error

try:
    from dmis import plot
except ImportError as missing:
    sys.exit(str(missing))  # before anything is rendered

HERE = Path(__file__).parent
SIZE = 400
BUDGETS = {"balance": 64, "thesis": 64, "auto": 27}
"""Samples per pixel, pilot included. One of `auto` costs more: most are where there is light to sample."""
TITLES = {"balance": "balance heuristic", "thesis": "thesis's rule", "auto": "dmis: auto"}
WHOLE = 0, 20, 400, 320
"""The part of the image that is shown, x0, y0, x1, y1: teapot, board and lamp."""
WINDOW = 225, 195, 345, 275
"""The part that is enlarged: the board below the spout."""

parser = argparse.ArgumentParser(description="three rules on one scene, in about the same CPU time")
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--threads", type=int, help="default: one per processor")
parser.add_argument("--quick", action="store_true", help="8 samples per pixel: too few for auto to learn from")
parser.add_argument("-o", "--output", type=Path, default=HERE.parent / "figures" / "demo.png")
options = parser.parse_args()


def progress(stage: str, done: int, total: int) -> None:
    """One line that fills up, where someone is watching."""
    if sys.stderr.isatty():
        print(f"\r{stage} {100 * done // total:3d} %", end="\n" if done == total else "", file=sys.stderr)


# %%
# One scene, three rules. Pilot and fit are part of a rule's samples, and of its CPU time.
scene = dmis.load_scene("teapot-area-light", resolution=(SIZE, SIZE))
budgets = dict.fromkeys(BUDGETS, 8) if options.quick else BUDGETS
results, seconds = {}, {}
for rule, spp in budgets.items():
    begin = time.process_time()
    results[rule] = dmis.render(scene, rule, spp, seed=options.seed, parallel=options.threads, progress=progress)
    seconds[rule] = time.process_time() - begin

# %%
# Errors against two independent halves of a reference: MSE, and relMSE, which divides by the square of the reference.
# Blocks of pixels are independent, so the spread of their errors tells how well the mean is known.
reference, attributes = dmis.read_exr(HERE / "data" / "teapot-area-light-400x400.exr")
first, second = reference["first"], reference["second"]
bright = np.square((first + second) / 2).mean(axis=2) + 0.01
squared = {rule: squared_error(result.image, first, second) for rule, result in results.items()}
mse = {rule: error.mean() / squared["balance"].mean() for rule, error in squared.items()}
relmse = {rule: (error / bright).mean() / (squared["balance"] / bright).mean() for rule, error in squared.items()}

print(f"teapot-area-light, {SIZE}x{SIZE}, Sobol points")
print(f"reference: {attributes['spp']} spp, mean squared error {attributes['mse']}\n")
print("| rule    | spp | rays    | CPU seconds | MSE (± 1 s.e.)      | MSE / balance | relMSE / balance |")
print("|---------|-----|---------|-------------|---------------------|---------------|------------------|")
for rule, result in results.items():
    mean, spread = mean_over_blocks(squared[rule])
    print(
        f"| {rule:7} | {budgets[rule]:3} | {sum(result.rays.values()) / 1e6:5.1f} M | {seconds[rule]:11.2f} "
        f"| {mean:.3e} ± {spread:.1e} | {mse[rule]:13.3f} | {relmse[rule]:16.3f} |"
    )

# %%
# The picture: each render, a part of it, and how far each pixel is from the reference, on one scale.
figure, axes = plot.canvas(3, 3, 7, 5.6)
top = np.quantile(np.sqrt(np.abs(squared["balance"])), 0.99)
for (image, part, error), (rule, title) in zip(axes.T, TITLES.items(), strict=True):
    plot.picture(image, results[rule].image, title, WHOLE)
    plot.picture(part, results[rule].image, window=WINDOW)
    x0, y0, x1, y1 = WHOLE
    plot.heat(error, np.sqrt(np.abs(squared[rule]))[y0:y1, x0:x1], window=WHOLE, cmap="magma", vmin=0, vmax=top)
    plot.mark(image, WINDOW, "white", 1)
    for axis in (image, part, error):
        axis.set(xticks=[], yticks=[], xlabel="", ylabel="")
    image.title.set_fontsize(16)
    error.set_xlabel("error 1" if rule == "balance" else f"error {mse[rule]:.2f}", fontsize=16)
options.output.parent.mkdir(parents=True, exist_ok=True)
figure.savefig(options.output, dpi=120)
print(f"\n{options.output}")
