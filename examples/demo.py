"""
The demo: learn where light samples should count
================================================

Renders TEAPOT AREA LIGHT twice with 128 camera samples per pixel, which take one light and one BRDF sample each: with
the balance heuristic, and with the thesis's rule, which spends 6 of the 128 samples on a pilot and weighs light against
BRDF samples in the rest as the pilot advises. Samples are independent, as in the thesis. Prints what each costs and how
far each is from the reference, and draws the picture.

The reference, ``data/teapot-area-light-400x400.exr``, comes from `make_reference.py`.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import dmis
from dmis.experiment.metrics import mean_over_blocks, squared_error
from dmis.image import tonemap

try:
    from dmis import plot
except ImportError as missing:
    sys.exit(str(missing))  # before anything is rendered

HERE = Path(__file__).parent
SIZE = 400

parser = argparse.ArgumentParser(description="the balance heuristic and the thesis's rule on one scene")
parser.add_argument("--spp", type=int, default=128, help="camera samples per pixel, pilot included (default 128)")
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--threads", type=int, help="default: one per processor")
parser.add_argument("--quick", action="store_true", help="8 samples per pixel: seconds")
parser.add_argument("-o", "--output", type=Path, default=HERE.parent / "figures" / "demo.png")
options = parser.parse_args()
spp = 8 if options.quick else options.spp

# %%
# One scene, two rules, the same budget: pilot and fit are part of the thesis's.
scene = dmis.load_scene("teapot-area-light", resolution=(SIZE, SIZE))


def progress(stage: str, done: int, total: int) -> None:
    """One line that fills up, where someone is watching."""
    if sys.stderr.isatty():
        print(f"\r{stage} {100 * done // total:3d} %", end="\n" if done == total else "", file=sys.stderr)


results = {
    rule: dmis.render(
        scene, rule, spp, seed=options.seed, sampler="independent", parallel=options.threads, progress=progress
    )
    for rule in ("balance", "thesis")
}

# %%
# Errors against two independent halves of a reference. Blocks of pixels are independent, so the spread of their errors
# tells how well the mean is known.
reference, attributes = dmis.read_exr(HERE / "data" / "teapot-area-light-400x400.exr")
first, second = reference["first"], reference["second"]
squared = {rule: squared_error(r.image, first, second) for rule, r in results.items()}

print(f"teapot-area-light, {SIZE}x{SIZE}, {spp} spp")
print(f"reference: {attributes['spp']} spp, mean squared error {attributes['mse']}\n")
print("| rule    | samples  |     rays | seconds |       MSE (± 1 s.e.)  | MSE / balance |")
print("|---------|----------|----------|---------|-----------------------|---------------|")
baseline = squared["balance"].mean()
for rule, result in results.items():
    mean, spread = mean_over_blocks(squared[rule])
    print(
        f"| {rule:7} | {SIZE * SIZE * spp / 1e6:6.2f} M | {sum(result.rays.values()) / 1e6:6.2f} M "
        f"| {result.seconds['total']:7.2f} | {mean:.3e} ± {spread:.1e} | {mean / baseline:13.3f} |"
    )

# %%
# The picture: what was rendered, what was learned, and how far each rule is from the reference.
figure, ((*axes,),) = plot.canvas(1, 4, 17, 4.6)
axes[0].imshow(tonemap(results["thesis"].image))
axes[0].set_title(f"thesis's rule, {spp} spp")
weights = axes[1].imshow(results["thesis"].weight, cmap="RdBu", vmin=0, vmax=1)
axes[1].set_title("learned weight")
figure.colorbar(weights, ax=axes[1], shrink=0.85, label="weight w of the heuristic  (0: BRDF only, 1: light only)")
top = np.quantile(np.sqrt(np.abs(squared["balance"])), 0.995)
for axis, rule in zip(axes[2:], ("balance", "thesis"), strict=True):
    errors = axis.imshow(np.sqrt(np.abs(squared[rule])), cmap="magma", vmin=0, vmax=top)
    axis.set_title(f"error, {rule}: MSE {squared[rule].mean():.2e}")
figure.colorbar(errors, ax=axes[2:], shrink=0.85, label="|error|, linear RGB (root mean square of the channels)")
for axis in axes:
    axis.set_xticks([])
    axis.set_yticks([])
options.output.parent.mkdir(parents=True, exist_ok=True)
figure.savefig(options.output, dpi=80)
print(f"\n{options.output}")
