"""
Figure 3.3: error against weight, KILLEROO GOLD
===============================================

The same measurement as Figure 3.2 where the thesis's rule loses. On the gold, light sampling nearly always misses the
highlight; on the walls, BRDF sampling nearly always misses the small light. A technique that nearly always misses has
a huge variance, but two samples mostly do not see it: they see zeros, and call the technique good.
"""

import numpy as np
from curves import draw_curve, draw_pilots, mse_curve, patch_at, pilot
from thesis import options

from dmis import plot, render

opts, _ = options(__file__, __doc__)
SIZE = opts.pick(4, 16)

# %%
# Two patches: one on a golden highlight, one on the tiled wall.
scene = opts.scene("killeroo-gold")
patches = {"A: gold": patch_at(scene, 0.125, 0.327, SIZE), "B: wall": patch_at(scene, 0.12, 0.1, SIZE)}

# %%
# The true curve of each, and what eleven independent pilots say.
curves = {name: mse_curve(opts, scene, patch) for name, patch in patches.items()}
pilots = {name: [pilot(scene, patch, seed) for seed in range(11)] for name, patch in patches.items()}
for name, curve in curves.items():
    fitted = ", ".join(f"{p.w:.2f}" for p in pilots[name])
    print(f"{name}: lowest MSE {curve.mse.min():.2e} at w = {curve.w[curve.best]:g}; fitted w of the pilots: {fitted}")

# %%
# The errors span orders of magnitude, so the axis is logarithmic. Parabolas that dip below zero end at the frame.
figure, axes = plot.canvas(1, 3, 17, 5)
plot.picture(
    axes[0, 0], render(scene, "balance", opts.pick(4, 32), seed=1, threads=opts.threads).image, "KILLEROO GOLD"
)
for axis, (name, curve), colour in zip(axes[0, 1:], curves.items(), ("red", "cyan"), strict=True):
    plot.mark(axes[0, 0], patches[name], colour, name[0])
    draw_curve(axis, curve)
    draw_pilots(axis, pilots[name], curve.spp)
    axis.set_yscale("log")
    axis.set_ylim(0.2 * curve.mse.min(), 8 * curve.mse.max())
    axis.set_ylabel(f"mean squared error at {curve.spp} spp (linear RGB²)")
    axis.set_title(f"patch {name}, {SIZE}x{SIZE} pixels")
    axis.legend(fontsize=7.5, loc="upper center")
truth = {name: curve.mse[0] / curve.mse[-1] for name, curve in curves.items()}
below = {
    name: np.mean(
        [
            p.variances[0 if truth[name] > 1 else 2] / curve.spp < curve.mse[0 if truth[name] > 1 else -1]
            for p in pilots[name]
        ]
    )
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
