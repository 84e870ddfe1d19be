"""
Patch size and pilot size
=========================

The thesis tries patches from 4x4 to 32x32 pixels and pilots of 2 or 4 samples per
strategy, and reports one choice. This figure compares them. Small patches follow the
image, but contain few samples; large patches contain more samples, but of places that
differ. Larger pilots measure better, but leave fewer samples for the final pass. The
budget is always the same, pilot included, samples are independent, and w is the share
of light samples.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.examples.gallery import SCENES, options, print_canvas

opts, _ = options("plot_patch_size", __doc__)
PATCHES, PILOTS = opts.pick(((4, 32), (2, 4)), ((4, 8, 16, 32), (2, 4)))
SEEDS = opts.pick(1, 4)

# %%
# Render at half of the usual side length, because there are many renders.
results = {}
for name in SCENES:
    scene = opts.scene(name, 2 * opts.shrink)
    reference = opts.reference(scene)
    budgets = {
        (patch, pilot): (f"thesis:weigh=samples,patch={patch},spp={pilot}", opts.spp)
        for patch in PATCHES
        for pilot in PILOTS
    }
    runs = dmis.measure(
        scene,
        [("balance", opts.spp), *budgets.values()],
        range(SEEDS),
        reference,
        sampler="independent",
        parallel=opts.threads,
        progress=opts.progress,
    )
    # over the seeds: sum of errors, over that of the balance heuristic
    base = sum(run.mse for run in runs["balance", opts.spp])
    results[name] = {
        key: (
            sum(run.mse for run in runs[budget]) / base,
            sum(run.mse_error**2 for run in runs[budget]) ** 0.5 / base,
        )
        for key, budget in budgets.items()
    }
    best = min(results[name], key=lambda key: results[name][key][0])
    print(
        f"{name:18} best: patch {best[0]}, pilot {best[1]} per strategy:"
        f" {results[name][best][0]:.3f} of balance",
        flush=True,
    )

# %%
# Draw one panel per scene, with one line per pilot size.
figure, axes = print_canvas(2, 2, 4.6, sharex=True)
colours = ["tab:red", "tab:green", "tab:blue"]
for axis, (name, ratios) in zip(axes.flat, results.items(), strict=True):
    for pilot, colour in zip(PILOTS, colours, strict=False):
        values, errors = np.transpose([ratios[patch, pilot] for patch in PATCHES])
        label = f"pilot {pilot} + {pilot} + {pilot} of {opts.spp}"
        axis.errorbar(
            PATCHES,
            values,
            2 * errors,
            marker="o",
            markersize=4,
            capsize=3,
            color=colour,
            label=label,
        )
    axis.axhline(1, color="0.35", linestyle="--", label="balance heuristic")
    axis.set_xscale("log", base=2)
    axis.set_yscale("log")
    axis.set_xticks(PATCHES, [str(patch) for patch in PATCHES])
    plot.round_ticks(axis.yaxis)
    axis.set_title(name)
for axis in axes[1]:
    axis.set_xlabel("side of a patch (pixels)")
for axis in axes[:, 0]:
    axis.set_ylabel("MSE over balance")
figure.legend(
    *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5
)
opts.save(
    figure,
    "Patch size and pilot size",
    f"""Error of the thesis's rule, w a share, over that of the balance heuristic at
    {opts.spp} camera samples per pixel, pilot included, against the side of the
    patches, for pilots of {", ".join(map(str, PILOTS))} samples per strategy; the 5x5
    Gaussian is over patches, so it reaches further where they are larger. {SEEDS}
    seeds; bars are ± 2 standard errors over pixels of the rule's own error.""",
)
