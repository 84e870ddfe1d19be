"""
Figure 5.1: where the rule loses, TT
====================================

The thesis names TT as the limit of its method. This figure looks for the places. Which share of light samples would
have been best for each patch? Render with five fixed weights and see. Which did the rule choose? And what did that
cost, patch by patch, compared with the balance heuristic?
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import options, show

import dmis
from dmis import plot
from dmis.base.patches import patch_mean
from dmis.experiment.metrics import squared_error

opts, _ = options(__file__, __doc__)
PATCH = opts.pick(4, 16)
SEEDS = range(opts.pick(1, 2))

# %%
# The rule and the balance heuristic, errors averaged over seeds and patches.
scene = opts.scene("tt")
reference = opts.reference(scene)
errors: dict[str, list[np.ndarray]] = {"balance": [], f"thesis:patch={PATCH}": []}
for seed in SEEDS:
    for rule, maps in errors.items():
        result = dmis.render(scene, rule, opts.spp, seed=seed, parallel=opts.threads, progress=show(rule))
        maps.append(squared_error(result.image, reference.first, reference.second))
balance, ours = (np.mean(maps, axis=0) for maps in errors.values())
print(f"MSE: balance {balance.mean():.3e}, thesis {ours.mean():.3e}, ratio {ours.mean() / balance.mean():.3f}")

# %%
# The weight that would have been best among five, by the sample variance of many samples.
weights = (0, 0.25, 0.5, 0.75, 1)
variances = [
    patch_mean(
        dmis.render(scene, f"fixed:{w}", opts.pick(8, 32), seed=9, parallel=opts.threads).variance.mean(axis=2), PATCH
    )
    for w in weights
]
best = np.array(weights)[np.argmin(variances, axis=0)]

# %%
# Where the error comes from: the patches, from the one that loses most to the one that wins most.
change = patch_mean(ours, PATCH) - patch_mean(balance, PATCH)
area = patch_mean(np.ones_like(ours), PATCH)
loss = np.sort(change.ravel())[::-1] / balance.mean() / change.size
worse = (change > 0).mean()
half = int(np.argmax(np.cumsum(loss) > 0.5 * loss[loss > 0].sum())) + 1
print(
    f"{worse:.0%} of the patches are worse than with the balance heuristic; "
    f"half of the loss is in {half / loss.size:.1%} of them"
)

# %%
# Image, best and chosen weights, ratio of errors, and how loss and gain add up.
height, width = ours.shape
covered = (0, best.shape[0] * PATCH), (0, best.shape[1] * PATCH)
figure, axes = plot.canvas(2, 3, 17, 7.6)
plot.picture(axes[0, 0], result.image, f"thesis's rule, {opts.spp} spp")
shown = plot.weights(axes[0, 1], best, "best of five weights (by variance of many samples)", covered)
plot.weights(axes[1, 1], result.weight, "weights that the rule learned")
plot.weight_bar(figure, shown, axes[:, 1], shrink=0.7)
quotient = np.clip(patch_mean(ours, PATCH) / np.maximum(patch_mean(balance, PATCH), 1e-12), 0.1, 10)
shown = plot.heat(
    axes[0, 2], quotient, "MSE of the rule / MSE of balance", covered, cmap="PuOr_r", norm=LogNorm(0.1, 10)
)
figure.colorbar(shown, ax=axes[0, 2], label="ratio: above 1 the rule loses")
scale = plot.shared_scale([np.sqrt(np.abs(ours))])
shown = plot.heat(axes[1, 0], np.sqrt(np.abs(ours)), "error of the rule", cmap="magma", vmin=0, vmax=scale)
figure.colorbar(shown, ax=axes[1, 0], label="|error| of linear RGB", shrink=0.8)
for axis in axes[:, 1:2].flat:
    axis.set_xlim(0, width)
    axis.set_ylim(height, 0)
axes[0, 2].set_xlim(0, width)
axes[0, 2].set_ylim(height, 0)
axis = axes[1, 2]
axis.plot(
    100 * np.arange(1, loss.size + 1) / loss.size,
    1 + np.cumsum(loss),
    color="tab:red",
    label="rule, patches added one by one",
)
axis.axhline(1, color="0.35", linestyle="--", label="balance heuristic")
axis.set_xlabel("patches, those that lose most first (%)")
axis.set_ylabel("MSE / MSE of balance")
axis.legend(fontsize=8)
opts.save(
    figure,
    "Figure 5.1: where the thesis's rule loses, TT",
    f"""{scene.name}, {opts.spp} camera samples per pixel, patches of {PATCH}x{PATCH} pixels, errors over {len(SEEDS)}
    seeds. MSE over that of the balance heuristic: {ours.mean() / balance.mean():.2f}. The rule is worse in
    {worse:.0%} of the patches; half of what it loses is lost in {half / loss.size:.1%} of them (bottom right, where the
    curve begins steeply). There the pilot's two samples of a technique did not see the sun or its reflection, and the
    rule gave that technique too much.""",
)
