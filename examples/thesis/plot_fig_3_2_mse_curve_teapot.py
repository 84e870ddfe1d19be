"""
Figure 3.2: error against weight, TEAPOT AREA LIGHT
===================================================

How does the error of a patch depend on the share w of light samples? Measure it: render the patch again and again
with fixed weights, and take the mean squared error over many seeds. The thesis's rule sees only three points of this
curve, each the variance of two samples per pixel, and puts a parabola through them.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import options
from curves import draw_patches, measure_patches, patch_at

import dmis
from dmis import plot

opts, _ = options(__file__, __doc__)
SIZE = opts.pick(4, 16)

# %%
# Two patches on the floor: next to the reflection of the light, and in the penumbra of the teapot.
scene = opts.scene("teapot-area-light")
patches = {"A: bright floor": patch_at(scene, 0.48, 0.88, SIZE), "B: penumbra": patch_at(scene, 0.66, 0.6, SIZE)}

# %%
# The true curve of each, rendered with fixed weights over many seeds, and what eleven independent pilots say.
curves, pilots = measure_patches(opts, scene, patches, count=11)

# %%
# The picture says where the patches are.
figure, axes = plot.canvas(1, 3, 17, 5)
image = dmis.render(scene, "balance", opts.pick(4, 32), seed=1, parallel=opts.threads).image
draw_patches(axes[0], image, "TEAPOT AREA LIGHT", patches, curves, pilots)
for axis, curve in zip(axes[0, 1:], curves.values(), strict=True):
    axis.set_ylim(0, 2.2 * max(curve.mse[[0, 7, 14]].min(), curve.mse[5:10].max()))
    axis.legend(fontsize=7.5, loc="upper right")
best = {name: f"{curve.w[curve.best]:g}" for name, curve in curves.items()}
opts.save(
    figure,
    "Figure 3.2: error against weight, TEAPOT AREA LIGHT",
    f"""Black: mean squared error of two patches, measured with fixed weights, {curve.spp} camera samples per pixel.
    Red: what the thesis's rule sees of it, three sample variances of two samples per pixel each, divided by
    {curve.spp}, and the parabola through them; faint red: the same with other random numbers. The measured minimum is
    at w = {best["A: bright floor"]} (A) and w = {best["B: penumbra"]} (B). Curves that rise above the frame are cut
    off.""",
)
