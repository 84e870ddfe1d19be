"""
Equation 3.1: variance is error
===============================

The thesis rests on two facts. The expected squared error of an unbiased estimator is
its variance (Eq. 3.1). And the samples themselves estimate this variance, without a
reference. Both are true. This figure measures both, patch by patch, and then asks how
well the second one works with only two samples.
"""

import numpy as np

import dmis
from dmis.base.patches import patch_mean
from dmis.examples.gallery import options, print_canvas
from dmis.experiment.metrics import squared_error

opts, _ = options("plot_eq_3_1_variance_is_mse", __doc__)
PATCH = opts.pick(4, 16)
SEEDS = range(3)


def mean_of_patches(values):
    """Return the mean over each whole patch, without smaller ones at the border."""
    rows, columns = (side // PATCH for side in values.shape)
    return patch_mean(values, PATCH)[:rows, :columns]


# %%
# The error of every patch, against a reference, averaged over seeds: MSE = mean of (x -
# r₁)(x - r₂), with two independent halves r₁, r₂ of a reference.
scene = opts.scene("killeroo-diffuse", opts.pick(32, 2, 1))
reference = opts.reference(scene, opts.pick(32, 128))
images = [
    dmis.render(
        scene, "balance", opts.spp, seed=seed, progress=opts.progress, preset="thesis"
    )
    for seed in SEEDS
]
error = np.mean(
    [
        mean_of_patches(squared_error(i.image, reference.first, reference.second))
        for i in images
    ],
    axis=0,
)

# %%
# The variance of every patch, Σ (x - mean)² / (n - 1) / n, estimates MSE = Var (Eq.
# 3.1). It is measured on an image of many samples, and on one of two samples, scaled to
# the same number. The techniques alone show the data of the thesis's pilot.
many = mean_of_patches(images[0].variance.mean(axis=2))
panels = {f"{opts.spp} samples, balance": (many, error)}
for title, rule in (
    ("2 samples, balance", "balance"),
    ("2 samples, BRDF alone", "fixed:0"),
    ("2 samples, light alone", "fixed:1"),
):
    few = dmis.render(scene, rule, 2, seed=100, preset="thesis").variance
    truth = error
    # errors of a technique alone need many seeds: the variance of many samples instead
    if rule != "balance":
        many = dmis.render(scene, rule, opts.spp, seed=200, preset="thesis").variance
        truth = mean_of_patches(many.mean(axis=2))
    panels[title] = mean_of_patches(few.mean(axis=2)) * 2 / opts.spp, truth

# %%
# The estimate is right on the diagonal. Errors are in linear RGB². Far below it are
# patches in which no BRDF sample of the pilot met the lamp.
estimate, truth = panels["2 samples, BRDF alone"]
cloud = np.mean(estimate < 1e-3 * truth)
figure, axes = print_canvas(1, 4, 2.5, sharex=True, sharey=True)
TICKS = {1e-8: "1e-8", 1e-6: "1e-6", 1e-4: "1e-4", 1e-2: "1e-2", 1: "1"}
LEAST = 1e-9
"""Least error and least estimate that are drawn."""
stats = []
for axis, (title, (estimate, truth)) in zip(axes[0], panels.items(), strict=True):
    x, y = truth[truth > LEAST], estimate[truth > LEAST]
    off = np.abs(np.log10(np.maximum(y, 1e-12) / x))
    low = np.mean(y < 0.5 * x)
    drawn = y > LEAST
    stats.append((title, 10 ** np.median(off), low))
    shown = axis.hexbin(
        x[drawn],
        y[drawn],
        gridsize=40,
        xscale="log",
        yscale="log",
        bins="log",
        mincnt=1,
        vmin=1,
        vmax=100,
        cmap="viridis",
    )
    ends = np.array([LEAST, 1])
    axis.plot(ends, ends, color="tab:red")
    axis.set(xlim=(LEAST, 1.5), ylim=(LEAST, 1.5))
    axis.set_xticks(list(TICKS)[::2], list(TICKS.values())[::2])
    axis.set_yticks(list(TICKS), list(TICKS.values()))
    axis.set_title(title.replace(", ", ",\n"))
    alone = "alone" in title
    axis.set_xlabel(f"variance of {opts.spp}\nothers / {opts.spp}" if alone else "MSE")
    print(
        f"{title:26} median factor {10 ** np.median(off):5.2f}; {low:6.1%} of the"
        f" patches below half of the truth; {drawn.sum()} of {truth.size} drawn"
    )
axes[0, 0].set_ylabel(f"variance of the samples / {opts.spp}")
figure.colorbar(shown, ax=axes, label="patches", pad=0.01)
opts.save_for_print(
    figure,
    "Equation 3.1: variance is error, and what two samples know of it",
    f"""KILLEROO DIFFUSE, patches of {PATCH}x{PATCH} pixels. On the red line samples
    report the true error: {opts.spp} samples within a factor of {stats[0][1]:.2g} in
    half of the patches. With two BRDF samples {stats[2][2]:.0%} report less than half.
    In the cloud ({cloud:.0%}) none met the lamp: the headlight's variance is left.""",
)
