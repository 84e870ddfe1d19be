"""
Figure 3.3: error against weight, KILLEROO GOLD
===============================================

The measurement of Figure 3.2 in a scene with two opposite surfaces. On the gold, BRDF
sampling finds the reflection of the light, and the error grows with the weight of light
sampling. On the diffuse floor the error falls with the share of light samples, and a
tilt beyond 1/2 changes nothing.
"""

from dmis.examples.gallery import options
from dmis.examples.patch_curves import draw_curves, measure_patch, print_curves

opts, _ = options("plot_fig_3_3_mse_curve_killeroo_gold", __doc__)

# %%
# Red: a horn, with the reflection of the light. Blue: the floor, at the edge of the
# shadow. The steps are those of Figure 3.2.
scene = opts.scene("killeroo-gold", opts.pick(16, 2, 1))
corners = {"red": (0.125, 0.374), "blue": (0.936, 0.281)}
curves = {
    colour: measure_patch(scene, opts, corner) for colour, corner in corners.items()
}
print_curves(curves)

# %%
# The picture with the two patches, their curves, and the weights of pilots.
figure, axis = draw_curves(scene, opts, curves)
red, blue = (curves[colour].error for colour in ("red", "blue"))
opts.save_for_print(
    figure,
    "Figure 3.3: error against weight, KILLEROO GOLD",
    f"""As Figure 3.2. On the gold (red) BRDF sampling is better: by shares the error is
    {red["samples"][0]:.2f} at w = 0 and {red["samples"][-1]:.2f} at w = 1; by tilts its
    minimum is inside. On the floor (blue) light sampling is, by shares:
    {blue["samples"][0]:.0f} and {blue["samples"][-1]:.2f}.""",
    panel=axis,
)
