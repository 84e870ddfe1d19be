"""
What MSE and relMSE see
=======================

Renders TEAPOT AREA LIGHT by the balance heuristic and shows where each of the two errors comes from. MSE is the mean of
the squared differences d^2 from the reference r; relMSE is the mean of d^2 / (r^2 + 0.01).
"""

import numpy as np
from common import ROOT, options, print_canvas, write_webp

import dmis
from dmis import plot
from dmis.experiment.metrics import squared_error

BLOCK = 8
"""Side of the blocks of pixels whose errors are shown."""


def block_errors(errors: np.ndarray) -> np.ndarray:
    """Return the mean error of each block of pixels, divided by the mean error of the image."""
    blocks = errors.reshape(errors.shape[0] // BLOCK, BLOCK, errors.shape[1] // BLOCK, BLOCK).mean(axis=(1, 3))
    return np.maximum(blocks, 0) / blocks.mean()


opts, given = options(__file__, __doc__, docs={"action": "store_true", "help": "also write the picture of docs/images"})
reference, _ = dmis.read_exr(ROOT / "examples" / "data" / "teapot-area-light-400x400.exr")
first, second = reference["first"], reference["second"]
scene = dmis.load_scene("teapot-area-light", resolution=(400, 400))
image = dmis.render(scene, "balance", opts.pick(2, 64), seed=1).image
squared = squared_error(image, first, second)
bright = np.square((first + second) / 2).mean(axis=2) + 0.01
maps = {"MSE": block_errors(squared), "relMSE": block_errors(squared / bright)}

figure, axes = print_canvas(1, 3, 2.2)
plot.picture(axes[0, 0], image, "image")
for axis, (name, values) in zip(axes[0, 1:], maps.items()):
    mappable = plot.heat(axis, np.log10(np.maximum(values, 0.01)), f"{name} sees", cmap="magma", vmin=-1.5, vmax=1.5)
    dark = bright[::BLOCK, ::BLOCK] < 0.1
    print(f"{name}: {values[dark].sum() / values.sum():.0%} of the error is in blocks darker than 0.3")
for axis in axes.flat:
    axis.set(xticks=[], yticks=[], xlabel="", ylabel="")
bar = figure.colorbar(mappable, ax=axes[0, 1:], ticks=[-1, 0, 1])
bar.ax.set_yticklabels(["0.1", "1", "10"])
bar.set_label("error / mean error")
opts.save(
    figure,
    "What MSE and relMSE see",
    """Left: a teapot by the balance heuristic. Middle and right: the error of each block of 8x8 pixels, divided by
    the mean over the image. MSE depends on bright parts, relMSE on dark parts, too.""",
)
if given.docs and opts.size != "quick":
    write_webp(opts.output, ROOT / "docs" / "images" / "errors.webp")
