"""
Figure 3.5: the filter
======================

Weights that are fitted patch by patch jump from patch to patch, because so few samples went into each. The thesis
smooths them with a 5x5 Gaussian over patches. That helps where neighbours should agree; but it also blurs weights
across the edges of shadows and materials, where they should not, and an average of two extreme weights is not the
weight that an average of their statistics would give.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import options, show, window

import dmis
from dmis import plot
from dmis.experiment.metrics import mean_over_blocks, squared_error

opts, _ = options(__file__, __doc__)
PATCH = opts.pick(4, 8, 16)

# %%
# The same seed twice: the same pilot, the same raw weights; and the balance heuristic to compare with.
scene = opts.scene("killeroo-diffuse")
reference = opts.reference(scene)
rules = {
    "balance": "balance",
    "without filter": f"thesis:patch={PATCH},filter=none",
    "5x5 Gaussian": f"thesis:patch={PATCH}",
}
results = {
    title: dmis.render(scene, rule, opts.spp, seed=1, parallel=opts.threads, progress=show(title))
    for title, rule in rules.items()
}
errors = {t: squared_error(r.image, reference.first, reference.second) for t, r in results.items()}
mse = {title: mean_over_blocks(error) for title, error in errors.items()}
for title, (mean, spread) in mse.items():
    print(f"{title:15} MSE {mean:.3e} ± {spread:.1e}, ratio to balance {mean / mse['balance'][0]:.3f}")

# %%
# Top: without the filter. Bottom: with it. The crop shows what the filter does to the noise.
part = window(scene, (0.6, 0.95), (0.25, 0.65))
figure, axes = plot.canvas(2, 4, 17, 7.2)
top = plot.shared_scale([np.sqrt(np.abs(e))[slice(*part[0]), slice(*part[1])] for e in errors.values()])
for line, title in zip(axes, ("without filter", "5x5 Gaussian"), strict=True):
    shown = plot.weights(line[0], results[title].weight, f"{title}: weights")
    plot.mark(line[0], part, "black")
    inside = results[title].weight[slice(*part[0]), slice(*part[1])]
    plot.weights(line[1], inside, "weights, crop", part)
    plot.picture(line[2], results[title].image, "image, crop", part)
    inside = np.sqrt(np.abs(errors[title]))[slice(*part[0]), slice(*part[1])]
    error = plot.heat(line[3], inside, "error, crop", part, cmap="magma", vmin=0, vmax=top)
plot.weight_bar(figure, shown, axes[:, 0], shrink=0.7)
figure.colorbar(error, ax=axes[:, 3], shrink=0.7, label="|error| of linear RGB")
opts.save(
    figure,
    "Figure 3.5: weights with and without the filter",
    f"""{scene.name}, {opts.spp} camera samples per pixel, patches of {PATCH}x{PATCH} pixels. MSE over that of the
    balance heuristic: {mse["without filter"][0] / mse["balance"][0]:.3f} without the filter,
    {mse["5x5 Gaussian"][0] / mse["balance"][0]:.3f} with it (one seed; relative standard errors over pixels
    {mse["without filter"][1] / mse["without filter"][0]:.1%} and
    {mse["5x5 Gaussian"][1] / mse["5x5 Gaussian"][0]:.1%}). The black frame marks the crop.""",
)
