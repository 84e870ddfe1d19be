"""
Figure 5.1: noisy weights, TT
=============================

The thesis names TT as the limit of its method. With two samples per pixel the variances
are noisy, so the weights are noisy, and the filter does not repair them. This figure
has the thesis's three panels, and answers a fourth question: in which patches is the
error lost?
"""

import numpy as np
from matplotlib.colors import LogNorm

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread
from dmis.experiment.gallery import options, print_canvas, window
from dmis.experiment.metrics import ratio_over_blocks, squared_error
from dmis.filter import gaussian
from dmis.fit.thesis import parabola_minimum

opts, _ = options("plot_fig_5_1_limitation_tt", __doc__)
PATCH = opts.pick(4, 16)
STRATEGIES = np.array([0, 0.5, 1])

# %%
# **Step 1, the pilot.** Two camera samples per pixel for each share of light samples w
# = 0, 1/2, 1. A direction of contribution f counts as f / (w p_l + (1 - w) p_b).
scene = opts.scene("tt", opts.pick(16, 2, 1))
pilots = [
    dmis.render(scene, f"fixed:{w:g}", 2, seed=k, preset="thesis")
    for k, w in enumerate(STRATEGIES, 1)
]

# %%
# **Step 2, the variance.** y = Σ (x - mean)² / (n - 1) over the n = 2 samples x of a
# pixel, averaged over a patch. `Result.variance` is that of the pixel, y / n; the
# factor n does not move a minimum.
variances = np.stack([patch_mean(luminance(pilot.variance), PATCH) for pilot in pilots])

# %%
# **Step 3, the fit.** The parabola a₂ w² + a₁ w + a₀ through the three points (w, y) of
# each patch (Eqs. 3.2-3.4) has its minimum at w = -a₁ / (2 a₂) (Eq. 3.5).
raw, status = parabola_minimum(STRATEGIES, variances)

# %%
# **Step 4, the filter.** The weight of patch p becomes Σ_q g(p - q) w_q over 5x5
# patches q, with g ~ exp(-d² / 2) at a distance of d patches.
filtered = gaussian(raw, sigma=1, radius=2)

# %%
# **Step 5, the final pass.** Each pixel takes the weight of its patch; the pilot has
# used 6 of the 128 samples. The balance heuristic takes all of them, twice with
# different random numbers.
height, width = pilots[0].image.shape[:2]
weight = patch_spread(filtered, PATCH, (height, width))
images = {
    "thesis": (
        dmis.render(
            scene, dmis.Given(weight=weight), opts.spp - 6, seed=4, preset="thesis"
        ).image
    ),
    "balance": dmis.render(scene, "balance", opts.spp, seed=5, preset="thesis").image,
    "balance again": (
        dmis.render(scene, "balance", opts.spp, seed=6, preset="thesis").image
    ),
}

# %%
# **Where is the error lost?** Divide the mean squared error of each patch by that of
# the balance heuristic. Both errors are noisy. Even if only the random numbers differ,
# the ratio is above 1 in about half of the patches, and a few of them carry much of the
# difference. So the same map is drawn for the balance heuristic against itself.
reference = opts.reference(scene, opts.pick(64, 128))
squared = {
    name: squared_error(image, reference.first, reference.second)
    for name, image in images.items()
}
errors = {name: patch_mean(error, PATCH) for name, error in squared.items()}
value, half = ratio_over_blocks(squared["thesis"], squared["balance"])
lost, worse, part = {}, {}, {}
for name in ("thesis", "balance again"):
    change = (
        np.sort((errors[name] - errors["balance"]).ravel())[::-1]
        / errors["balance"].sum()
    )
    lost[name] = np.cumsum(change)
    worse[name] = np.mean(change > 0)
    part[name] = (np.argmax(lost[name] > 0.5 * lost[name].max()) + 1) / change.size
    print(
        f"{name:14} worse in {worse[name]:.0%} of the patches, half of the loss in"
        f" {part[name]:.1%} of them"
    )
print(f"MSE / MSE of the balance heuristic {value:.3f} ± {half:.3f}")

# %%
# Top: the thesis's panels. Bottom: ratios of errors patch by patch, and how losses and
# gains add up.
figure, axes = print_canvas(2, 3, 4.4)
zoom = window(scene, (0.3, 0.75), (0.3, 0.75))
whole = patch_spread(raw, PATCH, (height, width))
plot.weights(axes[0, 0], whole, "(a) weights from the fit")
plot.mark(axes[0, 0], zoom, "black")
plot.weights(
    axes[0, 1], whole[slice(*zoom[0]), slice(*zoom[1])], "(b) framed part of (a)", zoom
)
shown = plot.weights(axes[0, 2], weight, "(c) after the 5x5 Gaussian")
plot.weight_bar(
    figure, shown, axes[0], location="bottom", shrink=0.5, aspect=40, pad=0.02
)
for axis, name, title in zip(
    axes[1],
    ("thesis", "balance again"),
    ("(d) rule / balance", "(e) balance / balance"),
    strict=False,
):
    quotient = np.clip(errors[name] / np.maximum(errors["balance"], 1e-12), 0.1, 10)
    ratios = plot.heat(
        axis,
        patch_spread(quotient, PATCH, (height, width)),
        title,
        cmap="PuOr_r",
        norm=LogNorm(0.1, 10),
    )
figure.colorbar(
    ratios,
    ax=axes[1, :2],
    label="ratio of errors",
    location="bottom",
    aspect=40,
    pad=0.02,
)
for axis in [*axes[0], *axes[1, :2]]:
    axis.set_axis_off()
axis, share = (
    axes[1, 2],
    100 * np.arange(1, errors["thesis"].size + 1) / errors["thesis"].size,
)
for (name, title), style in zip(
    (("thesis", "rule"), ("balance again", "balance")), ("-", "--"), strict=True
):
    axis.plot(
        share,
        1 + lost[name],
        style,
        color="tab:red" if name == "thesis" else "0.4",
        label=title,
    )
axis.legend(loc="lower center")
axis.set_xlabel("patches, largest loss first (%)")
axis.set_ylabel("MSE / MSE of balance")
axis.set_title("(f) patches added one by one")
opts.save_for_print(
    figure,
    "Figure 5.1: noisy weights, TT",
    f"""TT, {width}x{height} pixels. (a) Share of light samples from a pilot of 2 + 2 +
    2 camera samples per pixel in patches of {PATCH}x{PATCH} pixels; (b) the framed
    part; (c) filtered, as the final pass uses it. (d) Error of the rule over that of
    the balance heuristic in each patch, {opts.spp} samples each, orange where the rule
    is worse, and (e) the balance heuristic over itself with other random numbers: what
    chance alone draws. The rule is worse in {worse["thesis"]:.0%} of the patches
    (chance: {worse["balance again"]:.0%}), and half of what is lost is in
    {part["thesis"]:.1%} of them (chance: {part["balance again"]:.1%}). (f) How losses
    and gains add up. MSE over that of the balance heuristic: {value:.2f} ± {half:.2f}
    (one seed, 95 % interval over blocks of pixels).""",
    panel=axes[1, 0],
)
