"""
Figure 3.2: error against weight, TEAPOT AREA LIGHT
===================================================

How does the error of a patch depend on the weight w? That depends on what w weighs.
As a share, w divides the samples between light and BRDF sampling. As a tilt, it leaves
one sample to each, and tilts the heuristic that combines them. The thesis has curves of
different shapes on the teapot: by tilts one of these two patches has its minimum
inside, the other at the end. By shares both fall to w = 1.
"""

from dmis.examples.gallery import options
from dmis.examples.patch_curves import draw_curves, measure_patch, print_curves

opts, _ = options("plot_fig_3_2_mse_curve_teapot", __doc__)

# %%
# Red: the board under the spout, next to the lamp. Blue: the board in front of it.
scene = opts.scene("teapot-area-light", opts.pick(16, 2, 1))
corners = {"red": (0.4, 0.92), "blue": (0.6, 0.8)}  # top left, in shares of the image

# %%
# Each patch is rendered alone with fixed weights, 122 samples per pixel, again and
# again; ``measure_patch`` in ``patch_curves.py`` beside this script goes step by step.
# A direction of contribution f counts as f / (w p_l + (1 - w) p_b), times w or 1 - w
# for a tilt. The error at w = 0, 1/2 and 1 gives the parabola of the thesis (Eqs.
# 3.2-3.5), whose minimum is the weight. The rule itself has less: pilots of two samples
# per pixel, whose weights scatter.
curves = {
    colour: measure_patch(scene, opts, corner) for colour, corner in corners.items()
}
print_curves(curves)

# %%
# Bars are ± 2 standard errors. The parabola itself is not drawn: V(0) is so large that
# its minimum is negative, which no error is, and near w = 3/4 whatever the curve does.
figure, axis = draw_curves(scene, opts, curves)
tilt = {colour: curve.error["heuristic"] for colour, curve in curves.items()}
share = {colour: curve.error["samples"] for colour, curve in curves.items()}
opts.save_for_print(
    figure,
    "Figure 3.2: error against weight, TEAPOT AREA LIGHT",
    f"""MSE of two patches over that at w = ½. Tilted, red has its minimum inside,
    {tilt["red"].min():.2f}, and {tilt["red"][-1]:.2f} at w = 1; blue falls to
    {tilt["blue"][-1]:.2f}. By shares both fall, to {share["red"][-1]:.2f} and
    {share["blue"][-1]:.2f}. Below: weights of the tilt's exact parabola and of
    pilots.""",
    panel=axis,
)
