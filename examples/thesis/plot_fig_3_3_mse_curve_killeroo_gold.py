"""
Figure 3.3: error against weight, KILLEROO GOLD
===============================================

The measurement of Figure 3.2 in a scene with two opposite surfaces. On the gold, BRDF
sampling finds the reflection of the light, and the error grows with the share of light
samples. On the diffuse floor the error falls with that share. The axis is linear, so
that a parabola looks like one.
"""

import dmis
from dmis import plot
from examples.gallery import options, print_canvas
from examples.thesis.patch_curves import draw_curve, measure_patch, print_curve

opts, _ = options("plot_fig_3_3_mse_curve_killeroo_gold", __doc__)
PATCH, SPP, SEEDS = opts.pick((4, 16, 2), (16, 122, 24))

# %%
# Red: a horn, with the reflection of the light. Blue: the floor, at the edge of the
# shadow.
scene = opts.scene("killeroo-gold", opts.pick(16, 2, 1))
height, width = scene.camera.resolution[::-1]
corners = {
    "red": (0.125, 0.374),
    "blue": (0.936, 0.281),
}  # top left, in shares of the image
patches = {
    colour: (
        (round(y * height), round(y * height) + PATCH),
        (round(x * width), round(x * width) + PATCH),
    )
    for colour, (y, x) in corners.items()
}
crops = {colour: scene.crop(*patch) for colour, patch in patches.items()}

# %%
# The same steps as for Figure 3.2, from the curve to the weights of pilots.
curves = {
    colour: measure_patch(crop, opts, SPP, SEEDS) for colour, crop in crops.items()
}
for colour, curve in curves.items():
    print_curve(colour, curve)

# %%
# Left: the picture with the two patches. Right: measured curves, exact parabolas, their
# minima, and those of pilots.
figure, axes = print_canvas(1, 2, 3.4, width_ratios=[1, 1.6])
plot.picture(
    axes[0, 0],
    dmis.render(scene, "balance", opts.pick(4, 32), seed=1, preset="thesis").image,
)
axes[0, 0].set_axis_off()
axis = axes[0, 1]
for colour, level in (("red", -3.6), ("blue", -2.9)):
    plot.mark(axes[0, 0], patches[colour], f"tab:{colour}")
    draw_curve(axis, colour, f"{colour}: measured", curves[colour], level)
axis.set_ylim(-4, 6)
figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=2)
red, blue = (curves[colour].error for colour in ("red", "blue"))
opts.save_for_print(
    figure,
    "Figure 3.3: error against weight, KILLEROO GOLD",
    f"""As Figure 3.2, for KILLEROO GOLD ({width}x{height} pixels, patches of
    {PATCH}x{PATCH}, {SPP} camera samples per pixel, {SEEDS} seeds, ± 2 standard
    errors). On the gold (red) BRDF sampling is better: {red[0]:.2f} at w = 0,
    {red[-1]:.2f} at w = 1, in multiples of the error at w = 1/2. On the floor (blue)
    light sampling is: {blue[0]:.1f} and {blue[-1]:.2f}. Dashed: the parabola through
    three exact points of each, and its minimum. Ticks at the bottom: where pilots of
    two samples per pixel put it.""",
    panel=axis,
)
