"""
Shares and low-discrepancy points
=================================

The thesis's rule (``weigh=samples``) can lose although its shares reduce the variance
of single samples. Low-discrepancy points fill each other's gaps, best in powers of two:
8 light and 8 BRDF samples are better stratified than 10 and 6. So a share other than w
= 1/2 also costs stratification. A pilot cannot measure this cost, because it sees
single samples only.

The figure shows the error of TT at fixed shares, with independent points and with
pbrt-v2's low-discrepancy points, under a sky without and with a sun.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.examples.gallery import options, print_canvas
from dmis.experiment.metrics import ratio_over_blocks, squared_error

opts, _ = options("plot_shares_and_points", __doc__)
LIGHT_SAMPLES = (2, 4, 6, 7, 8, 9, 10, 12, 14)
"""Of 16 shading samples."""
SEEDS = range(opts.pick(1, 2))

# %%
# Compare one light and one BRDF sample with independent points, as the thesis may have
# used, and 8 + 8 samples with independent and with pbrt-v2's points. Of 16 shading
# samples, all camera samples take the same whole number 16 w of light samples; of 2
# shading samples they take 2 w light samples on average.
SETUPS = {
    "independent points, 1 + 1": {"sampler": "independent", "shading_samples": 2},
    "independent points, 8 + 8": {"sampler": "independent", "shading_samples": 16},
    "low-discrepancy points, 8 + 8": {
        "sampler": "lowdiscrepancy",
        "shading_samples": 16,
    },
}
size = opts.pick((32, 18), (200, 111), (1500, 833))
figure, axes = print_canvas(1, 2, 2.9, sharey=True)
ratios_of = {}
for axis, name in zip(axes.flat, ("tt-overcast", "tt"), strict=True):
    scene = dmis.load_scene(name, resolution=size)
    reference = dmis.make_reference(
        scene,
        opts.pick(16, 256),
        settings=dmis.Settings(shading_samples=16),
        parallel=opts.threads,
        progress=opts.progress,
    )
    for (label, about), style in zip(SETUPS.items(), ("s--", "^:", "o-"), strict=True):
        # %%
        # The mean squared error of each share, and its ratio over that of w = 1/2 with
        # the same seeds.
        errors = {}
        for n_l in LIGHT_SAMPLES:
            images = [
                dmis.render(
                    scene,
                    f"fixed:{n_l / 16}",
                    opts.pick(8, 64),
                    seed=seed,
                    preset="thesis",
                    parallel=opts.threads,
                    **about,
                ).image
                for seed in SEEDS
            ]
            errors[n_l] = sum(
                squared_error(image, reference.first, reference.second)
                for image in images
            )
        ratios = {n: ratio_over_blocks(e, errors[8]) for n, e in errors.items()}
        values, halves = np.transpose(list(ratios.values()))
        axis.errorbar(
            np.array(LIGHT_SAMPLES) / 16, values, halves, fmt=style, label=label
        )
        ratios_of[name, label] = values
        shares = (f"{n}/16 {v:.2f} ± {h:.2f}" for n, (v, h) in ratios.items())
        print(name, label, *shares)
    axis.axhline(1, color="0.6", linewidth=1)
    axis.set_yscale("log")
    axis.set_ylim(0.4, 8)
    plot.round_ticks(axis.yaxis)
    axis.set_title(name)
    axis.set_xlabel("share w of light samples")

axes[0, 0].set_ylabel("MSE over that of w = 1/2")
figure.legend(
    *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3
)

# %%
# With independent points the best share lies elsewhere than at 1/2, and the rule gains
# by going there. With low-discrepancy points the same shares lose.
quarter = [ratios_of["tt-overcast", label][LIGHT_SAMPLES.index(4)] for label in SETUPS]
nine = ratios_of["tt-overcast", list(SETUPS)[-1]][LIGHT_SAMPLES.index(9)]
opts.save(
    figure,
    "Shares and low-discrepancy points",
    f"""TT at {size[0]}×{size[1]} pixels with fixed shares of light samples: mean
    squared error over that of w = 1/2, with 95 % intervals over blocks of pixels. With
    independent points w = 1/4 has {quarter[0]:.2f} of the error under the sky without a
    sun (squares: 2 shading samples per camera sample), or {quarter[1]:.2f} (triangles:
    16). With 16 of pbrt-v2's low-discrepancy points (circles) the same share has
    {quarter[2]:.2f} times the error, and 9 light samples to 7 BRDF samples {nine:.2f}
    times: other numbers than powers of two are less stratified.""",
    panel=axes.flat[0],
)
