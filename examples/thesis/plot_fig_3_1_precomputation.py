"""
Figure 3.1: the pilot
=====================

The thesis's precomputation, called pilot here. The rule first renders the scene with
two samples per pixel of each of three strategies: BRDF sampling alone (weight w = 0),
both techniques with the balance heuristic (w = 1/2), and light sampling alone (w = 1).
It learns from the noise of these images and from nothing else.
"""

import numpy as np
from matplotlib.colors import LogNorm

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean
from dmis.examples.gallery import SCENES, name_rows, options, print_canvas

opts, _ = options("plot_fig_3_1_precomputation", __doc__)
PATCH = opts.pick(4, 16)
NAMES = ("teapot-area-light", "killeroo-diffuse", "killeroo-gold")
STRATEGIES = {
    0: "BRDF sampling, w = 0",
    0.5: "balance heuristic, w = ½",
    1: "light sampling, w = 1",
}

# %%
# **Step 1, the pilot.** A camera sample takes one light and one BRDF sample at each
# vertex, whatever w is: w only weighs the heuristic that combines them. With the
# densities p_l and p_b of the two techniques and p_w = w p_l + (1 - w) p_b, a light
# sample of contribution f counts w f / p_w, a BRDF sample (1 - w) f / p_w.
scenes = {name: opts.scene(name, opts.pick(32, 2, 1)) for name in NAMES}
pilots = {
    (name, w): dmis.render(
        scene,
        f"fixed:{w},weigh=heuristic",
        2,
        seed=k,
        preset="thesis",
        integrator=SCENES[name].integrator,
    )
    for name, scene in scenes.items()
    for k, w in enumerate(STRATEGIES, 1)
}

# %%
# **Step 2, the variance.** With n = 2 samples x of a pixel, their sample variance is y
# = Σ (x - mean)² / (n - 1). `Result.variance` is the variance of the pixel, which is
# the mean of n samples: y / n. The sample variance of a single pixel is very noisy
# itself, so the thesis averages it over patches.
variances = {
    key: patch_mean(2 * luminance(pilot.variance), PATCH)
    for key, pilot in pilots.items()
}
for (name, w), y in variances.items():
    print(
        f"{name:18} w = {w:3g}: mean variance of a sample {y.mean():.4g} (luminance²)"
    )

# %%
# The teapot's pilots, their variances by patch, and the pilots of the two killeroo
# scenes: BRDF sampling sees the gold's reflections of the light, and hardly finds the
# light from the walls. KILLEROO GOLD is rendered by paths, as in Figure 4.1.
figure, axes = print_canvas(4, 3, 7.7, height_ratios=[1, 1, 0.75, 0.75])
teapot = [variances[NAMES[0], w] for w in STRATEGIES]
scale = LogNorm(1e-4, plot.shared_scale(teapot, 0.999))
for column, (w, title) in enumerate(STRATEGIES.items()):
    for line, name in zip(axes[[0, 2, 3]], NAMES, strict=True):
        plot.picture(line[column], pilots[name, w].image)
    shown = plot.heat(
        axes[1, column], np.maximum(teapot[column], 1e-4), norm=scale, cmap="viridis"
    )
    axes[0, column].set_title(title)
labels = [SCENES[name].title for name in NAMES]
name_rows(axes, [labels[0], "its variance by patch", *labels[1:]])
figure.colorbar(shown, ax=axes[1], label="variance of a sample (luminance²)", pad=0.01)
opts.save_for_print(
    figure,
    "Figure 3.1: the pilot",
    f"""Pilots of 2 camera samples per pixel; KILLEROO GOLD by paths. The headlight, a
    delta light, shows in all columns. BRDF sampling looks dark, because its light is in
    few bright pixels, which are clipped. Second row: sample variances, averaged over
    patches of {PATCH}x{PATCH} pixels (darkest: 0.0001 or less).""",
    panel=axes[1, 0],
)
