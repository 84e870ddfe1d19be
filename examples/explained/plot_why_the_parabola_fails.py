"""
Why the parabola fails
======================

From the same pilot, the thesis's rule loses by a large factor with patches of 4x4
pixels, and works with patches of 16x16. The cause is the number of samples behind each
variance. Suppose a technique meets the light in one sample of a hundred. Then most
small patches contain no such sample, and the measured variance is nearly zero. The
worse technique looks perfect, and gets all samples.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread, patch_sum
from dmis.examples.gallery import options, print_canvas, window
from dmis.experiment.metrics import ratio_over_blocks, squared_error
from dmis.filter import gaussian
from dmis.fit.thesis import parabola_minimum

opts, _ = options("plot_why_the_parabola_fails", __doc__)
PATCHES = (4, 8, 16)
STRATEGIES = np.array([0, 0.5, 1])

# %%
# The thesis's rule on TT, step by step, with three sizes of patches; w is a share here,
# as with ``weigh=samples``. **Step 1, the pilot**, is the same for all: two camera
# samples per pixel for each share of light samples w = 0, 1/2, 1. A direction of
# contribution f counts as f / (w p_l + (1 - w) p_b).
scene = opts.scene("tt", opts.pick(16, 4, 1))
pilots = [
    dmis.render(scene, f"fixed:{w:g}", 2, seed=k, preset="thesis")
    for k, w in enumerate(STRATEGIES, 1)
]
shape = pilots[0].image.shape[:2]

# %%
# **Step 2, the variance.** y = Σ (x - mean)² / (n - 1) over the n = 2 samples x of a
# pixel, averaged over a patch. `Result.variance` is the variance of the pixel's mean, y
# / n; the factor n does not move the minimum.
variance = np.stack([luminance(pilot.variance) for pilot in pilots])
variances = {patch: patch_mean(variance, patch) for patch in PATCHES}

# %%
# **Step 3, the fit.** The parabola a₂ w² + a₁ w + a₀ through the three points (w, y) of
# each patch (Eqs. 3.2-3.4) has its minimum at w = -a₁ / (2 a₂) (Eq. 3.5). If y(0) is
# almost zero because no BRDF sample met the sun, the minimum is at or near w = 0.
raw = {patch: parabola_minimum(STRATEGIES, y)[0] for patch, y in variances.items()}

# %%
# **Step 4, the filter.** The weight of patch p becomes Σ_q g(p - q) w_q over 5x5
# patches q, with g ~ exp(-d² / 2) at a distance of d patches.
filtered = {patch: gaussian(w, sigma=1, radius=2) for patch, w in raw.items()}

# %%
# **Step 5, the final pass.** Each pixel takes the weight of its patch. Of S = 2 samples
# at a surface, n_l = w S are light samples on average, and n_b = (1 - w) S are BRDF
# samples. By the balance heuristic, each sample adds f / (n_l p_l + n_b p_b). The pilot
# has used 6 of the 128 camera samples.
weights = {patch: patch_spread(w, patch, shape) for patch, w in filtered.items()}
images = {
    patch: dmis.render(
        scene, dmis.Given(weight=w), opts.spp - 6, seed=4, preset="thesis"
    ).image
    for patch, w in weights.items()
}

# %%
# **The error** is the mean of (x - r₁)(x - r₂) with two independent halves r₁, r₂ of a
# reference. Divide it by the error of the balance heuristic with w = 1/2 and all 128
# samples.
reference = opts.reference(scene, opts.pick(32, 128))
balance = dmis.render(scene, "balance", opts.spp, seed=4, preset="thesis").image
errors = squared_error(balance, reference.first, reference.second)
ratios = {
    patch: ratio_over_blocks(
        squared_error(image, reference.first, reference.second), errors
    )
    for patch, image in images.items()
}
for patch, (value, half) in ratios.items():
    print(
        f"patches of {patch:2}x{patch:<2} MSE / MSE of the balance heuristic"
        f" {value:6.2f} ± {half:.2f}"
    )

# %%
# **How many patches miss every spike?** On the diffuse walls of KILLEROO DIFFUSE, a
# BRDF sample that hits the lamp is far brighter than the pixel; all other BRDF samples
# are zero. Let the fraction h of the BRDF samples hit the lamp. A patch of P pixels
# with n samples each has no hit with probability (1 - h)^(P n).
room = opts.scene("killeroo-diffuse", opts.pick(16, 4, 1))
wall = room.crop(window(room, (0, 0.02, 0.187, 0.27)))
truth = luminance(
    dmis.render(wall, "balance", opts.pick(32, 128), seed=1, preset="thesis").image
)
hit = {
    spp: [
        luminance(
            dmis.render(wall, "fixed:0", spp, seed=100 * spp + k, preset="thesis").image
        )
        > truth
        for k in range(opts.pick(4, 50))
    ]
    for spp in (1, 2, 4)
}
SIDES = np.array([2, 4, 8, 16])
missed = {
    spp: [np.mean(patch_sum(np.array(h, float), side) == 0) for side in SIDES]
    for spp, h in hit.items()
}
h = np.mean(hit[1]) / 2  # two BRDF samples for each camera sample
print(f"share of BRDF samples that hit the lamp: {h:.2%}")
for spp, shares in missed.items():
    told = ", ".join(
        f"{share:.1%} ({(1 - h) ** (2 * spp * side**2):.1%})"
        for side, share in zip(SIDES, shares)
    )
    print(
        f"{spp} samples per pixel, patches of 2, 4, 8, 16 pixels: no hit in {told} of"
        " them (expected)"
    )

# %%
# Top: the weights. Middle: images rendered with them. Bottom: patches without a spike.
figure = print_canvas(1, 1, 5.6)[0]
figure.clear()
top, bottom = figure.subfigures(2, 1, height_ratios=[1.75, 1])
axes, part = top.subplots(2, 3), window(scene, (0.1, 0.5, 0.5, 0.95))
for k, patch in enumerate(PATCHES):
    value, half = ratios[patch]
    shown = plot.weights(
        axes[0, k], weights[patch], f"patches of {patch}x{patch}: MSE x {value:.2g}"
    )
    plot.mark(axes[0, k], part, "black")
    plot.picture(axes[1, k], images[patch], "", part)
for axis in axes.flat:
    axis.set_axis_off()
plot.weight_bar(top, shown, axes[0], location="bottom", shrink=0.5, aspect=40, pad=0.02)
axis = bottom.subplots()
pixels = np.geomspace(SIDES[0] ** 2, SIDES[-1] ** 2, 100)
for (spp, shares), colour in zip(
    missed.items(), ("tab:orange", "tab:red", "tab:purple"), strict=True
):
    axis.plot(
        SIDES**2, 100 * np.array(shares), "o", color=colour, label=f"{spp} per pixel"
    )
    axis.plot(
        pixels, 100 * (1 - h) ** (2 * spp * pixels), "--", color=colour, linewidth=0.8
    )
axis.set_xscale("log")
axis.set_xticks(SIDES**2, [f"{side}x{side}" for side in SIDES])
axis.minorticks_off()
axis.set_xlabel("pixels of a patch")
axis.set_ylabel("patches without a hit (%)")
axis.legend(loc="center left", bbox_to_anchor=(1, 0.5), title="camera samples")
height, width = shape
told = ", ".join(f"{value:.2f} ± {half:.2f}" for value, half in ratios.values())
opts.save_for_print(
    figure,
    "Why the parabola fails",
    f"""Top: shares of the thesis's rule on TT ({width}x{height} pixels) from one pilot
    of 2 + 2 + 2 camera samples per pixel, with patches of three sizes, and mean squared
    error over that of the balance heuristic, {told} (one seed, {opts.spp} samples).
    Middle: the framed part of the image. Dark red patches get almost only BRDF samples,
    because the pilot's BRDF samples missed the sun there. Bottom: on the wall of
    KILLEROO DIFFUSE {h:.1%} of the BRDF samples hit the lamp; share of the patches in
    which none of the pilot's does, over {len(hit[1])} pilots. Dashed: (1 - h)^n for n
    BRDF samples, two for each camera sample.""",
    panel=axes[1, 0],
)
