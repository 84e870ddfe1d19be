"""Error of a patch against the weight w, for Figures 3.2 and 3.3."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.vectors import Array
from dmis.examples.gallery import Options, print_canvas
from dmis.fit.thesis import parabola_minimum

WEIGHTS = np.array([0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1])
"""Weights at which the error is measured."""
STRATEGIES = np.array([0, 0.5, 1])
"""Weights of the thesis's pilot: BRDF sampling, balance heuristic, light sampling."""
READINGS = {"heuristic": ("tilt of the heuristic", "-"), "samples": ("share", "--")}
"""What w may weigh, its name in the legend, and its line."""


@dataclass(frozen=True)
class PatchCurve:
    """Error of a patch, and what the rule makes of it.

    Attributes
    ----------
    window
        The patch, in pixels.
    error, bars
        By reading of w, at `WEIGHTS`: the mean squared error in multiples of that at
        w = 1/2, and two standard errors of it.
    exact
        Weight of the patch by the tilt's errors at `STRATEGIES`.
    learned
        Weights of the patch by pilots with other random numbers.
    """

    window: plot.Window
    error: dict[str, Array]
    bars: dict[str, Array]
    exact: float
    learned: Array


def measure_patch(scene: dmis.Scene, opts: Options, corner: tuple[float, float]) -> PatchCurve:
    """Return the curves of a patch, which is rendered alone; `corner` is its top left
    corner in shares of the image."""
    patch, spp, seeds = opts.pick((4, 16, 2), (16, 122, 24))
    columns, rows = scene.camera.resolution
    top, left = round(corner[0] * rows), round(corner[1] * columns)
    window = (top, top + patch), (left, left + patch)
    crop = scene.crop(*window)
    # Step 1, the curve: fixed weights, again and again. The mean squared error is the
    # mean over seeds, pixels and channels of (x - r₁)(x - r₂), where r₁ and r₂ are two
    # independent halves of a reference, whose own noise cancels.
    reference = opts.reference(crop, opts.pick(256, 8192))
    error, bars = {}, {}
    for weigh in READINGS:
        budgets = [(f"fixed:{w:g},weigh={weigh}", spp) for w in WEIGHTS]
        runs = dmis.measure(crop, budgets, range(seeds), reference, preset="thesis")
        mse = np.array([[run.mse for run in runs[budget]] for budget in budgets])
        mse /= mse[WEIGHTS == 0.5].mean()
        error[weigh] = mse.mean(axis=1)
        bars[weigh] = 2 * mse.std(axis=1, ddof=1) / seeds**0.5
    # Step 2, three points of it: an unbiased estimator's error is its variance, MSE =
    # Var (Eq. 3.1), and a variance needs no reference.
    points = error["heuristic"][np.isin(WEIGHTS, STRATEGIES)]
    # Step 3, the fit: a₂ w² + a₁ w + a₀ through the points (Eqs. 3.2-3.4). Its minimum
    # is the weight of the patch, w = -a₁ / (2 a₂) (Eq. 3.5), clipped to [0, 1].
    exact = float(parabola_minimum(STRATEGIES, points)[0])
    # The pilot's data: the rule has the sample variances of two samples per pixel,
    # y = Σ (x - mean)², averaged over the patch, in place of the exact points.
    y = [
        [
            luminance(dmis.render(crop, rule, 2, seed=k, preset="thesis").variance)
            for k in range(j, 3 * opts.pick(5, 40), 3)
        ]
        for j, rule in enumerate(f"fixed:{w:g},weigh=heuristic" for w in STRATEGIES)
    ]
    learned = parabola_minimum(STRATEGIES, np.mean(y, axis=(2, 3)))[0]
    return PatchCurve(window, error, bars, exact, learned)


def print_curves(curves: dict[str, PatchCurve]) -> None:
    """Print the curves, their weights, and the weights of their pilots."""
    for colour, curve in curves.items():
        for weigh, error in curve.error.items():
            points = ", ".join(f"{v:.2f} at {w:g}" for w, v in zip(WEIGHTS, error))
            print(f"{colour:5} weigh={weigh}: V(w) / V(1/2) {points}")
        low, middle, high = np.quantile(curve.learned, (0, 0.5, 1))
        print(
            f"{colour:5} minimum of the exact parabola {curve.exact:.2f},"
            f" of pilots {middle:.2f} ({low:.2f} to {high:.2f})"
        )


def draw_curves(scene: dmis.Scene, opts: Options, curves: dict[str, PatchCurve]) -> tuple[Any, Any]:
    """Draw a picture with the patches (left), their curves (right), and the weights
    that the rule gives them (below); return the figure and the axes of the curves."""
    figure = print_canvas(1, 1, 3.4)[0]
    figure.clear()
    axes = figure.subplot_mosaic(
        [["image", "curves"], ["image", "weights"]],
        width_ratios=[1, 1.6],
        height_ratios=[4, 1],
    )
    spp = opts.pick(4, 32)
    image = dmis.render(scene, "balance", spp, seed=1, preset="thesis").image
    plot.picture(axes["image"], image)
    axes["image"].set_axis_off()
    axis, below = axes["curves"], axes["weights"]
    for row, (name, curve) in enumerate(reversed(curves.items())):
        plot.mark(axes["image"], curve.window, f"tab:{name}")
        style = {"color": f"tab:{name}", "markersize": 3}
        for weigh, (_, line) in READINGS.items():
            error, bars = curve.error[weigh], curve.bars[weigh]
            axis.errorbar(WEIGHTS, error, bars, fmt=f"o{line}", **style)
        pilots = np.full(len(curve.learned), row)
        below.plot(curve.learned, pilots, "|", color=f"tab:{name}", markersize=7)
        below.plot(curve.exact, row + 0.45, "kv")
    axis.set_yscale("log")
    plot.round_ticks(axis.yaxis)
    axis.set_ylabel("MSE / MSE at w = ½")
    axis.tick_params(labelbottom=False)
    axis.sharex(below)
    below.set_ylim(-0.6, len(curves) - 0.2)
    below.set_yticks(range(len(curves)), reversed(curves))
    below.set_xlabel("w  (0: BRDF sampling, ½: balance heuristic, 1: light sampling)")
    for name, line in READINGS.values():
        axis.plot([], [], line, color="black", label=f"w a {name}")
    below.plot([], [], "k|", markersize=7, label="w learned from a pilot")
    below.plot([], [], "kv", label="w of the exact parabola")
    figure.legend(loc="outside lower center", ncols=4, columnspacing=1.2)
    return figure, axis
