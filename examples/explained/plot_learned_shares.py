"""
What three rules learn on one scene
===================================

The share of light samples that the thesis's rule (``weigh=samples``), the second-moment
rule and auto learn on KILLEROO GOLD, and the camera samples per pixel that auto takes.
The first two rules only learn shares; auto divides camera samples, too.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.examples.gallery import options, print_canvas

opts, _ = options("plot_learned_shares", __doc__)
scene = opts.scene("killeroo-gold", opts.pick(24, 4, 1))
TITLES = {
    "thesis:weigh=samples": "share, thesis",
    "second-moment": "share, second-moment",
    "auto": "share, auto",
}

# %%
# Render once by each rule and by the balance heuristic, with the same budget and the
# same points.
results = {
    rule: dmis.render(
        scene, rule, opts.spp, seed=1, sampler="sobol", parallel=opts.threads
    )
    for rule in ("balance", *TITLES)
}
samples = results["auto"].samples
noise = np.log10(np.maximum(luminance(results["balance"].deviation), 1e-4))

# %%
# Draw image, noise and numbers of samples (powers of two) above the three share maps,
# which share one colour scale.
width, height = scene.camera.resolution
figure, axes = print_canvas(2, 3, 3.6 * height / width + 1)
plot.picture(axes[0, 0], results["auto"].image, "image, auto")
mappable = plot.heat(axes[0, 1], noise, "standard error, balance", cmap="magma")
figure.colorbar(mappable, ax=axes[0, 1], label="log10 of luminance", shrink=0.9)
mappable = plot.heat(
    axes[0, 2], np.log2(samples), "camera samples, auto", cmap="viridis"
)
figure.colorbar(mappable, ax=axes[0, 2], label="log2 of samples", shrink=0.9)
for axis, (rule, title) in zip(axes[1], TITLES.items(), strict=True):
    mappable = plot.weights(axis, results[rule].weight, title)
plot.weight_bar(figure, mappable, axes[1], shrink=0.9)
print(
    *(
        f"{rule}: {100 * result.weight.mean():.0f} % light samples"
        for rule, result in results.items()
    ),
    sep="\n",
)
opts.save(
    figure,
    "What three rules learn on one scene",
    f"""KILLEROO GOLD, {width}x{height} pixels, {opts.spp} camera samples per pixel,
    pilot included. Blue: more light samples than BRDF samples; red: fewer; white:
    equal shares. The gold reflects the lamp, so second-moment gives its bright parts
    BRDF samples. Patches of thesis have 16x16 pixels and are blurred by a 5x5 Gaussian.
    Patches of second-moment have 4x4 pixels and a filter that stops at edges; where
    its pilot is not sure of a gain, they stay white. Auto gives each pixel one of a
    few patterns, such as 4 light samples and 1 BRDF sample, and {samples.min():.0f}
    to {samples.max():.0f} camera samples.""",
)
