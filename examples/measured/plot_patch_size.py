"""
Patch size and pilot size
=========================

The thesis tries patches from 4x4 to 32x32 pixels and pilots of 2 or 4 samples per
strategy, and reports one choice. Here is the experiment: small patches follow the
image, but know little; large ones know more, of places that differ. Larger pilots know
more, and leave less to use it for. The budget is always the same, pilot included,
samples are independent, and w is the share of light samples.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.examples.gallery import SCENES, options

opts, _ = options("plot_patch_size", __doc__)
PATCHES, PILOTS = opts.pick(((4, 32), (2, 4)), ((1, 4, 8, 16, 64), (2, 4, 16)))

# %%
# Half of the usual size in each direction, because there is so much to render.
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
        [1],
        reference,
        sampler="independent",
        parallel=opts.threads,
        progress=opts.progress,
    )
    base = runs["balance", opts.spp][0]
    results[name] = {
        key: (
            runs[b][0].mse / base.mse,
            runs[b][0].mse / base.mse * runs[b][0].mse_error / runs[b][0].mse,
        )
        for key, b in budgets.items()
    }
    best = min(results[name], key=lambda key: results[name][key][0])
    print(
        f"{name:18} best: patch {best[0]}, pilot {best[1]} per strategy:"
        f" {results[name][best][0]:.3f} of balance",
        flush=True,
    )

# %%
# One panel per scene, one line per pilot.
figure, axes = plot.canvas(1, 4, 18, 4.8)
colours = ["tab:red", "tab:green", "tab:blue"]
for axis, (name, ratios) in zip(axes[0], results.items(), strict=True):
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
    axis.yaxis.set_major_formatter(lambda x, _: f"{x:g}")
    axis.yaxis.set_minor_formatter(
        lambda x, _: f"{x:g}" if f"{x:.0e}"[0] in "2357" else ""
    )
    axis.set_title(SCENES[name].title, fontsize=10)
    axis.set_xlabel("side of a patch (pixels)")
    axis.legend(fontsize=8)
axes[0, 0].set_ylabel("MSE / MSE of the balance heuristic")
opts.save(
    figure,
    "Patch size and pilot size",
    f"""Error of the thesis's rule, w a share, over that of the balance heuristic at
    {opts.spp} camera samples per pixel, pilot included, against the side of the
    patches, for pilots of {", ".join(map(str, PILOTS))} samples per strategy; the 5x5
    Gaussian is over patches, so it reaches further where they are larger. One seed;
    bars are ± 2 standard errors over pixels of the rule's own error. Images of half the
    usual size in each direction.""",
)
