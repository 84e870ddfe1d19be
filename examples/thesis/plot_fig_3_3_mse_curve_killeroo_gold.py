"""
Figure 3.3: error against weight, KILLEROO GOLD
===============================================

The same measurement as Figure 3.2 where the thesis's rule loses. On the gold, light sampling nearly always misses the
highlight; on the walls, BRDF sampling nearly always misses the small light. A technique that nearly always misses has
a huge variance, but two samples mostly do not see it: they see zeros, and call the technique good.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import options
from curves import draw_patches, measure_patches, patch_at

import dmis
from dmis import plot

opts, _ = options(__file__, __doc__)
SIZE = opts.pick(4, 16)

# %%
# Two patches: one on a golden highlight, one on the tiled wall.
scene = opts.scene("killeroo-gold")
patches = {"A: gold": patch_at(scene, 0.125, 0.327, SIZE), "B: wall": patch_at(scene, 0.12, 0.1, SIZE)}

# %%
# The true curve of each, rendered with fixed weights over many seeds, and what eleven independent pilots say.
curves, pilots = measure_patches(opts, scene, patches, count=11)

# %%
# The errors span orders of magnitude, so the axis is logarithmic. Parabolas that dip below zero end at the frame.
figure, axes = plot.canvas(1, 3, 17, 5)
image = dmis.render(scene, "balance", opts.pick(4, 32), seed=1, parallel=opts.threads).image
draw_patches(axes[0], image, "KILLEROO GOLD", patches, curves, pilots)
for axis, curve in zip(axes[0, 1:], curves.values(), strict=True):
    axis.set_yscale("log")
    axis.set_ylim(0.2 * curve.mse.min(), 8 * curve.mse.max())
    axis.legend(fontsize=7.5, loc="upper center")
truth = {name: curve.mse[0] / curve.mse[-1] for name, curve in curves.items()}
worse = {name: 0 if truth[name] > 1 else -1 for name in truth}
below = {
    name: np.mean([p.variances[worse[name]] / curve.spp < curve.mse[worse[name]] for p in pilots[name]])
    for name, curve in curves.items()
}
opts.save(
    figure,
    "Figure 3.3: error against weight, KILLEROO GOLD",
    f"""As Figure 3.2. Black: measured; red: three sample variances of two samples each, divided by {curve.spp}, and
    the parabola through them; faint red: other random numbers. MSE at w = 0 over MSE at w = 1 is
    {truth["A: gold"]:.2g} in A and {truth["B: wall"]:.2g} in B. Of the eleven pilots, {below["A: gold"]:.0%} (A) and
    {below["B: wall"]:.0%} (B) put the variance of the worse technique too low.""",
)
