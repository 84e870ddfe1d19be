"""
Figure 3.3: error against weight, KILLEROO GOLD
===============================================

The measurement of Figure 3.2 in a scene with two opposite surfaces. On the gold, BRDF
sampling finds the reflection of the light, and the error grows with the share of light
samples. On the diffuse floor the error falls with that share. The axis is linear, so
that a parabola looks like one.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.experiment.gallery import draw_curve, options, print_canvas
from dmis.fit.thesis import parabola_minimum

opts, _ = options("plot_fig_3_3_mse_curve_killeroo_gold", __doc__)
PATCH, SPP, SEEDS = opts.pick((4, 16, 2), (16, 122, 24))
WEIGHTS = np.array(
    [0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 1]
)
STRATEGIES = np.array([0, 0.5, 1])

# %%
# Red: a horn, with the reflection of the light. Blue: the floor, at the edge of the
# shadow.
scene = opts.scene("killeroo-gold", opts.pick(16, 2, 1))
height, width = scene.camera.resolution[::-1]
corners = {
    "red": (0.125, 0.374),
    "blue": (0.936, 0.281),
}  # top left, in shares of the image
patches = {
    colour: (
        (round(y * height), round(y * height) + PATCH),
        (round(x * width), round(x * width) + PATCH),
    )
    for colour, (y, x) in corners.items()
}
crops = {colour: scene.crop(*patch) for colour, patch in patches.items()}

# %%
# **Step 1, the curve.** Render the patch alone with a fixed weight w and 122 samples
# per pixel, again and again. The mean squared error is the mean over seeds, pixels and
# channels of (x - r₁)(x - r₂), where r₁ and r₂ are two independent halves of a
# reference, whose own noise cancels.
mse = {}
for colour, crop in crops.items():
    reference = opts.reference(crop, opts.pick(1024, 8192))
    runs = dmis.measure(
        crop,
        [(f"fixed:{w:g}", SPP) for w in WEIGHTS],
        range(SEEDS),
        reference,
        preset="thesis",
    )
    mse[colour] = np.array(
        [[run.mse for run in runs[f"fixed:{w:g}", SPP]] for w in WEIGHTS]
    )  # (weights, seeds)
at_half = {colour: errors[WEIGHTS == 0.5].mean() for colour, errors in mse.items()}
curves = {
    colour: errors.mean(axis=1) / at_half[colour] for colour, errors in mse.items()
}
bars = {
    colour: 2 * errors.std(axis=1, ddof=1) / SEEDS**0.5 / at_half[colour]
    for colour, errors in mse.items()
}

# %%
# **Step 2, three points of it.** An unbiased estimator's error is its variance, MSE =
# Var (Eq. 3.1), and a variance needs no reference. So the thesis takes V(w) at three
# weights: BRDF sampling w = 0, balance heuristic w = 1/2, and light sampling w = 1.
# First the exact ones, as multiples of V(1/2).
exact = {
    colour: curve[np.isin(WEIGHTS, STRATEGIES)] for colour, curve in curves.items()
}

# %%
# **Step 3, the fit.** One parabola a₂ w² + a₁ w + a₀ goes through three points (Eqs.
# 3.2-3.4). Its minimum is the weight of the patch, w = -a₁ / (2 a₂) (Eq. 3.5), clipped
# to [0, 1].
parabolas = {
    colour: np.polyfit(STRATEGIES, points, 2) for colour, points in exact.items()
}
fitted = {
    colour: float(parabola_minimum(STRATEGIES, points)[0])
    for colour, points in exact.items()
}

# %%
# **The pilot's data.** The rule does not know the exact points. It has the sample
# variances of two samples per pixel, y = Σ (x - mean)², averaged over the patch. Pilots
# with other random numbers give other weights.
pilots = {
    colour: [
        [
            luminance(
                dmis.render(
                    crop, f"fixed:{w:g}", 2, seed=3 * k + j, preset="thesis"
                ).variance
            ).mean()
            for j, w in enumerate(STRATEGIES)
        ]
        for k in range(opts.pick(5, 40))
    ]
    for colour, crop in crops.items()
}
learned = {
    colour: parabola_minimum(STRATEGIES, np.transpose(y))[0]
    for colour, y in pilots.items()
}
for colour, curve in curves.items():
    points = ", ".join(f"{v:.2f} at {w:g}" for w, v in zip(WEIGHTS, curve, strict=True))
    print(
        f"{colour:5} V(w) / V(1/2):"
        f" {points};"
        f" minimum of the exact parabola {fitted[colour]:.2f}, of pilots"
        f" {np.median(learned[colour]):.2f} ({learned[colour].min():.2f} to"
        f" {learned[colour].max():.2f})"
    )

# %%
# Left: the picture with the two patches. Right: measured curves, exact parabolas, their
# minima, and those of pilots.
figure, axes = print_canvas(1, 2, 3.4, width_ratios=[1, 1.6])
plot.picture(
    axes[0, 0],
    dmis.render(scene, "balance", opts.pick(4, 32), seed=1, preset="thesis").image,
)
axes[0, 0].set_axis_off()
axis = axes[0, 1]
for colour, level in (("red", -3.6), ("blue", -2.9)):
    plot.mark(axes[0, 0], patches[colour], f"tab:{colour}")
    fit, ticks = (parabolas[colour], fitted[colour]), (learned[colour], level)
    draw_curve(
        axis,
        colour,
        f"{colour}: measured",
        (WEIGHTS, curves[colour], bars[colour]),
        fit,
        ticks,
    )
axis.set_ylim(-4, 6)
axis.set_xlabel("share of light samples w  (0: BRDF only, 1: light only)")
axis.set_ylabel("MSE / MSE at w = ½")
figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=2)
red, blue = (curves[colour] for colour in ("red", "blue"))
opts.save_for_print(
    figure,
    "Figure 3.3: error against weight, KILLEROO GOLD",
    f"""As Figure 3.2, for KILLEROO GOLD ({width}x{height} pixels, patches of
    {PATCH}x{PATCH}, {SPP} camera samples per pixel, {SEEDS} seeds, ± 2 standard
    errors). On the gold (red) BRDF sampling is better: {red[0]:.2f} at w = 0,
    {red[-1]:.2f} at w = 1, in multiples of the error at w = 1/2. On the floor (blue)
    light sampling is: {blue[0]:.1f} and {blue[-1]:.2f}. Dashed: the parabola through
    three exact points of each, and its minimum. Ticks at the bottom: where pilots of
    two samples per pixel put it.""",
    panel=axis,
)
