"""
Figure 3.4: the learned weights
===============================

The weight map of each scene before the filter. In red patches BRDF samples count, in
blue ones light samples, in white ones both alike. The parabola has a
minimum inside [0, 1] only in some of the patches. The thesis does not say what to do in
the others. dmis takes the nearer end, or, if the parabola is not convex, the best of
the three pilots.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread
from dmis.examples.gallery import SCENES, WEIGHT, name_rows, options, print_canvas
from dmis.fit.thesis import STATUS, parabola_minimum

opts, _ = options("plot_fig_3_4_weights", __doc__)
PATCH = opts.pick(4, 16)
STRATEGIES = np.array([0, 0.5, 1])

# %%
# **Step 1, the pilot.** Two camera samples per pixel for each weight w = 0, 1/2, 1.
# Each takes one light and one BRDF sample, and w only weighs them: with p_w = w p_l +
# (1 - w) p_b, a light sample of contribution f counts w f / p_w, a BRDF sample (1 - w)
# f / p_w.
scenes = {name: opts.scene(name, opts.pick(32, 2, 1)) for name in SCENES}
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
# each patch (Eqs. 3.2-3.4) has its minimum at w = -a₁ / (2 a₂) (Eq. 3.5). The status
# marks the patches where this is no minimum inside [0, 1].
fits = {name: parabola_minimum(STRATEGIES, y) for name, y in variances.items()}
for name, (_, status) in fits.items():
    shares = (
        f"{meaning} {np.mean(status == code):.1%}" for code, meaning in STATUS.items()
    )
    print(f"{name:18} {', '.join(shares)}")

# %%
# Figure 3.5 has the next steps, the filter and the final pass. This figure shows the
# weights of the fit beside the mean of the three pilots. White patches beside the pot
# see nothing and keep w = 1/2. Where the lamp does not shine, on the pot and in the
# darkest shadow, the three variances are those of the headlight within a pixel, equal
# but for noise, and the weight is chance.
figure, axes = print_canvas(4, 2, 8.6, width=6, height_ratios=[1.25, 1, 1, 0.75])
for line, (name, (weight, status)) in zip(axes, fits.items(), strict=True):
    image = np.mean([pilot.image for pilot in pilots[name]], axis=0)
    plot.picture(line[0], image)
    inside = f"learned w (minimum in [0, 1]: {np.mean(status == 0):.0%} of patches)"
    per_pixel = patch_spread(weight, PATCH, image.shape[:2])
    shown = plot.weights(line[1], per_pixel, inside)
axes[0, 0].set_title("mean of the three pilots")
name_rows(axes, [about.title for about in SCENES.values()])
plot.weight_bar(figure, shown, axes, WEIGHT, shrink=0.4, location="bottom", pad=0.01)
opts.save_for_print(
    figure,
    "Figure 3.4: learned weights",
    f"""Left: mean of the three pilots of 2 camera samples per pixel. Right: the
    heuristic's weight w that the thesis's rule learns from them in patches of
    {PATCH}x{PATCH} pixels, before the filter; above, the percentage of patches whose
    parabola has its minimum inside [0, 1].""",
    panel=axes[2, 1],
)
