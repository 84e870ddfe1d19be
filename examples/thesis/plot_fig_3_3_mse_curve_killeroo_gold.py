"""
Figure 3.3: error against weight, KILLEROO GOLD
===============================================

The measurement of Figure 3.2 in a scene with two opposite surfaces, rendered by paths
as in Figure 4.1. On the gold, BRDF sampling finds the reflection of the light, and the
variance grows with the weight of light sampling. On the floor, away from the gold, BRDF
samples rarely find the light, and light sampling is about as good as both together.
"""

from inspect import getsource

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.examples.gallery import options, print_canvas
from dmis.experiment.metrics import ratio
from dmis.fit.thesis import parabola_minimum

opts, _ = options("plot_fig_3_3_mse_curve_killeroo_gold", __doc__)
SPP = opts.pick(8, 512)
SEEDS = opts.pick(2, 4)
PILOTS = opts.pick(5, 40)
PATCH = opts.pick(4, 16)

# %%
# **Two patches**, given by their top left corners in shares of the image. Red: a horn,
# with the reflection of the light. Blue: the floor, far enough from the gold that few
# paths meet it. Nearer to it, rare bright paths make the measured variance noisy.
scene = opts.scene("killeroo-gold", opts.pick(16, 2, 1))
CORNERS = {"red": (0.125, 0.374), "blue": (0.936, 0.14)}
PATHS = {"preset": "thesis", "integrator": "path"}
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
# of the mean of `spp` samples.
def variance(colour, w, spp, seed):
    """Return the variance of a camera sample in a patch, which is rendered alone."""
    rule = f"fixed:{w:g},weigh=heuristic"
    result = dmis.render(crops[colour], rule, spp, seed=seed, **PATHS)
    return spp * luminance(result.variance).mean()


# %%
# **The curve**: many samples at eleven weights; the mean of several seeds over that at
# w = 1/2, and half of the 95 % interval of this ratio, by Student's t.
W = np.linspace(0, 1, 11)
seeds = {
    colour: np.array(
        [
            [variance(colour, w, SPP, 11 * s + k) for k, w in enumerate(W)]
            for s in range(SEEDS)
        ]
    )
    for colour in patches
}
curves = {colour: y.mean(axis=0) for colour, y in seeds.items()}
halves = {
    colour: np.array([ratio(of_weight, y[:, 5])[1] for of_weight in y.T])
    for colour, y in seeds.items()
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
    print(f"{colour:4} ± {np.round(halves[colour], 2)}")
    print(
        f"{colour:4} parabola {minimum(y):.2f}, least variance at"
        f" {W[curve.argmin()]:.1f}, pilots {middle:.2f} ({low:.2f} to {high:.2f})"
    )

# %%
# Left: the patches. Middle and right: curves and parabolas; below them the weights of
# pilots.
figure = print_canvas(1, 1, 3.1)[0]
figure.clear()
axes = figure.subplot_mosaic(
    [["image", "red", "blue"], ["image", "red pilots", "blue pilots"]],
    height_ratios=[4, 1],
)
image = dmis.render(scene, "balance", opts.pick(4, 64), seed=1, **PATHS).image
plot.picture(axes["image"], image)
axes["image"].set_axis_off()
fine = np.linspace(0, 1, 200)
for colour, name in {"red": "gold", "blue": "floor"}.items():
    plot.mark(axes["image"], patches[colour], f"tab:{colour}", 1, 4)
    axis, below = axes[colour], axes[f"{colour} pilots"]
    unit = points[colour][1]
    axis.errorbar(
        W,
        curves[colour] / unit,
        halves[colour],
        fmt="o-",
        capsize=2,
        color=f"tab:{colour}",
        label="variance",
    )
    axis.plot(fine, np.polyval(parabolas[colour], fine) / unit, "k--", label="parabola")
    axis.plot(THREE, points[colour] / unit, "ks", zorder=3, label="its three points")
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
figure.legend(  # error bars would be the last entry
    handles[-1:] + handles[:-1],
    labels[-1:] + labels[:-1],
    loc="outside lower center",
    ncols=4,
)
ends = {colour: (y[0] / y[1], y[2] / y[1]) for colour, y in points.items()}
texts = {
    colour: [
        f"{end:.1f} ± {halves[colour][k]:.1f}"
        for end, k in zip(of, (0, -1), strict=True)
    ]
    for colour, of in ends.items()
}
opts.save_for_print(
    figure,
    "Figure 3.3: error against weight, KILLEROO GOLD",
    f"""Sample variance by paths over that at w = ½: on the gold {texts["red"][0]} at
    w = 0, {texts["red"][1]} at w = 1; floor: {texts["blue"][0]} and
    {texts["blue"][1]} (95 %, {SEEDS} seeds). Parabolas are least at
    {minimum(points["red"]):.2f}, {minimum(points["blue"]):.2f}. Below: {PILOTS}
    two-sample pilots.""",
    panel=axes["red"],
)
