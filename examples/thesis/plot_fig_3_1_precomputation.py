"""
Figure 3.1: the pilots
======================

The thesis's precomputation: before anything is decided, render the scene with a few samples of each of three
strategies, BRDF sampling alone (w = 0), light sampling alone (w = 1), and both with the balance heuristic (w = 1/2).
Their differences in noise are what the rest is made of: where the one image is grainy and the other smooth, a good
share of light samples is far from 1/2.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import options, window

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread

opts, _ = options(__file__, __doc__)
PATCH, SPP = opts.pick(4, 8, 16), 2

# %%
# Three images of two samples per pixel. `Result.variance` is that of the image, a mean over SPP samples.
scene = opts.scene("killeroo-gold")
strategies = {
    "BRDF sampling, w = 0": "fixed:0",
    "light sampling, w = 1": "fixed:1",
    "balance heuristic, w = ½": "balance",
}
pilots = {title: dmis.render(scene, rule, SPP, seed=1, parallel=opts.threads) for title, rule in strategies.items()}

# %%
# Variances of single pixels are hardly more than noise themselves; the thesis averages them over square patches.
shape = next(iter(pilots.values())).image.shape[:2]
variances = {
    title: patch_spread(patch_mean(luminance(pilot.variance * SPP), PATCH), PATCH, shape)
    for title, pilot in pilots.items()
}
for title, variance in variances.items():
    print(f"{title:26} mean of the sample variances {variance.mean():.4g}")

# %%
# Top: the pilots. Middle: crops. Bottom: the variance per patch.
from matplotlib.colors import LogNorm

part = window(scene, (0.1, 0.5), (0.15, 0.5))
figure, axes = plot.canvas(3, 3, 13, 11)
scale = LogNorm(1e-5, plot.shared_scale(list(variances.values()), 0.999))
for column, (title, pilot) in enumerate(pilots.items()):
    plot.picture(axes[0, column], pilot.image, title)
    plot.mark(axes[0, column], part, "tab:red", "crop")
    plot.picture(axes[1, column], pilot.image, "crop", part)
    shown = plot.heat(
        axes[2, column], np.maximum(variances[title], 1e-5), "variance per patch", norm=scale, cmap="viridis"
    )
figure.colorbar(shown, ax=axes[2], label="variance of one sample (luminance²)")
opts.save(
    figure,
    "Figure 3.1: precomputation",
    f"""{scene.name}, pilots of {SPP} camera samples per pixel with each strategy (top), a crop (middle), and the
    sample variance averaged over patches of {PATCH}x{PATCH} pixels (bottom). On the diffuse walls light sampling is
    less noisy, on some of the gold BRDF sampling. Dark patches on the walls at the bottom left are those where no BRDF
    sample hit the light: their variance seems to be zero, and the technique that fails seems to be the best.""",
)
