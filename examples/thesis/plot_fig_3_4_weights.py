"""
Figure 3.4: the learned weights
===============================

The share map of each scene, as the final pass uses it: red where the thesis's rule gives the samples to BRDF sampling,
blue where to light sampling, white where to both alike. The map next to it says how the weight of each patch came
about. A parabola has a minimum inside [0, 1] in a part of the patches only; elsewhere the thesis does not say what to
do, and this library clips to the nearer end, or takes the best of the three pilots where the parabola is not convex.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import SCENES, options

import dmis
from dmis import plot
from dmis.fit.thesis import STATUS

opts, _ = options(__file__, __doc__)
PATCH = opts.pick(4, 8, 16)

# %%
# Only the pilot and the fit are needed, so one final sample is enough.
results = {
    about.title: dmis.render(opts.scene(name), f"thesis:patch={PATCH}", 7, seed=1, parallel=opts.threads)
    for name, about in SCENES.items()
}

# %%
# How often each case occurs.
shares = {title: [np.mean(r.maps["status"] == k) for k in STATUS] for title, r in results.items()}
print(f"{'scene':20}" + "".join(f"{name:>14}" for name in STATUS.values()))
for title, share in shares.items():
    print(f"{title:20}" + "".join(f"{100 * s:12.1f} %" for s in share))

# %%
# Left: the weights. Right: what happened.
figure, axes = plot.canvas(4, 2, 11, 15)
colours = ["tab:green", "gold", "tab:purple", "0.6"]
for line, (title, result) in zip(axes, results.items(), strict=True):
    whole = (0, result.weight.shape[0]), (0, result.weight.shape[1])
    shown = plot.weights(line[0], result.weight, f"{title}: weights")
    plot.weight_bar(figure, shown, line[0], shrink=0.7)
    height, width = result.maps["status"].shape
    covered = (0, height * PATCH), (0, width * PATCH)
    plot.heat(
        line[1], result.maps["status"], "what the fit found", covered, cmap=ListedColormap(colours), vmin=-0.5, vmax=3.5
    )
    line[1].set_xlim(whole[1])
    line[1].set_ylim(whole[0][::-1])
    names = [f"{name}: {100 * s:.0f} %" for name, s in zip(STATUS.values(), shares[title], strict=True)]
    handles = [Patch(color=c, label=n) for c, n in zip(colours, names, strict=True)]
    line[1].legend(handles=handles, fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1), title="share of patches")
opts.save(
    figure,
    "Figure 3.4: learned weights",
    f"""Left: share of light samples by the thesis's rule (pilot of 2 + 2 + 2 samples, patches of {PATCH}x{PATCH}
    pixels, 5x5 Gaussian). Right: where the parabola has its minimum inside [0, 1], where outside (clipped to the
    nearer end), where it is not convex (best of the three pilot weights), and where nothing was seen (w = 1/2).""",
)
