"""Ladder of bounds: how small an image's error could be in equal time, with one freedom of the estimator after another.

A camera sample with S shading samples has the variance ``V = P + A(w) / S``. P = Var_y(I) comes from where the camera
sample meets the scene (edges, textures), A(w) from the shading samples there (`dmis.variance.curves`). It costs
``C = c0 + S c1(w)`` (`dmis.estimator.cost`). If patch i takes n_i camera samples per pixel, the image's error times its
time is

    mean(V_i / n_i) mean(n_i C_i).

Each *rung* is the least of that over some of w, n and S, without a pilot, over its value for the balance heuristic with
one light and one BRDF sample. The choice is made on one half of an oracle's samples and evaluated on the other, both
ways round: noise raises the expected value of a rung, it does not lower it. The value itself has a standard error, by
its patches; that of B6 and B7, which rest on the small estimate P alone, is large. Evaluated on the samples that it was
made on, a choice looks better than it is; the difference says whether the samples are enough.

Camera samples are independent up to the last rung, which assumes that they are even (`Evenness`). What
control variates (B4) and product sampling without visibility (B5) could bring is left out.

    python benchmarks/ladder.py tt --resolution 300x167     prints the ladder of a scene; its oracle is kept

`make_ladder_table.py` makes the table of docs/measurements.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dmis.base.patches import patch_sum
from dmis.base.vectors import Array
from dmis.cli.arguments import RESOLUTION
from dmis.estimator.cost import camera_sample_cost
from dmis.estimator.settings import Settings, make_settings
from dmis.experiment.oracle import Oracle
from dmis.experiment.oracle_renders import curve_settings, make_oracle, oracle_key, read_curves
from dmis.experiment.reference import REFERENCE_SEED, cache_path
from dmis.fit.curve_minimum import PatchCurves, allowed_weights
from dmis.formats.load_scene import load_scene
from dmis.pipeline.render import render
from dmis.scene.scene import Scene
from dmis.variance.curves import GRID_SHARES, HALF, share_variance

RUNGS = {
    "B0": "balance heuristic, 1 + 1 shading samples",
    "B1": "best w per patch",
    "B2": "numbers of camera samples per patch, w = 1/2",
    "B2'": "w and numbers per patch",
    "B2''": "w and numbers per patch, one S for the image",
    "B3": "w, numbers and S per patch",
    "B6": "numbers per patch, perfect shading samples (A = 0)",
    "B7": "the same with low-discrepancy camera samples",
}
"""Names of the rungs and what may be chosen on each; B4 (control variates) and B5 (product sampling) are left out."""
SHADING_SAMPLES = (1, 2, 4, 8, 16)
"""Numbers S of shading samples that the image may have on rung B2''."""
MIN_COUNTS = 0.01, 0.03, 0.1
"""Least numbers of camera samples of a patch, over the mean, so that a patch without signal in one half gets some; each
rung has the best of these, by `SAFE_ERRORS`.
"""
SAFE_ERRORS = 4.0
"""Standard errors that are added to a rung before the best of `MIN_COUNTS` is picked: the least value is often the one
with the most luck. Without noise the rungs of these numbers differ by a factor of 1.1^(3/2) at most.
"""
S_LIMITS = 1 / 4, 16.0
"""Least and largest S of a patch on rung B3, against division by an estimate of P or A that is 0."""
EDGE_EXPONENT = 1.5
"""Exponent a of the error n^-a of low-discrepancy points in a pixel with an edge, which rung B7 does not exceed: its
samples go where edges are, and a larger exponent would be that of smooth pixels.
"""
INTERVAL = 1.96
"""Half the width of a 95 % confidence interval, in standard errors."""
EVEN_SPP, EVEN_RATIO, EVEN_SEEDS = 128, 4, 8
"""Camera samples per pixel at which `Evenness` is measured, what these are divided by for its slope, and renders."""


@dataclass(frozen=True)
class Evenness:
    """Error of the balance heuristic with Sobol points over that with independent ones, as a power of the samples.

    Attributes
    ----------
    ratio
        Mean squared error with Sobol points over that with independent points, at `EVEN_SPP`.
    exponent
        a, where the error with Sobol points falls as n^-a: 1 for independent points, 3/2 for edges in the pixel.
    """

    ratio: float
    exponent: float


@dataclass(frozen=True, eq=False)
class HalvedOracle(Oracle):
    """An oracle with what rungs take beside its curves.

    Attributes
    ----------
    halves
        Curves of two independent halves of the pilot, without their standard errors.
    shading_samples
        Shading samples S of a camera sample.
    base_cost
        Cost of a camera sample without its shading samples.
    """

    halves: tuple[PatchCurves, ...] = ()
    shading_samples: int = 2
    base_cost: float = 0.0


def halved_oracle(scene: Scene, spp: int, *, settings: Settings | None = None, **options: Any) -> HalvedOracle:
    """Return the oracle of a scene with its halves; arguments are those of `make_oracle`."""
    oracle = make_oracle(scene, spp, settings=settings, **options)
    key = oracle_key(scene, spp, oracle.patch, settings)
    rays, parts = read_curves(cache_path(scene, "oracle", key, options.get("folder"), ".npz"))
    pixels = patch_sum(np.ones(scene.camera.resolution[::-1]), oracle.patch)
    zero = np.broadcast_to(0.0, parts["curve"].shape[1:])
    halves = [PatchCurves(gain_square=zero, pixels=pixels, **{n: a[k] for n, a in parts.items()}) for k in (0, 1)]
    settings = make_settings(settings)
    s = settings.shading_samples
    base_cost = float(camera_sample_cost(rays, GRID_SHARES, 2 * s, 0, settings.techniques)[0])
    return HalvedOracle(
        oracle.variance, oracle.cost, oracle.patch, oracle.spp, oracle.shape, tuple(halves), s, base_cost
    )


def measure_evenness(scene: Scene, oracle: Oracle, *, settings: Settings | None = None, **options: Any) -> Evenness:
    """Return the evenness of a scene's Sobol points; `settings` are those of the oracle, `options` those of `render`.

    The error at `EVEN_SPP` and at a quarter of it is the variance over seeds of the mean of the channels, over all
    pixels. That with independent points is the oracle's.
    """
    settings, errors = replace(curve_settings(scene, settings), sampler="sobol"), []
    for n in (EVEN_SPP // EVEN_RATIO, EVEN_SPP):
        renders = (
            render(scene, "balance", n, seed=REFERENCE_SEED + 4 + k, settings=settings, **options)
            for k in range(EVEN_SEEDS)
        )
        images = [result.image.mean(axis=2, dtype=np.float64) for result in renders]
        errors.append(float(np.var(images, axis=0, ddof=1).mean()))
    fewer, error = errors
    independent = oracle.mean(oracle.variance[HALF]) / EVEN_SPP
    return Evenness(error / independent, float(np.log(fewer / error) / np.log(EVEN_RATIO)))


def rung_text(value: float, interval: float) -> str:
    """Return a rung with half of its 95 % confidence interval as text, or "< limit" if the interval reaches 0."""
    if not value > interval:
        return f"< {max(value, 0) + interval:.2g}"
    return f"{value:.3g} ± {interval:.2g}" if interval > 1e-9 else f"{value:.3g}"


@dataclass(frozen=True)
class Ladder:
    """Rungs of a scene, each an error in equal time over that of independent samples of the balance heuristic.

    Attributes
    ----------
    rungs
        Values by name (`RUNGS`), chosen on one half of the samples and evaluated on the other.
    standard_errors
        Standard errors of the rungs by name.
    flattered
        The rungs, chosen and evaluated on the same samples, where a P below 0 counts as 0.
    position
        Share of the variance at w = 1/2 that does not depend on the shading samples, ``P / V``.
    """

    rungs: Mapping[str, float]
    standard_errors: Mapping[str, float]
    flattered: Mapping[str, float]
    position: float

    def text(self) -> str:
        """Return a line for each rung, with its 95 % interval, and the rung that is evaluated on its own samples."""
        lines = [f"Of the variance at w = 1/2, {self.position:.0%} does not depend on the shading samples."]
        for name, value in self.rungs.items():
            text = rung_text(value, INTERVAL * self.standard_errors[name])
            lines.append(f"{name:4} {text:16} ({self.flattered[name]:.3g} on the same samples)  {RUNGS[name]}")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class _Choice:
    """What a rung takes in each patch: the index of w in the grid, and shading samples S of a camera sample.

    A number S for the image is whole, and so are the numbers of light samples. Where S differs from patch to patch it
    is any positive number.
    """

    best: np.ndarray
    shading_samples: Array | float


def make_ladder(oracle: HalvedOracle, evenness: Evenness | None = None) -> Ladder | None:
    """Return the ladder by the halves of an oracle, which takes a tenth of a second.

    It is None if the oracle has no variance.
    """
    variance = [oracle.mean(half.curve[HALF] + half.position) for half in oracle.halves]
    if not sum(variance) > 0:
        return None
    base = float(np.mean(variance) * oracle.cost[HALF])
    first, second = oracle.halves
    crossed = [
        [_rungs(oracle, *halves, evenness, least) for halves in ((first, second), (second, first))]
        for least in MIN_COUNTS
    ]
    rungs, errors = {}, {}
    for name in crossed[0][0]:
        estimates = [_rung(oracle, name, a, b, base) for a, b in crossed]
        rungs[name], errors[name] = min(estimates, key=lambda estimate: estimate[0] + SAFE_ERRORS * estimate[1])
    known = [replace(half, position=np.maximum(half.position, 0)) for half in oracle.halves]
    same = [_rungs(oracle, half, half, evenness, MIN_COUNTS[0]) for half in known]
    flattered = {
        name: sum(oracle.mean(of_half[name]) / oracle.mean(of_half["B0"]) for of_half in same) / 2 for name in rungs
    }
    position = float(np.mean([oracle.mean(half.position) for half in oracle.halves]) / np.mean(variance))
    return Ladder(rungs, errors, flattered, position)


def _rung(
    oracle: HalvedOracle, name: str, first: Mapping[str, Array], second: Mapping[str, Array], base: float
) -> tuple[float, float]:
    """Return a rung and its standard error, by the errors times cost per patch of both ways round."""
    rung = oracle.mean(first[name] + second[name]) / 2 / base
    # of the ratio of two means over patches, whose noise is independent; half the difference of two values is the error
    # of their mean
    differences = [(first[key] - second[key]) / 2 for key in (name, "B0")]
    noise = differences[0] - rung * differences[1]
    return rung, float(np.sqrt(np.square(oracle.pixel_share * noise).sum())) / base


def _rungs(
    oracle: HalvedOracle, chosen_on: PatchCurves, evaluated_on: PatchCurves, evenness: Evenness | None, least: float
) -> dict[str, Array]:
    """Return error times cost of all rungs, per patch, chosen on one half of an oracle's samples, evaluated on another.

    A rung is their mean over the image.
    """
    rungs = {}
    for name, choice in _choices(oracle, chosen_on).items():
        counts = np.ones(choice.best.shape)
        if name not in ("B0", "B1"):
            # n ~ sqrt(V / C)
            ratio = np.maximum(_variance(oracle, chosen_on, choice), 0) / _cost(oracle, choice)
            counts = _at_least(oracle, np.sqrt(ratio), least)
        # mean(V / n) mean(n C)
        error = _variance(oracle, evaluated_on, choice) / counts
        rungs[name] = error * oracle.mean(counts * _cost(oracle, choice))
    levels = {"B6": (1.0, 1.0)} | ({"B7": (evenness.ratio, min(evenness.exponent, EDGE_EXPONENT))} if evenness else {})
    for name, (ratio_of_errors, a) in levels.items():
        # V = P, C = c0: n ~ P^(1 / (1 + a)) minimises mean(P n^-a) at a given mean(n)
        counts = _at_least(oracle, np.maximum(chosen_on.position, 0) ** (1 / (1 + a)), least)
        # for the cost of N samples of the balance heuristic mean(n) is N C(1/2) / c0, and the error of a patch is
        # e(n) P / n = e(N) (n / N)^(1 - a) P / n
        position = evaluated_on.position / (counts / oracle.mean(counts)) ** a
        share = (oracle.base_cost / oracle.cost[HALF]) ** a
        rungs[name] = ratio_of_errors * share * position * oracle.cost[HALF]
    return rungs


def _choices(oracle: HalvedOracle, curves: PatchCurves) -> dict[str, _Choice]:
    """Return what is best on each rung with shading samples, by the curves of one half."""
    s = oracle.shading_samples
    # w = 0 and w = 1 only where they are as good for the image as their neighbours: patches seldom have rare samples
    allowed = allowed_weights(np.array([oracle.mean(curve) for curve in curves.curve]))[:, None, None]
    half = _Choice(np.full(curves.position.shape, HALF), s)
    at_any_share = replace(oracle, variance=np.where(allowed, curves.variance, np.inf))
    by_samples = {}
    for number in dict.fromkeys((s, *SHADING_SAMPLES)):
        # min over w of V C
        variance = np.maximum(_with_shading_samples(curves, number / s, s).variance, 0)
        product = np.where(allowed, variance * _costs(oracle, number)[:, None, None], np.inf)
        by_samples[number] = oracle.mean(np.sqrt(product.min(axis=0))), _Choice(product.argmin(axis=0), number)
    return {
        "B0": half,
        "B1": _Choice(at_any_share.best_index(costly=True), s),
        "B2": half,
        "B2'": by_samples[s][1],
        "B2''": min(by_samples.values(), key=lambda error_and_choice: error_and_choice[0])[1],
        "B3": _best_shading_samples(oracle, curves, allowed),
    }


def _best_shading_samples(oracle: HalvedOracle, curves: PatchCurves, allowed: np.ndarray) -> _Choice:
    """Return the `allowed` shares and any numbers S > 0 of shading samples of least V C, by the curves of one half."""
    # min over S of (P + A / S) (c0 + S c1) = (sqrt(P c0) + sqrt(A c1))^2  at  S = sqrt(A c0 / (P c1))
    position, shading = np.maximum(curves.position, 0), np.maximum(_shading_variance(oracle, curves), 0)
    per_sample = (oracle.cost - oracle.base_cost) / oracle.shading_samples
    best = np.where(allowed, shading * per_sample[:, None, None], np.inf).argmin(axis=0)
    falling, rising = _at_index(shading, best) * oracle.base_cost, position * per_sample[best]
    low, high = S_LIMITS
    shading_samples = np.sqrt(np.clip(falling, low**2 * rising, high**2 * rising) / np.where(rising > 0, rising, 1))
    return _Choice(best, np.where(rising > 0, shading_samples, high))


def _at_least(oracle: HalvedOracle, counts: Array, least: float) -> Array:
    """Return numbers of camera samples that are not below `least` times their mean; 1 if all are 0."""
    mean = oracle.mean(counts)
    return np.maximum(counts, least * mean) if mean > 0 else np.ones_like(counts)


def _variance(oracle: HalvedOracle, curves: PatchCurves, choice: _Choice) -> Array:
    """Return the variance of a camera sample per patch; an unbiased estimate, which may be negative."""
    if np.ndim(choice.shading_samples):
        shading = _at_index(_shading_variance(oracle, curves), choice.best) / choice.shading_samples
    else:
        factor = choice.shading_samples / oracle.shading_samples
        shading = _at_index(_with_shading_samples(curves, float(factor), oracle.shading_samples).curve, choice.best)
    return np.asarray(curves.position + shading)


def _with_shading_samples(curves: PatchCurves, factor: float, shading_samples: int) -> PatchCurves:
    """Return the curves of camera samples with `factor` times the `shading_samples` that `curves` have."""
    # E_y[...] / S falls as 1 / factor, var(n / S) Var_y(D) is that of the new number of samples
    change = share_variance(shading_samples * factor) - share_variance(shading_samples) / factor
    return replace(curves, curve=curves.curve / factor + change[:, None, None] * np.asarray(curves.pattern))


def _shading_variance(oracle: HalvedOracle, curves: PatchCurves) -> Array:
    """Return A(w), the variance of a shading sample with fixed shares, at the shares of the grid, ``(G, ...)``."""
    # curve = A / S + var(n / S) Var_y(D)
    rounding = share_variance(oracle.shading_samples)[:, None, None] * curves.pattern
    return np.asarray((curves.curve - rounding) * oracle.shading_samples)


def _costs(oracle: HalvedOracle, shading_samples: float) -> Array:
    """Return the cost of a camera sample with other numbers of shading samples, at the shares of the grid, ``(G,)``."""
    # C = c0 + S c1
    return oracle.base_cost + (oracle.cost - oracle.base_cost) * (shading_samples / oracle.shading_samples)


def _cost(oracle: HalvedOracle, choice: _Choice) -> Array:
    """Return the cost of a camera sample per patch."""
    varying = (oracle.cost - oracle.base_cost)[choice.best] / oracle.shading_samples
    return oracle.base_cost + varying * choice.shading_samples


def _at_index(values: Array, index: np.ndarray) -> Array:
    """Return the values ``(G, ...)`` at an index ``(...)`` into the grid."""
    return np.take_along_axis(values, index[None], axis=0)[0]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("scene")
    parser.add_argument("--resolution", type=RESOLUTION, metavar="WxH")
    parser.add_argument("--spp", type=int, default=2048, help="camera samples per pixel, a multiple of 4 (2048)")
    given = parser.parse_args()
    scene, plain = load_scene(given.scene, given.resolution), Settings(compensation=0)
    oracle = halved_oracle(scene, given.spp, settings=plain)
    ladder = make_ladder(oracle, measure_evenness(scene, oracle, settings=plain))
    print("every sample of the scene is the same" if ladder is None else ladder.text())
