"""
Figure 2.1: variance is noise
=============================

A Monte Carlo image is an average of random samples, so it is random itself. With n
samples per pixel, its variance and its mean squared error fall as 1/n. Sixteen times as
many samples leave a sixteenth of the error, and the visible grain is four times as
faint. All other figures are about getting the same grain from fewer samples.
"""

import numpy as np
from matplotlib.colors import LogNorm

import dmis
from dmis import plot
from dmis.examples.gallery import options, print_canvas, window
from dmis.experiment.metrics import mean_and_error, ratio_over_blocks, squared_error

opts, _ = options("plot_fig_2_1_variance", __doc__)

# %%
# Render the same scene with few and with many samples: one light and one BRDF sample
# each, balance heuristic.
scene = opts.scene("teapot-area-light", opts.pick(32, 2, 1))
reference = opts.reference(scene, opts.pick(32, 128))
few, many = opts.pick((2, 16), (8, 128))
images = {
    n: (
        dmis.render(
            scene, "balance", n, seed=1, progress=opts.progress, preset="thesis"
        ).image
    )
    for n in (few, many)
}

# %%
# The error of a pixel x is (x - r₁)(x - r₂), with two independent halves r₁, r₂ of a
# reference, whose own noise cancels in the mean. A mean of n samples of variance V has
# the error MSE = V / n.
errors = {
    n: squared_error(image, reference.first, reference.second)
    for n, image in images.items()
}
mse = {n: mean_and_error(error) for n, error in errors.items()}
for n, (mean, spread) in mse.items():
    print(f"{n:4d} spp: MSE {mean:.3e} ± {spread:.1e}")

# %%
# The factor between the two errors has a 95 % interval over blocks of pixels, because
# the two images have different random numbers.
factor, half = ratio_over_blocks(errors[few], errors[many])
print(f"ratio {factor:.1f} ± {half:.1f}, expected {many / few:.0f}")

# %%
# Left: the images. Middle: the framed part, where the noise shows. Right: the error, on
# one logarithmic scale: a factor of four less is the same step everywhere.
part = window(scene, (0.6, 0.42, 0.9, 0.72))
figure, axes = print_canvas(2, 3, 4.5)
scale = LogNorm(1e-3, plot.shared_scale([np.sqrt(np.abs(errors[few]))]))
for line, letter, (n, image) in zip(axes, "ab", images.items(), strict=True):
    plot.picture(line[0], image, f"({letter}) {n} samples per pixel")
    plot.mark(line[0], part, "tab:red")
    plot.picture(line[1], image, "framed part", part)
    shown = plot.heat(
        line[2],
        np.sqrt(np.maximum(np.abs(errors[n]), 1e-6)),
        f"error: MSE {mse[n][0]:.1e}",
        cmap="magma",
        norm=scale,
    )
for axis in axes.flat:
    axis.set_axis_off()
figure.colorbar(shown, ax=axes[:, 2], shrink=0.8, label="|error| of linear RGB")
opts.save_for_print(
    figure,
    "Figure 2.1: variance is noise",
    f"""TEAPOT AREA LIGHT with (a) {few} and (b) {many} camera samples per pixel,
    balance heuristic. The mean squared error of pixels and channels falls by a factor
    of {factor:.1f} ± {half:.1f}; {many / few:.0f} is expected. The thin bright arc is
    the edge of the lamp, where pixels see it in part.""",
)
