"""
Figure 3.5: the filter
======================

Few samples decide the weight of a patch, so weights jump from patch to patch. The
thesis smooths them with a 5x5 Gaussian over patches. This helps where neighbours should
agree. It also blurs weights across the edges of shadows and materials, where neighbours
should differ.
"""

from inspect import getsource

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread
from dmis.base.window import window_area
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
CROPS = {  # x0, y0, x1, y1 in shares of the image
    "teapot-area-light": (0.3, 0.16, 0.5, 0.36),
    "killeroo-diffuse": (0.38, 0.37, 0.58, 0.57),
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
# each patch (Eqs. 3.2-3.4) has its minimum at w = -a₁ / (2 a₂) (Eq. 3.5), computed by
# the library's code, which is printed here. Outside [0, 1] the nearer end is taken,
# without a minimum the best of the three, without a signal 1/2: the thesis does not say
# what to do there.
fits = {name: parabola_minimum(STRATEGIES, y) for name, y in variances.items()}
raw = {name: weight for name, (weight, _) in fits.items()}
for name, (_, status) in fits.items():
    print(f"{name:18} patches without a minimum: {np.mean(status == 2):.1%}")
print(getsource(parabola_minimum))

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
# framed part of them; (e) to (h) are those of KILLEROO DIFFUSE. Then that part of the
# images: where the lamp shines on a patch in which BRDF samples alone count, bright
# dots stay without the filter.
figure, axes = print_canvas(4, 3, 7.9, height_ratios=[1, 1, 0.75, 0.75])
letters = ("ac", "bd", "eg", "fh")
for line, (whole, framed), (name, title) in zip(axes, letters, maps, strict=True):
    part = window(scenes[name], CROPS[name])
    value, half = ratios[name, title]
    shown = plot.weights(line[0], maps[name, title], f"({whole}) {title}")
    plot.mark(line[0], part, "black", 1.2)
    inside = maps[name, title][window_area(part, scenes[name].camera.resolution)]
    plot.weights(line[1], inside, f"({framed}) part of ({whole})", part)
    image = f"image by ({whole}): MSE × {value:.2f} ± {half:.2f}"
    plot.picture(line[2], final[name, title].image, image, part)
name_rows(axes, [SCENES[name].title for name, _ in maps])
plot.weight_bar(
    figure, shown, axes, WEIGHT, shrink=0.5, aspect=40, location="bottom", pad=0.01
)
texts = [f"{value:.2f} ± {half:.2f}" for value, half in ratios.values()]
opts.save_for_print(
    figure,
    "Figure 3.5: weights without and with the filter",
    f"""Weights (a, e) of the fit, (b, f) after the 5x5 Gaussian (sigma one patch);
    images of {opts.spp - 6} samples, one seed. MSE over that of balance without and
    with filter: {texts[0]} and {texts[1]} (teapot), {texts[2]} and {texts[3]} (KILLEROO
    DIFFUSE; 95 % intervals).""",
    panel=axes[2, 0],
)
