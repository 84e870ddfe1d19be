"""Curves over the weight in a single patch: what several figures measure and draw."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from common import Options

import dmis
from dmis import plot
from dmis.experiment.metrics import mean_and_error


@dataclass(frozen=True)
class Curve:
    """Measured mean squared error of a patch against the share of light samples."""

    w: np.ndarray
    mse: np.ndarray
    error: np.ndarray  # standard errors over seeds
    spp: int

    @property
    def best(self) -> int:
        """Number of the lowest point."""
        return int(self.mse.argmin())


WEIGHTS = (0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 1)


def patch_at(scene: dmis.Scene, row: float, column: float, size: int) -> plot.Window:
    """A patch of `size` pixels on a side, at a place given in shares of the image."""
    width, height = scene.camera.resolution
    top, left = round(row * height), round(column * width)
    return (top, min(top + size, height)), (left, min(left + size, width))


def mse_curve(opts: Options, scene: dmis.Scene, patch: plot.Window, weights: Sequence[float] = WEIGHTS) -> Curve:
    """Render the patch alone, again and again, with fixed weights."""
    crop = scene.crop(*patch)
    reference = opts.reference(crop, opts.pick(1024, 8192, 16384))
    spp, seeds = opts.pick(16, 122), opts.pick(2, 16, 64)
    runs = dmis.measure(crop, [(f"fixed:{w}", spp) for w in weights], range(seeds), reference, parallel=1)
    values = [mean_and_error(np.array([run.mse for run in runs[f"fixed:{w}", spp]])) for w in weights]
    mse, error = np.transpose(values)
    return Curve(np.array(weights, float), mse, error, spp)


STRATEGIES = np.array([0, 0.5, 1])
"""The weights of the thesis's pilots."""


@dataclass(frozen=True)
class Pilot:
    """What one pilot of the thesis's rule says about a patch."""

    variances: np.ndarray  # at STRATEGIES
    w: float  # where the parabola has its minimum, clipped


def pilot(scene: dmis.Scene, patch: plot.Window, seed: int, spp: int = 2) -> Pilot:
    """Render the pilot of the thesis's rule in the patch, and fit."""
    (top, bottom), (left, right) = patch
    size = max(bottom - top, right - left)
    rule = f"thesis:patch={size},filter=none,spp={spp},channels=rgb"
    maps = dmis.render(scene.crop(*patch), rule, 3 * spp + 1, seed=seed, parallel=1).maps
    return Pilot(maps["variances"][:, 0, 0], float(maps["raw"][0, 0]))


def parabola(variances: np.ndarray, w: np.ndarray) -> np.ndarray:
    """The parabola through three variances, those of the `STRATEGIES`, at the weights w: thesis Eqs. 3.2-3.4."""
    return np.polyval(np.polyfit(STRATEGIES, variances, 2), w)


def draw_curve(axis, curve: Curve) -> None:
    """The measured curve with error bars, and its lowest point."""
    axis.errorbar(
        curve.w, curve.mse, 2 * curve.error, color="black", marker="o", markersize=3, capsize=2,
        label="measured, ± 2 s.e.",
    )  # fmt: skip
    axis.plot(
        curve.w[curve.best], curve.mse[curve.best], "*", color="black", markersize=15,
        label=f"lowest measured, w = {curve.w[curve.best]:g}",
    )  # fmt: skip
    axis.set_xlabel("share of light samples w  (0: BRDF only, 1: light only)")


def draw_pilots(axis, pilots: Sequence[Pilot], spp: int) -> None:
    """The three points of the first pilot with its parabola and minimum; the others faintly."""
    w = np.linspace(0, 1, 101)
    for k, one in enumerate(pilots[1:]):
        label = f"parabolas of {len(pilots) - 1} other pilots" if k == 0 else None
        axis.plot(w, parabola(one.variances, w) / spp, color="tab:red", alpha=0.15, label=label)
    first = pilots[0]
    axis.plot(STRATEGIES, first.variances / spp, "s", color="tab:red", label="one pilot: sample variance / spp")
    axis.plot(
        w, parabola(first.variances, w) / spp, color="tab:red", linestyle="--", label="its parabola (Eqs. 3.2-3.4)"
    )
    axis.axvline(first.w, color="tab:red", linewidth=1, label=f"the w that it gives (Eq. 3.5): {first.w:.2f}")


def measure_patches(opts: Options, scene: dmis.Scene, patches: dict[str, plot.Window], count: int):
    """The curve of each patch, and what `count` independent pilots say of it, by name; both are printed."""
    curves = {name: mse_curve(opts, scene, patch) for name, patch in patches.items()}
    pilots = {name: [pilot(scene, patch, seed) for seed in range(count)] for name, patch in patches.items()}
    for name, curve in curves.items():
        best, fitted = f"{curve.mse.min():.2e} at w = {curve.w[curve.best]:g}", [f"{p.w:.2f}" for p in pilots[name]]
        print(f"{name}: lowest MSE {best}; fitted w of the pilots: {', '.join(fitted)}")
    return curves, pilots


def draw_patches(axes, image: np.ndarray, title: str, patches: dict[str, plot.Window], curves, pilots) -> None:
    """The image with the patches marked, and in a panel for each its curve and pilots."""
    plot.picture(axes[0], image, title)
    for axis, (name, patch), colour in zip(axes[1:], patches.items(), ("red", "cyan"), strict=True):
        plot.mark(axes[0], patch, colour, name[0])
        draw_curve(axis, curves[name])
        draw_pilots(axis, pilots[name], curves[name].spp)
        (top, bottom), (left, right) = patch
        axis.set_ylabel(f"mean squared error at {curves[name].spp} spp (linear RGB²)")
        axis.set_title(f"patch {name}, {right - left}x{bottom - top} pixels")
