"""Oracle: converged variance curves of an image, the best weights by them, and the regret of other weights.

The curves V(w) are those of `dmis.variance.curves`, or of `dmis.variance.tilt_curves` if w tilts the heuristic alone,
from a pilot of thousands of samples per pixel with its own random numbers, cached on disk like references. They give
the error of any share map without rendering it.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Generator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dmis import __version__
from dmis.base.atomic_files import check_writable, replacing
from dmis.base.patches import patch_mean, patch_sum
from dmis.base.validate import whole
from dmis.base.vectors import Array
from dmis.estimator.cost import camera_sample_cost
from dmis.estimator.settings import Settings, make_settings, resolve_auto
from dmis.experiment.reference import REFERENCE_SEED, cache_path, remove_halves, render_halves
from dmis.fit.round import Budget, Fit, Pilot, Round, check_weigh
from dmis.fit.second_moment import SecondMoment
from dmis.pipeline.executor import Parallel
from dmis.pipeline.fingerprint import fingerprint
from dmis.pipeline.job import LEARNED_COMPENSATION
from dmis.pipeline.progress import Progress
from dmis.scene.scene import Scene
from dmis.variance.curves import GRID, GRID_SHARES, HALF
from dmis.variance.tilt_curves import TiltCurves

LAYOUT = 3
"""Number of the layout of an oracle's file; a new one makes files of the old layout not be read."""
_CURVE_PARTS = ("curve", "pattern", "position")
"""Parts of the variance curves that an oracle's file has, see `dmis.variance.curves.Curves.sums`."""
HARM_LIMIT = 1.02
"""Ratio of the variance of a weight to that of w = 1/2 above which the weight counts as harmful."""


@dataclass(frozen=True, eq=False)
class Oracle:
    """Converged curves V(w) of an image, for one combiner.

    Attributes
    ----------
    variance
        Variance of a camera sample at the shares of `dmis.variance.curves.GRID`, per patch, ``(G, rows, columns)``, of
        the mean of the channels' radiance.
    cost
        Cost of a camera sample at these shares, ``(G,)``, or in each patch, as `variance`; see `dmis.estimator.cost`.
    patch
        Side of a patch in pixels.
    spp
        Samples per pixel of the pilot.
    shape
        ``(H, W)`` of the image: patches at its border may be smaller, and count for less; None: all are whole.
    """

    variance: Array
    cost: Array
    patch: int
    spp: int
    shape: tuple[int, int] | None = None

    @cached_property
    def pixel_share(self) -> Array:
        """Share of the image's pixels in each patch, ``(rows, columns)``."""
        rows, columns = self.variance.shape[1:]
        area = patch_sum(np.ones(self.shape or (rows * self.patch, columns * self.patch)), self.patch)
        return area / area.sum()

    @cached_property
    def costs(self) -> Array:
        """Cost of a camera sample in each patch, ``(G, rows, columns)``."""
        return np.broadcast_to(self.cost if self.cost.ndim > 1 else self.cost[:, None, None], self.variance.shape)

    @property
    def half(self) -> int:
        """Index of w = 1/2 in the grid, its middle."""
        return len(self.variance) // 2

    def mean(self, values: Array) -> float:
        """Return the mean over the image of values per patch."""
        return float((values * self.pixel_share).sum())

    def best(self, costly: bool = False) -> Array:
        """Return the weight of least variance per patch, ``(rows, columns)``.

        If `costly`, return the map of least variance of the image times its cost, with the same number of samples in
        all patches.
        """
        return GRID[self.best_index(costly)]

    def best_index(self, costly: bool = False) -> np.ndarray:
        """Return the indices in the grid of `best`."""
        best = self.variance.argmin(axis=0)
        for _ in range(10 if costly else 0):  # the price of cost depends on the map: a fixed point
            price = self.mean(_at_index(self.variance, best)) / self.mean(_at_index(self.costs, best))
            best = (self.variance + price * self.costs).argmin(axis=0)
        return best

    def at(self, weight: Array | float) -> Array:
        """Return the variance of a camera sample per patch at a share map ``(H, W)``, or at one share for all."""
        rows, columns = self.variance.shape[1:]
        w = patch_mean(np.asarray(weight), self.patch) if np.ndim(weight) else np.full((rows, columns), float(weight))
        return between(self.variance, w)

    def saving(self, weight: Array) -> float:
        """Return the share of the best weights' saving over w = 1/2 that a share map reaches.

        It is 1 for the oracle and 0 for w = 1/2; NaN if no weight saves anything.
        """
        half, best = self.mean(self.variance[HALF]), self.mean(self.variance.min(axis=0))
        return (half - self.mean(self.at(weight))) / (half - best) if half > best else float("nan")

    def limit(self, costly: bool = False) -> float:
        """Return the variance of the image with the best weights over that with w = 1/2, at equal samples; `costly`: in
        equal time by the cost model, without a pilot. 1 where there is no variance.
        """
        best = self.best_index(costly)
        cost = self.mean(_at_index(self.costs, best)) / self.mean(self.costs[self.half]) if costly else 1.0
        half, variance = self.mean(self.variance[self.half]), self.mean(_at_index(self.variance, best))
        return float(variance / half * cost) if half > 0 else 1.0

    def spread_evenly(self) -> float:
        """Return the variance with samples per patch in proportion to its root, over that with even samples.

        That is ``mean(sqrt V)^2 / mean(V)`` at w = 1/2 and equal samples; 1 if there is no variance.
        """
        # n ~ sqrt(V)   (docs/theory.md, Eq. 20)
        half = np.maximum(self.variance[HALF], 0)
        return self.mean(np.sqrt(half)) ** 2 / self.mean(half) if half.any() else 1.0

    def limit_with_counts(self) -> float:
        """Return variance times cost with the best weights and allocation, over that with w = 1/2 and even samples.

        That is ``mean(sqrt(V C))^2 / (mean(V) C)`` without a pilot; 1 if there is no variance.
        """
        half = self.mean(self.variance[self.half])
        if not half > 0:
            return 1.0
        least = (np.maximum(self.variance, 0) * self.costs).min(axis=0)
        return self.mean(np.sqrt(least)) ** 2 / (half * self.mean(self.costs[self.half]))

    def text(self) -> str:
        """Return a sentence with what the best weights and numbers of samples leave of the error of w = 1/2."""
        return (
            f"The best weights leave {self.limit():.3f} of the error of w = 1/2 at equal samples, "
            f"{self.limit(costly=True):.3f} in equal time; the best numbers of samples {self.spread_evenly():.3f}, "
            f"both {self.limit_with_counts():.3f}."
        )

    def regret(self, weight: Array) -> Array:
        """Return the variance beyond that of the best weight, over that of w = 1/2, per patch; 0 in black patches."""
        excess = self.at(weight) - self.variance.min(axis=0)
        return np.divide(excess, self.variance[HALF], out=np.zeros_like(excess), where=self.variance[HALF] > 0)

    def harm(self, weight: Array) -> tuple[float, float]:
        """Return the share of lit patches that a share map harms, and its standard error; 0 if no patch is lit.

        A patch is harmed if its variance is more than `HARM_LIMIT` times that of w = 1/2.
        """
        lit = self.variance[HALF] > 0
        if not lit.any():
            return 0.0, 0.0
        harmed = (self.at(weight) > HARM_LIMIT * self.variance[HALF])[lit]
        return float(harmed.mean()), float(harmed.std() / np.sqrt(harmed.size))


def between(curves: Array, weight: Array) -> Array:
    """Return curves ``(G, rows, columns)`` at shares ``(rows, columns)``, linear between the shares of `GRID`."""
    k = np.clip(np.searchsorted(GRID, weight, "right") - 1, 0, len(GRID) - 2)
    low, high = (_at_index(curves, i) for i in (k, k + 1))
    return low + (weight - GRID[k]) / (GRID[k + 1] - GRID[k]) * (high - low)


def _at_index(values: Array, index: np.ndarray) -> Array:
    """Return the values ``(G, ...)`` at an index ``(...)`` into the grid."""
    return np.take_along_axis(values, index[None], axis=0)[0]


def make_oracle(
    scene: Scene,
    spp: int = 2048,
    patch: int = 4,
    *,
    settings: Settings | None = None,
    weigh: str = "samples",
    folder: str | os.PathLike[str] | None = None,
    parallel: Parallel = None,
    progress: Progress | bool | None = None,
    **options: Any,
) -> Oracle:
    """Return the oracle of `scene`, rendered at the first call and read from the cache afterwards.

    Parameters
    ----------
    spp
        Samples per pixel, a multiple of 4 of at least 8: half of them in each of two independent halves.
    patch
        Side of a patch in pixels, a multiple of 4.
    weigh
        What w is, see `dmis.fit.round.WEIGH`; ``heuristic``, as of ``thesis``, has the same cost at every w.
    settings, folder, parallel, progress, options
        See `dmis.experiment.reference.make_reference`. The curves of skies depend on `compensation`, whose default is
        that of rules that learn; give 0 to judge ``thesis``, or to predict the error of ``balance``.
    """
    spp, patch = whole("spp", spp, 1), whole("patch", patch, 1)
    if spp < 8 or spp % 4:
        raise ValueError(
            f"spp of an oracle must be a multiple of 4, and at least 8, for two halves of pairs; got {spp}"
        )
    settings = make_settings(settings, **options)
    check_weigh(weigh, settings.combiner)
    path = oracle_path(scene, spp, patch, settings, folder, weigh)
    if not scene.plan.mixable:
        raise ValueError(
            f"an oracle needs a light that two techniques can reach; scene {scene.name!r} has nothing to mix, and the "
            f"same variance at every share. Compare its rules without an oracle"
        )
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        check_writable(path)
        maps_of_curves = _CurveMaps if weigh == "samples" else _TiltMaps
        rule = maps_of_curves(patch=patch, spp=spp // 2, filter="none", combiner=settings.combiner)
        results = render_halves(
            path, scene, rule, spp // 2 + 1, REFERENCE_SEED + 2, settings=settings, parallel=parallel, progress=progress
        )
        rays: Counter[str] = sum((Counter(result.provenance["pilot_rays"]) for result in results), Counter())
        maps = {name: np.stack([result.maps[name] for result in results]).astype(np.float32) for name in _CURVE_PARTS}
        with replacing(path) as partial, open(partial, "wb") as archive:
            np.savez(archive, allow_pickle=False, rays=np.array(json.dumps(rays)), **maps)
        remove_halves(path)
    counted, parts = read_curves(path)
    # V(w) = curve + Var_y(I)
    variance = parts["curve"].mean(axis=0) + np.maximum(parts["position"].mean(axis=0), 0)
    settings = resolve_auto(settings, scene)
    s = settings.shading_samples
    pilot_s, shares = (2 * s, GRID_SHARES) if weigh == "samples" else (s, np.full_like(GRID_SHARES, 0.5))
    cost = camera_sample_cost(counted, shares, pilot_s, s, settings.techniques)
    return Oracle(variance, cost, patch, spp, scene.camera.resolution[::-1])


def read_curves(path: Path) -> tuple[dict[str, int], dict[str, Array]]:
    """Return the rays and the parts of the curves of both halves ``(2, ...)`` in a file of the cache.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as arrays:
            return json.loads(str(arrays["rays"])), {name: arrays[name].astype(np.float64) for name in _CURVE_PARTS}
    except Exception as error:  # a damaged archive may raise anything
        raise ValueError(f"oracle {path} is damaged ({error}); remove it, and it is rendered again") from error


@dataclass(frozen=True)
class _CurveMaps(SecondMoment):
    """Rule whose maps are the parts of the variance curves; it mixes both techniques equally."""

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        """Return equal shares, and the means over patches of the parts of the curves."""
        means, _ = self._pool(pilot[0.5])
        return Fit(0.5, {name: means[name] for name in _CURVE_PARTS})


@dataclass(frozen=True)
class _TiltMaps(_CurveMaps):
    """Rule whose maps are the variance at every tilt, in the form of the curves of shares."""

    def rounds(self, budget: Budget) -> Generator[Round, Pilot, None]:
        """Yield camera samples of the balance heuristic, without pairs, and a final pass."""
        film = yield replace(budget.pilot(0.5, self.spp), statistic=TiltCurves)
        variance = self._pool(film)[0]["curve"]
        parts = {"pattern": np.zeros_like(variance), "position": np.zeros_like(variance[0])}
        yield budget.final(Fit(0.5, {"curve": variance, **parts}), self.spp)


def curve_settings(scene: Scene, settings: Settings | None) -> Settings:
    """Return the settings of an oracle's renders: sky compensation as with rules that learn, if the scene has a sky."""
    settings = settings or Settings()
    share = LEARNED_COMPENSATION if settings.compensation is None else settings.compensation
    return replace(settings, preset=None, compensation=share if scene.plan.environment else None)


def settings_key(settings: Settings) -> dict[str, Any]:
    """Return the settings that variance curves depend on, by name, as a part of the key of a cached file."""
    return {name: value for name, value in asdict(settings).items() if name not in ("sampler", "reuse_pilot", "preset")}


def oracle_path(
    scene: Scene,
    spp: int,
    patch: int,
    settings: Settings | None,
    folder: str | os.PathLike[str] | None,
    weigh: str = "samples",
) -> Path:
    """Return the path of an oracle in the cache; arguments are those of `make_oracle`."""
    key = [__version__, LAYOUT, fingerprint(scene), spp, patch, settings_key(curve_settings(scene, settings))]
    return cache_path(scene, "oracle" if weigh == "samples" else "tilt-oracle", key, folder).with_suffix(".npz")
