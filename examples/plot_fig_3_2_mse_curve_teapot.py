"""
Figure 3.2: error against weight, TEAPOT AREA LIGHT
===================================================

How does the error of a patch depend on the share w of light samples? Measure it: render the patch again and again
with fixed weights, and take the mean squared error over many seeds. The thesis's rule sees only three points of this
curve, each the variance of two samples per pixel, and puts a parabola through them.
"""

from curves import draw_curve, draw_pilots, mse_curve, patch_at, pilot
from thesis import options

from dmis import plot, render

opts, _ = options(__file__, __doc__)
SIZE = opts.pick(4, 16)

# %%
# Two patches on the floor: next to the reflection of the light, and in the penumbra of the teapot.
scene = opts.scene("teapot-area-light")
patches = {"A: bright floor": patch_at(scene, 0.48, 0.88, SIZE), "B: penumbra": patch_at(scene, 0.66, 0.6, SIZE)}

# %%
# The true curve of each, and what eleven independent pilots say.
curves = {name: mse_curve(opts, scene, patch) for name, patch in patches.items()}
pilots = {name: [pilot(scene, patch, seed) for seed in range(11)] for name, patch in patches.items()}
for name, curve in curves.items():
    fitted = ", ".join(f"{p.w:.2f}" for p in pilots[name])
    print(f"{name}: lowest MSE {curve.mse.min():.2e} at w = {curve.w[curve.best]:g}; fitted w of the pilots: {fitted}")

# %%
# The picture says where the patches are.
figure, axes = plot.canvas(1, 3, 17, 5)
plot.picture(
    axes[0, 0], render(scene, "balance", opts.pick(4, 32), seed=1, threads=opts.threads).image, "TEAPOT AREA LIGHT"
)
for axis, (name, curve), colour in zip(axes[0, 1:], curves.items(), ("red", "cyan"), strict=True):
    plot.mark(axes[0, 0], patches[name], colour, name[0])
    draw_curve(axis, curve)
    draw_pilots(axis, pilots[name], curve.spp)
    axis.set_ylim(0, 2.2 * max(curve.mse[[0, 7, 14]].min(), curve.mse[5:10].max()))
    axis.set_ylabel(f"mean squared error at {curve.spp} spp (linear RGB²)")
    axis.set_title(f"patch {name}, {SIZE}x{SIZE} pixels")
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
