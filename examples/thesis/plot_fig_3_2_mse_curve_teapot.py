"""
Figure 3.2: error against weight, TEAPOT AREA LIGHT
===================================================

How does the error of a patch depend on the weight w? The thesis has two curves of
different shapes on the teapot, and fits a parabola to three points of each. Here are
such a patch on the board and one on the pot, their curves, their parabolas, and the
weights that pilots of two samples find.
"""

from inspect import getsource

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.examples.gallery import options, print_canvas
from dmis.fit.thesis import parabola_minimum

opts, _ = options("plot_fig_3_2_mse_curve_teapot", __doc__)
SPP = opts.pick(16, 2048)
PILOTS = opts.pick(5, 40)
PATCH = opts.pick(4, 16)

# %%
# **Two patches**, given by their top left corners in shares of the image. Red: the
# board in front of the spout. Blue: the lid of the pot.
scene = opts.scene("teapot-area-light", opts.pick(16, 2, 1))
CORNERS = {"red": (0.6, 0.8), "blue": (0.235, 0.6)}
patches = {}
for colour, corner in CORNERS.items():
    top, left = np.round(corner * np.array(scene.camera.resolution[::-1])).astype(int)
    patches[colour] = left, top, left + PATCH, top + PATCH
crops = {colour: scene.crop(patch) for colour, patch in patches.items()}


# %%
# **The variance of a patch at w.** A camera sample takes one light and one BRDF sample.
# With p_w = w p_l + (1 - w) p_b, a light sample of contribution f counts w f / p_w, a
# BRDF sample (1 - w) f / p_w. Sample variances of the pixels are averaged over the
# patch; no reference is needed, because MSE = Var (Eq. 3.1). `Result.variance` is that
# of the mean of `spp` samples. Over four seeds the standard errors of the variances at
# w = 0, 0.5, 0.7 and 1 are below 0.3 %.
def variance(colour, w, spp, seed):
    """Return the variance of a camera sample in a patch, which is rendered alone."""
    rule = f"fixed:{w:g},weigh=heuristic"
    result = dmis.render(crops[colour], rule, spp, seed=seed, preset="thesis")
    return spp * luminance(result.variance).mean()


# %%
# **The curve**: many samples at eleven weights.
W = np.linspace(0, 1, 11)
curves = {
    colour: np.array([variance(colour, w, SPP, k) for k, w in enumerate(W)])
    for colour in patches
}

# %%
# **Three points and the fit.** The parabola a₂ w² + a₁ w + a₀ through the variances at
# w = 0, 1/2, 1 (Eqs. 3.2-3.4) has its minimum at w = -a₁ / (2 a₂) (Eq. 3.5), computed
# by the library's code, which is printed here.
THREE = np.array([0, 0.5, 1])
points = {colour: curve[[0, 5, 10]] for colour, curve in curves.items()}
parabolas = {colour: np.polyfit(THREE, y, 2) for colour, y in points.items()}


def minimum(y):
    """Return the weight that the thesis's rule gives to a patch."""
    return float(parabola_minimum(THREE, np.array(y))[0])


print(getsource(parabola_minimum))

# %%
# **What the rule measures**: the same three points, by a pilot of two samples a pixel.
learned = {
    colour: [
        minimum([variance(colour, w, 2, 3 * k + j) for j, w in enumerate(THREE)])
        for k in range(PILOTS)
    ]
    for colour in patches
}
for colour, y in points.items():
    low, middle, high = np.quantile(learned[colour], (0, 0.5, 1))
    curve = curves[colour] / y[1]
    print(f"{colour:4} V(w) / V(1/2): {np.round(curve, 2)}")
    print(
        f"{colour:4} parabola {minimum(y):.2f}, least variance at"
        f" {W[curve.argmin()]:.1f}, pilots {middle:.2f} ({low:.2f} to {high:.2f})"
    )

# %%
# Left: the patches. Middle and right: curves and parabolas; below them the weights of
# pilots. A parabola through a high V(0) dips below 0, where no variance is, and has its
# minimum near w = 3/4 whatever the curve does.
figure = print_canvas(1, 1, 3.1)[0]
figure.clear()
axes = figure.subplot_mosaic(
    [["image", "red", "blue"], ["image", "red pilots", "blue pilots"]],
    height_ratios=[4, 1],
)
image = dmis.render(scene, "balance", opts.pick(4, 32), seed=1, preset="thesis").image
plot.picture(axes["image"], image)
axes["image"].set_axis_off()
fine = np.linspace(0, 1, 200)
for colour, name in {"red": "board", "blue": "pot"}.items():
    plot.mark(axes["image"], patches[colour], f"tab:{colour}", 1, 4)
    axis, below = axes[colour], axes[f"{colour} pilots"]
    unit = points[colour][1]
    axis.plot(W, curves[colour] / unit, "o-", color=f"tab:{colour}", label="variance")
    axis.plot(fine, np.polyval(parabolas[colour], fine) / unit, "k--", label="parabola")
    axis.plot(THREE, points[colour] / unit, "ks", label="its three points")
    axis.axvline(minimum(points[colour]), color="0.7", zorder=0, label="its minimum")
    axis.axhline(0, color="0.7", linewidth=0.8, zorder=0)
    dip = np.polyval(parabolas[colour], minimum(points[colour])) / unit
    axis.set(ylim=(min(1.2 * dip, -0.5), max(4, -1.2 * dip)), title=name)
    axis.tick_params(labelbottom=False)
    axis.sharex(below)
    below.hist(learned[colour], bins=np.linspace(0, 1, 41), color=f"tab:{colour}")
    below.set(xlabel="w", xticks=[0, 0.25, 0.5, 0.75, 1])
axes["red"].set_ylabel("variance / that at w = ½")
axes["red pilots"].set_ylabel("pilots")
handles, labels = axes["red"].get_legend_handles_labels()
figure.legend(handles, labels, loc="outside lower center", ncols=4)
least = {colour: W[curve.argmin()] for colour, curve in curves.items()}
tops = {colour: y[0] / y[1] for colour, y in points.items()}
opts.save_for_print(
    figure,
    "Figure 3.2: error against weight, TEAPOT AREA LIGHT",
    f"""Variance of a sample in two patches over that at w = ½ (standard errors below
    1 %): {tops["red"]:.0f} (board) and {tops["blue"]:.0f} (pot) at w = 0, least at w =
    {least["red"]:.1f} and {least["blue"]:.1f}. Parabolas dip below 0 and are least at
    {minimum(points["red"]):.2f} and {minimum(points["blue"]):.2f}, as by {PILOTS}
    two-sample pilots.""",
    panel=axes["red"],
)
