"""Error of a patch against the share w of light samples, for Figures 3.2 and 3.3."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import dmis
from dmis.base.color import luminance
from dmis.base.vectors import Array
from dmis.fit.thesis import parabola_minimum
from examples.gallery import Options

WEIGHTS = np.array(
    [0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 1]
)
"""Shares of light samples at which the error is measured."""
STRATEGIES = np.array([0, 0.5, 1])
"""Shares of the thesis's pilot: BRDF sampling, balance heuristic, light sampling."""


@dataclass(frozen=True)
class PatchCurve:
    """Error of a patch, in multiples of its error at w = 1/2, and what is fitted to it.

    Attributes
    ----------
    error, bars
        At `WEIGHTS`: the mean squared error, and two standard errors of it.
    parabola
        Coefficients of the parabola through the errors at `STRATEGIES`, w² first.
    minimum
        Weight of the patch by that parabola.
    learned
        Weights of the patch by pilots with other random numbers.
    """

    error: Array
    bars: Array
    parabola: Array
    minimum: float
    learned: Array


def measure_patch(crop: dmis.Scene, opts: Options, spp: int, seeds: int) -> PatchCurve:
    """Return the curve of a patch, which is rendered alone."""
    # Step 1, the curve: fixed weights, again and again. The mean squared error is the
    # mean over seeds, pixels and channels of (x - r₁)(x - r₂), where r₁ and r₂ are two
    # independent halves of a reference, whose own noise cancels.
    reference = opts.reference(crop, opts.pick(256, 8192))
    budgets = [(f"fixed:{w:g}", spp) for w in WEIGHTS]
    runs = dmis.measure(crop, budgets, range(seeds), reference, preset="thesis")
    mse = np.array([[run.mse for run in runs[budget]] for budget in budgets])
    at_half = mse[WEIGHTS == 0.5].mean()
    error = mse.mean(axis=1) / at_half
    bars = 2 * mse.std(axis=1, ddof=1) / seeds**0.5 / at_half
    # Step 2, three points of it: an unbiased estimator's error is its variance, MSE =
    # Var (Eq. 3.1), and a variance needs no reference.
    points = error[np.isin(WEIGHTS, STRATEGIES)]
    # Step 3, the fit: a₂ w² + a₁ w + a₀ through the points (Eqs. 3.2-3.4). Its minimum
    # is the weight of the patch, w = -a₁ / (2 a₂) (Eq. 3.5), clipped to [0, 1].
    parabola = np.polyfit(STRATEGIES, points, 2)
    minimum = float(parabola_minimum(STRATEGIES, points)[0])
    # The pilot's data: the rule has the sample variances of two samples per pixel,
    # y = Σ (x - mean)², averaged over the patch, in place of the exact points.
    pilots = [
        [
            dmis.render(crop, f"fixed:{w:g}", 2, seed=3 * k + j, preset="thesis")
            for j, w in enumerate(STRATEGIES)
        ]
        for k in range(opts.pick(5, 40))
    ]
    y = [[luminance(result.variance).mean() for result in pilot] for pilot in pilots]
    learned = parabola_minimum(STRATEGIES, np.transpose(y))[0]
    return PatchCurve(error, bars, parabola, minimum, learned)


def print_curve(colour: str, curve: PatchCurve) -> None:
    """Print a curve, its weight, and the weights of its pilots."""
    points = ", ".join(f"{v:.2f} at {w:g}" for w, v in zip(WEIGHTS, curve.error))
    low, middle, high = np.quantile(curve.learned, (0, 0.5, 1))
    print(
        f"{colour:5} V(w) / V(1/2): {points}; minimum of the exact parabola"
        f" {curve.minimum:.2f}, of pilots {middle:.2f} ({low:.2f} to {high:.2f})"
    )


def draw_curve(
    axis: Any, colour: str, label: str, curve: PatchCurve, level: float
) -> None:
    """Draw a curve, its parabola and its minimum, and the pilots' minima as ticks at
    the height `level`."""
    colour, dense, w = f"tab:{colour}", np.linspace(0, 1, 201), curve.minimum
    axis.plot(WEIGHTS, curve.error, "o-", color=colour, label=label)
    axis.errorbar(WEIGHTS, curve.error, curve.bars, fmt="none", color=colour)
    through = "parabola through V(0), V(½), V(1)"
    axis.plot(
        dense, np.polyval(curve.parabola, dense), "--", color=colour, label=through
    )
    marker = {
        "markersize": 8,
        "markeredgecolor": "black",
        "label": f"its minimum, w = {w:.2f}",
    }
    axis.plot(w, np.polyval(curve.parabola, w), "v", color=colour, **marker)
    ticks = {"markersize": 7, "label": f"minima of {len(curve.learned)} pilots"}
    axis.plot(
        curve.learned, np.full(len(curve.learned), level), "|", color=colour, **ticks
    )
    axis.set_xlabel("share of light samples w  (0: BRDF only, 1: light only)")
    axis.set_ylabel("MSE / MSE at w = ½")
