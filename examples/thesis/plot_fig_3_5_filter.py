"""
Figure 3.5: the filter
======================

Few samples decide the weight of a patch, so weights jump from patch to patch. The
thesis smooths them with a 5x5 Gaussian over patches. This helps where neighbours should
agree. It also blurs weights across the edges of shadows and materials, where neighbours
should differ.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread
from dmis.examples.gallery import (
    SCENES,
    WEIGHT,
    name_rows,
    options,
    print_canvas,
    window,
)
from dmis.experiment.metrics import ratio_over_blocks, squared_error
from dmis.filter import gaussian
from dmis.fit.thesis import parabola_minimum

opts, _ = options("plot_fig_3_5_filter", __doc__)
PATCH = opts.pick(4, 16)
STRATEGIES = np.array([0, 0.5, 1])
CROPS = {  # rows and columns, in shares of the image
    "teapot-area-light": ((0.16, 0.36), (0.3, 0.5)),
    "killeroo-diffuse": ((0.37, 0.57), (0.38, 0.58)),
    "killeroo-gold": ((0.8, 1), (0.35, 0.55)),
}

# %%
# **Step 1, the pilot.** Two camera samples per pixel for each weight w = 0, 1/2, 1.
# Each takes one light and one BRDF sample, and w only weighs them: with p_w = w p_l +
# (1 - w) p_b, a light sample of contribution f counts w f / p_w, a BRDF sample (1 - w)
# f / p_w.
scenes = {name: opts.scene(name, opts.pick(32, 2, 1)) for name in CROPS}
pilots = {
    name: [
        dmis.render(scene, f"fixed:{w:g},weigh=heuristic", 2, seed=k, preset="thesis")
        for k, w in enumerate(STRATEGIES, 1)
    ]
    for name, scene in scenes.items()
}

# %%
# **Step 2, the variance.** y = Σ (x - mean)² / (n - 1) over the n = 2 samples x of a
# pixel, averaged over a patch. `Result.variance` is that of the pixel, y / n; the
# factor n does not move a minimum.
variances = {
    name: np.stack([patch_mean(luminance(pilot.variance), PATCH) for pilot in three])
    for name, three in pilots.items()
}

# %%
# **Step 3, the fit.** The parabola a₂ w² + a₁ w + a₀ through the three points (w, y) of
# each patch (Eqs. 3.2-3.4) has its minimum at w = -a₁ / (2 a₂) (Eq. 3.5).
raw = {name: parabola_minimum(STRATEGIES, y)[0] for name, y in variances.items()}

# %%
# **Step 4, the filter.** The weight of patch p becomes Σ_q g(p - q) w_q over 5x5
# patches q, with g ~ exp(-d² / 2) at a distance of d patches.
filtered = {name: gaussian(weight, sigma=1, radius=2) for name, weight in raw.items()}

# %%
# **Step 5, the final pass.** Each pixel takes the weight of its patch, with one light
# and one BRDF sample at each vertex, as in the pilot. The rule has 122 of the 128
# camera samples left. The other image, with w = 1/2 everywhere, needs no pilot and
# takes all of them.
SHAPES = {name: scene.camera.resolution[::-1] for name, scene in scenes.items()}
maps = {
    (name, title): patch_spread(weight[name], PATCH, SHAPES[name])
    for name in scenes
    for title, weight in (("without the filter", raw), ("with the filter", filtered))
}
final = {
    (name, title): dmis.render(
        scenes[name],
        dmis.Given(weight=weight, weigh="heuristic"),
        opts.spp - 6,
        seed=4,
        preset="thesis",
    )
    for (name, title), weight in maps.items()
}
balance = {
    name: dmis.render(scene, "balance", opts.spp, seed=4, preset="thesis")
    for name, scene in scenes.items()
}

# %%
# Does it help? Compute the mean squared error over that of the balance heuristic,
# against two halves of a reference.
ratios = {}
for name, scene in scenes.items():
    reference = opts.reference(scene, opts.pick(32, 128))
    errors = squared_error(balance[name].image, reference.first, reference.second)
    for title in ("without the filter", "with the filter"):
        ours = squared_error(
            final[name, title].image, reference.first, reference.second
        )
        ratios[name, title] = ratio_over_blocks(ours, errors)
        value, half = ratios[name, title]
        print(
            f"{name:18} {title:18} MSE / MSE of the balance heuristic {value:.3f} ±"
            f" {half:.3f}"
        )

# %%
# The thesis's four panels: (a, b) the maps without and with the filter, (c, d) the
# framed part of them. Then that part of the images: where the lamp shines on a patch
# in which BRDF samples alone count, bright dots stay without the filter.
figure, axes = print_canvas(3, 6, 4, height_ratios=[1, 0.75, 0.75])
for line, name in zip(axes, scenes, strict=True):
    part = window(scenes[name], *CROPS[name])
    for k, title in enumerate(("without the filter", "with the filter")):
        shown = plot.weights(line[k], maps[name, title])
        plot.mark(line[k], part, "black")
        inside = maps[name, title][slice(*part[0]), slice(*part[1])]
        plot.weights(line[2 + k], inside, "", part)
        plot.picture(line[4 + k], final[name, title].image, "", part)
titles = (
    "(a) without filter",
    "(b) with filter",
    "(c) part of (a)",
    "(d) part of (b)",
    "image by (a)",
    "image by (b)",
)
for axis, title in zip(axes[0], titles, strict=True):
    axis.set_title(title)
name_rows(axes, [SCENES[name].title.replace(" ", "\n", 1) for name in scenes])
plot.weight_bar(
    figure, shown, axes, WEIGHT, shrink=0.5, aspect=40, location="bottom", pad=0.03
)
told = [
    " and ".join(
        f"{value:.2f} ± {half:.2f}"
        for key, (value, half) in ratios.items()
        if name in key
    )
    for name in scenes
]
opts.save_for_print(
    figure,
    "Figure 3.5: weights without and with the filter",
    f"""Weights (a) of the fit, (b) filtered; (c, d) framed part; images of
    {opts.spp - 6} samples. MSE over that of the balance heuristic, 95 % intervals,
    without and with filter: {"; ".join(told)}.""",
    panel=axes[2, 1],
)
