"""
Figure 3.4: the learned weights
===============================

The weight map of each scene before the filter. In red patches BRDF samples count, in
blue ones light samples, in white ones both alike. The parabola has a
minimum inside [0, 1] only in some of the patches. The thesis does not say what to do in
the others. dmis takes the nearer end, or, if the parabola is not convex, the best of
the three pilots. One patch of each scene is framed, and its parabola drawn. Images
have the thesis's size here, so patches of 16x16 pixels are the thesis's, too.
"""

from inspect import getsource

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
FRAMED = {  # a patch of each scene: row and column in shares of the image
    "teapot-area-light": (0.62, 0.82),
    "killeroo-diffuse": (0.75, 0.9),
    "killeroo-gold": (0.125, 0.374),  # the horn of Figure 3.3
    "tt": (0.35, 0.3),
}

# %%
# **Step 1, the pilot.** Two camera samples per pixel for each weight w = 0, 1/2, 1.
# Each takes one light and one BRDF sample, and w only weighs them: with p_w = w p_l +
# (1 - w) p_b, a light sample of contribution f counts w f / p_w, a BRDF sample (1 - w)
# f / p_w. KILLEROO GOLD is rendered by paths, as in Figure 4.1.
scenes = {name: opts.scene(name, opts.pick(32, 1)) for name in SCENES}
pilots = {
    name: [
        dmis.render(
            scene,
            f"fixed:{w:g},weigh=heuristic",
            2,
            seed=k,
            preset="thesis",
            integrator=SCENES[name].integrator,
        )
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
# the library's code, which is printed here. The status marks the patches where this is
# no minimum inside [0, 1]. Shares are counted over whole patches, because the last rows
# of the killeroo scenes and of TT are 2 pixels and 1 pixel high.


def whole(patches, name):
    """Return the values of the patches that have all of their pixels."""
    width, height = scenes[name].camera.resolution
    return patches[: height // PATCH, : width // PATCH]


fits = {name: parabola_minimum(STRATEGIES, y) for name, y in variances.items()}
for name, (_, status) in fits.items():
    shares = (
        f"{meaning} {np.mean(whole(status, name) == code):.1%}"
        for code, meaning in STATUS.items()
    )
    print(f"{name:18} {', '.join(shares)}")
print(getsource(parabola_minimum))

# %%
# **Which technique outweighs the other?** Of the patches with a signal, the share with
# w > 1/2 (blue), and with w near 3/4, where a parabola through one high end has its
# minimum.
blue = {}
for name, (weight, status) in fits.items():
    w = whole(weight, name)[whole(status, name) != 3]
    blue[name] = np.mean(w > 0.5), np.mean(np.abs(w - 0.75) < 0.05)
    print(f"{name:18} blue {blue[name][0]:.1%}, 3/4 {blue[name][1]:.1%}")

# %%
# Figure 3.5 has the next steps, the filter and the final pass. This figure shows the
# weights of the fit beside the mean of the three pilots. White patches beside the pot
# see nothing and keep w = 1/2. Where the lamp does not shine, on the pot and in the
# darkest shadow, the three variances are those of the headlight within a pixel, equal
# but for noise, and the weight is chance.
figure, axes = print_canvas(
    4, 3, 9.4, height_ratios=[1.33, 1, 1, 0.74], width_ratios=[1.2, 1.2, 0.9]
)
fine = np.linspace(0, 1, 200)
for line, (name, (weight, status)) in zip(axes, fits.items(), strict=True):
    image = np.mean([pilot.image for pilot in pilots[name]], axis=0)
    row, column = (np.array(FRAMED[name]) * weight.shape).astype(int)
    x, y = PATCH * column, PATCH * row
    plot.picture(line[0], image)
    status = whole(status, name)
    title = f"minimum in [0, 1]: {np.mean(status == 0):.0%}"
    if np.mean(status == 3) > 0.005:
        title += f",\nno signal: {np.mean(status == 3):.0%}"
    per_pixel = patch_spread(weight, PATCH, image.shape[:2])
    shown = plot.weights(line[1], per_pixel, title)
    for axis in line[:2]:
        plot.mark(axis, (x, y, x + PATCH, y + PATCH), "black", 1, PATCH // 3)
    y = variances[name][:, row, column] / variances[name][1, row, column]
    line[2].plot(fine, np.polyval(np.polyfit(STRATEGIES, y, 2), fine), "k--")
    line[2].plot(STRATEGIES, y, "ks")
    line[2].axvline(weight[row, column], color="0.7", zorder=0)
    line[2].axhline(0, color="0.7", linewidth=0.8, zorder=0)
    line[2].set_title(f"framed patch: w = {weight[row, column]:.2f}")
    line[2].set(xticks=[0, 0.25, 0.5, 0.75, 1], ylabel="variance / that at ½")
axes[-1, 2].set_xlabel("w")
axes[0, 0].set_title("mean of the three pilots")
name_rows(axes[:, :2], [about.title for about in SCENES.values()])
plot.weight_bar(
    figure, shown, axes[:, :2], WEIGHT, shrink=0.6, location="bottom", pad=0.01
)
texts = [
    ", ".join(f"{share:.0%}" for share in of) for of in zip(*blue.values(), strict=True)
]
opts.save_for_print(
    figure,
    "Figure 3.4: learned weights",
    f"""Left: mean of three two-sample pilots at the thesis's size. Middle: w of
    {PATCH}x{PATCH} pixels before the filter (white: no signal or w = ½). Of patches
    with a signal {texts[0]} are blue, {texts[1]} near ¾. Right: parabola and w of the
    framed patch.""",
    panel=axes[2, 1],
)
