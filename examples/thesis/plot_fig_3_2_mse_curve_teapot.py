"""
Figure 3.2: error against weight, TEAPOT AREA LIGHT
===================================================

How does the error of a patch depend on the share w of light samples? This figure
measures it in two patches of the teapot whose curves have different shapes. BRDF
sampling is better in no noisy patch of the teapot, so a third patch is from KILLEROO
GOLD. Then it shows what the thesis makes of three points of each curve: a parabola and
its minimum.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_sum
from dmis.experiment.gallery import draw_curve, options, print_canvas
from dmis.fit.thesis import parabola_minimum

opts, _ = options("plot_fig_3_2_mse_curve_teapot", __doc__)
PATCH, SPP, SEEDS = opts.pick((4, 16, 2), (16, 122, 24))
WEIGHTS = np.array(
    [0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 1]
)
STRATEGIES = np.array([0, 0.5, 1])

# %%
# Red: the spout, next to the lamp, where the curve is flat beyond w = 1/2. Blue: the
# floor in front of it, where it falls steeply to the end. Green: a horn of gold, with
# the reflection of the light.
scenes = {
    name: opts.scene(name, opts.pick(16, 2, 1))
    for name in ("teapot-area-light", "killeroo-gold")
}
corners = {  # top left, in shares of the image
    "red": ("teapot-area-light", 0.28, 0.88),
    "blue": ("teapot-area-light", 0.6, 0.8),
    "green": ("killeroo-gold", 0.125, 0.374),
}
patches = {}
for colour, (name, y, x) in corners.items():
    columns, rows = scenes[name].camera.resolution
    top, left = round(y * rows), round(x * columns)
    patches[colour] = (top, top + PATCH), (left, left + PATCH)
crops = {
    colour: scenes[name].crop(*patches[colour])
    for colour, (name, _, _) in corners.items()
}

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
# **Is BRDF sampling better in any noisy patch?** The variances y₀ and y₁ of all patches
# of the teapot's picture, from as many samples as the thesis has. Two kinds of patches
# are left out: the edge of the lamp, where both variances are equal but for noise (the
# lamp has the radiance 8, all else less than 4), and patches with hardly any variance.
whole = {
    w: dmis.render(
        scenes["teapot-area-light"],
        f"fixed:{w}",
        opts.spp,
        seed=7,
        progress=opts.progress,
        preset="thesis",
    )
    for w in (0, 1)
}
y0, y1 = (
    patch_mean(opts.spp * luminance(result.variance), PATCH)
    for result in whole.values()
)
lamp = patch_sum(luminance(whole[1].image) > 4, PATCH) > 0
noisy = (np.maximum(y0, y1) > 1e-3) & ~lamp
least = (y0[noisy] / y1[noisy]).min()
print(f"least V(0) / V(1) of {noisy.sum()} patches of the teapot: {least:.1f}")

# %%
# Left: the pictures with the patches. Right: measured curves, exact parabolas, their
# minima, and those of pilots.
figure = print_canvas(1, 1, 3.7)[0]
figure.clear()
axes = figure.subplot_mosaic(
    [["teapot-area-light", "curves"], ["killeroo-gold", "curves"]], width_ratios=[1, 2]
)
axis = axes.pop("curves")
for name, left in axes.items():
    plot.picture(
        left,
        dmis.render(
            scenes[name], "balance", opts.pick(4, 32), seed=1, preset="thesis"
        ).image,
    )
    left.set_axis_off()
labels = {
    "red": "red (spout): measured",
    "blue": "blue (floor): measured",
    "green": "green (gold): measured",
}
for (colour, label), level in zip(labels.items(), (-4.7, -3.7, -4.2), strict=True):
    plot.mark(axes[corners[colour][0]], patches[colour], f"tab:{colour}")
    fit, ticks = (parabolas[colour], fitted[colour]), (learned[colour], level)
    draw_curve(axis, colour, label, (WEIGHTS, curves[colour], bars[colour]), fit, ticks)
axis.set_ylim(-5, 6)
axis.set_xlabel("share of light samples w  (0: BRDF only, 1: light only)")
axis.set_ylabel("MSE / MSE at w = ½")
figure.legend(
    *axis.get_legend_handles_labels(),
    loc="outside lower center",
    ncols=3,
    columnspacing=1,
    handlelength=1.5,
)
red, blue, green = (curves[colour] for colour in labels)
width, height = scenes["teapot-area-light"].camera.resolution
opts.save_for_print(
    figure,
    "Figure 3.2: error against weight, TEAPOT AREA LIGHT",
    f"""Mean squared error of patches of {PATCH}x{PATCH} pixels (frames in the pictures)
    against the share of light samples, as a multiple of that at w = 1/2; {SPP} camera
    samples per pixel, {SEEDS} seeds, bars are ± 2 standard errors. On the teapot
    ({width}x{height} pixels) light sampling is better in both, a little at the spout
    (red: {red[0]:.1f} at w = 0, {red[-1]:.2f} at w = 1) and much on the floor (blue:
    {blue[0]:.0f} and {blue[-1]:.2f}; the curve leaves the frame). BRDF sampling is
    better in no noisy patch of the teapot: in all {noisy.sum()} whose samples have a
    variance above 10⁻³ (luminance²), the edge of the lamp left out, V(0) is at least
    {least:.1f} V(1). So the third shape is from KILLEROO GOLD (green: {green[0]:.2f}
    and {green[-1]:.2f}). Dashed: the parabola through three exact points of each, and
    its minimum. Ticks at the bottom: where pilots of two samples per pixel put it.""",
    panel=axis,
)
