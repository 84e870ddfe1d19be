"""
Low-discrepancy points: nets, orders and slopes
===============================================

The sampler ``sobol`` in three pictures: how well 16 points of its sequence are
stratified; why the light's pair of numbers must not have the order of the camera's
pair; and how fast the error falls for smooth integrands and for edges. The page
"Low-discrepancy points" explains all three.
"""

import numpy as np

from dmis.examples.gallery import options, print_canvas
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.sobol import Sobol

opts, _ = options("plot_nets", __doc__)
PIXELS, N = (50, 1024) if opts.size == "quick" else (400, 4096)

# %%
# Draw the camera's and the light's pair of the first N camera samples of some pixels,
# (2, N, PIXELS), as the renderer does.
sampler = Sobol(PixelBlock(np.random.default_rng(), 1, np.arange(PIXELS), [N], 2))
sampler.start(np.tile(np.arange(PIXELS), N), np.repeat(np.arange(N), PIXELS))
camera, light, other = (
    sampler.draw(key, None).reshape(2, N, PIXELS) for key in ("camera", (0, 0), (1, 0))
)
random = np.random.default_rng(1).random((4, N, PIXELS))

# %%
# Top left: the points of one pixel. Boxes of area 1/16 come in five shapes, and every
# box holds one of the 16 points. Top right: the light's first number against the
# camera's. In the same order the two numbers form a pattern with gaps, however many
# samples are drawn. In an order of its own the light's number fills the square.
figure, axes = print_canvas(2, 3, 5)
for axis, columns, rows in zip(axes[0, :2], (4, 16), (4, 1), strict=True):
    axis.vlines(
        np.arange(columns + 1) / columns,
        0,
        1,
        color="0.8",
    )
    axis.hlines(np.arange(rows + 1) / rows, 0, 1, color="0.8")
    axis.plot(*camera[:, :16, 0], "o", color="tab:blue")
    axis.set_title(f"16 samples in {columns} × {rows} boxes")
    axis.set_xlabel("$u_0$")
    axis.set_ylabel("$u_1$")
# two lights share an order, because their light is added up; here they stand for a
# product
axes[0, 2].plot(
    other[0, :256, 0],
    light[0, :256, 0],
    "x",
    color="tab:red",
    markersize=3,
)
axes[0, 2].plot(
    camera[0, :256, 0],
    light[0, :256, 0],
    ".",
    color="tab:blue",
    markersize=3,
)
axes[0, 2].set_title("two pairs, 256 samples")
axes[0, 2].set_xlabel("$u_0$ of one pair")
axes[0, 2].set_ylabel("$u_0$ of the other")

# %%
# Bottom: mean squared error over the pixels for three integrands of both pairs. One is
# smooth, one has an edge across the pixel, like a silhouette, and one has an edge
# through all four dimensions, like a shadow.


def smooth(u):
    """Return a smooth product with mean 1."""
    return np.prod(0.5 + u, axis=0)


def silhouette(u):
    """Return the smooth function of the light on one side of an edge in the pixel, else
    0; the mean is 0.4.
    """
    return smooth(u[2:]) * (u[0] + 0.7 * u[1] < 0.75)


def shadow(u):
    """Return 1 in a corner of the cube, where the sum of four numbers is below 1.5; its
    volume is 77/384.
    """
    return u.sum(axis=0) < 1.5


counts = 2 ** np.arange(3, N.bit_length())
slopes = {}
for axis, (name, f, mean) in zip(
    axes[1],
    (
        ("smooth", smooth, 1),
        ("silhouette", silhouette, 0.4),
        ("shadow", shadow, 77 / 384),
    ),
    strict=True,
):
    for label, u, colour in (
        ("independent", random, "0.4"),
        ("two pairs in one order", np.concatenate([other, light]), "tab:red"),
        ("sobol", np.concatenate([camera, light]), "tab:blue"),
    ):
        values = f(u)
        mse = [np.mean((values[:n].mean(axis=0) - mean) ** 2) for n in counts]
        slopes[name, label] = np.polyfit(np.log(counts), np.log(mse), 1)[0]
        axis.loglog(
            counts,
            mse,
            "o-",
            color=colour,
            label=label,
            markersize=2.5,
        )
    axis.set_title(name)
    axis.set_xlabel("camera samples n")
    axis.set_xticks([10, 100, 1000])
axes[1, 0].set_ylabel("mean squared error")
figure.legend(
    *axes[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3
)
print(
    "\n".join(
        f"{name:12} {label:24} n^{slope:.2f}" for (name, label), slope in slopes.items()
    )
)
opts.save(
    figure,
    "Low-discrepancy points: nets, orders and slopes",
    f"""Top: the first 16 points of the sampler sobol in one pixel have one in each box
    of area 1/16, of any shape; and the first numbers of two pairs of 256 camera
    samples, at the same points of the sequence (red) and in orders of their own (blue).
    Bottom: mean squared error over {PIXELS} pixels of integrands of two pairs, of mean
    1, 0.4 and 0.2. From 8 to {N} samples it falls like
    n^{slopes["smooth", "sobol"]:.1f} where the integrand is smooth,
    n^{slopes["silhouette", "sobol"]:.1f} with an edge in the pixel, and
    n^{slopes["shadow", "sobol"]:.1f} with an edge through all four dimensions;
    independent points have n^-1. In one order for both pairs (red) the error of what
    depends on both stays.""",
    panel=axes[1, 0],
)
