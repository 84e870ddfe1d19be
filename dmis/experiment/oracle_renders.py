"""Renders of an oracle: its curves, and what a camera sample costs in each patch.

The curves V(w) are those of `dmis.variance.curves`, from a pilot of thousands of samples per pixel with its own random
numbers, cached on disk like references.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dmis import __version__
from dmis.base.atomic_files import check_writable, replacing
from dmis.base.patches import patch_mean
from dmis.base.validate import whole
from dmis.base.vectors import Array
from dmis.estimator.cost import RAY, camera_sample_cost
from dmis.estimator.mis import technique_by_name
from dmis.estimator.records import Record, Statistic
from dmis.estimator.settings import DEFAULTS, PRESETS, Settings, make_settings
from dmis.experiment.oracle import Oracle
from dmis.experiment.reference import REFERENCE_SEED, cache_path, from_cache, render_halves
from dmis.fit.round import Fit
from dmis.fit.second_moment import SecondMoment
from dmis.intersect import UNTRACED
from dmis.pipeline.executor import Parallel
from dmis.pipeline.fingerprint import fingerprint, sampling_hashes
from dmis.pipeline.progress import Progress
from dmis.pipeline.render import render
from dmis.scene.scene import Scene
from dmis.variance.curves import GRID_SHARES, HALF, Curves
from dmis.variance.moments import Film

LAYOUT = 3
"""Number of the layout of an oracle's file; a new one makes files of the old layout not be read."""
_CURVE_PARTS = ("curve", "pattern", "position")
"""Parts of the variance curves that an oracle's file has, see `dmis.variance.curves.Curves.sums`."""
EPSILON = 0.01
"""Bound of the denominator of relative errors, as of `dmis.experiment.metrics.relmse`."""
_SPP = 128
"""Camera samples per pixel from which rays are counted and errors are compared."""


def make_oracle(
    scene: Scene,
    spp: int = 2048,
    patch: int = 4,
    *,
    settings: Settings | None = None,
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
    settings, folder, parallel, progress, options
        See `dmis.experiment.reference.make_reference`. The curves of skies depend on `compensation`, whose default is
        that of rules that learn; give 0 to judge ``thesis``, or to predict the error of ``balance``.
    """
    spp, patch = whole("spp", spp, 1), whole("patch", patch, 1)
    if spp < 8 or spp % 4:
        raise ValueError(f"spp of an oracle must be a multiple of 4, and at least 8: two halves of pairs; got {spp}")
    settings = make_settings(settings, **options)
    about = {"dmis": __version__, "layout": LAYOUT, "scene": fingerprint(scene), "spp": spp, "patch": patch}
    used = asdict(curve_settings(scene, settings)).items()
    values = {name: value for name, value in used if name not in ("sampler", "reuse_pilot", "preset")}
    path = cache_path(scene, "oracle", {**about, **values, **sampling_hashes(values)}, folder, ".npz")
    if not scene.plan.mixable:
        raise ValueError(f"an oracle needs a light of two techniques, but scene {scene.name!r} has nothing to mix")
    curves = from_cache(path, read_curves, "oracle")
    if curves is None:
        path.parent.mkdir(parents=True, exist_ok=True)
        check_writable(path)
        rule = _CurveMaps(patch=patch, spp=spp // 2, filter="none")
        more = {"settings": settings, "parallel": parallel, "progress": progress}
        with render_halves(path, scene, rule, spp // 2 + 1, REFERENCE_SEED + 2, **more) as halves:
            rays: Counter[str] = sum((Counter(half.provenance["pilot_rays"]) for half in halves), Counter())
            maps = {name: np.stack([half.maps[name] for half in halves]).astype(np.float32) for name in _CURVE_PARTS}
            with replacing(path) as partial, open(partial, "wb") as archive:
                np.savez(archive, allow_pickle=False, rays=np.array(json.dumps(rays)), **maps)
        curves = read_curves(path)
    counted, parts = curves
    # V(w) = curve + Var_y(I)
    variance = parts["curve"].mean(axis=0) + np.maximum(parts["position"].mean(axis=0), 0)
    if not variance.any():
        raise ValueError(f"an oracle needs noise; every sample of scene {scene.name!r} is the same")
    s = settings.shading_samples
    cost = camera_sample_cost(counted, GRID_SHARES, 2 * s, s, settings.techniques)
    return Oracle(variance, cost, patch, spp, scene.camera.resolution[::-1])


def read_curves(path: Path) -> tuple[dict[str, int], dict[str, Array]]:
    """Return the rays of a file of the cache, and the parts of the curves of both halves ``(2, ...)``."""
    with open(path, "rb") as file, np.load(file, allow_pickle=False) as arrays:
        return json.loads(str(arrays["rays"])), {name: arrays[name].astype(np.float64) for name in _CURVE_PARTS}


@dataclass(frozen=True)
class _CurveMaps(SecondMoment):
    """Rule whose maps are the parts of the variance curves; it mixes both techniques equally."""

    def fit(self, pilot: Mapping[float, Film]) -> Fit:
        """Return equal shares, and the means over patches of the parts of the curves."""
        means, _ = self.pooled(pilot[0.5])
        return Fit(0.5, {name: means[name] for name in _CURVE_PARTS})


def curve_settings(scene: Scene, settings: Settings | None) -> Settings:
    """Return the settings of an oracle's renders: sky compensation as with rules that learn, if the scene has a sky."""
    settings = settings or Settings()
    share = DEFAULTS["compensation"] if settings.compensation is None else settings.compensation
    more = {"preset": None, "compensation": share if scene.plan.environment else None}
    return Settings(**{**(PRESETS[settings.preset].values if settings.preset else {}), **settings.explicit, **more})


def measure_patches(scene: Scene, patch: int, settings: Settings, **options: Any) -> tuple[Array, Array]:
    """Return the cost of a camera sample, and its relative variance over its absolute, ``(G, rows, columns)`` each.

    The cost is that of `dmis.estimator.cost` with the rays of each patch; where nothing can be seen it is 0, because
    nothing is sampled there. Relative variance is that of a pixel over its squared brightness + `EPSILON`. `options`
    are those of `dmis.pipeline.render.render`.
    """
    rule = _PatchMaps(gain=scene.in_float32[1], spp=2 * _SPP, patch=patch, filter="none")
    result = render(scene, rule, 2 * _SPP + 1, settings=settings, sampler="independent", **options)
    shape, s = result.image.shape[:2], settings.shading_samples
    covered = np.ones(shape) if scene.covered_pixels is None else scene.covered_pixels.astype(np.float64)
    rays = dict(result.provenance["pilot_rays"])
    for kind in (UNTRACED, *(technique_by_name(name).rays for name in settings.techniques)):  # these differ by patch
        rays.pop(kind, None)
    always = camera_sample_cost(rays, GRID_SHARES, 2 * s, s, settings.techniques)
    # s of the 2 s shading samples of a camera sample are of one technique; at the shares w_k they are w_k s
    of_rays = RAY * np.einsum("kg,kyx->gyx", GRID_SHARES, result.maps["rays"])
    absolute, relative = (np.maximum(result.maps[name], 0) for name in ("absolute", "relative"))
    little = 1e-4 * max(float(absolute[HALF].mean()), 1e-30)  # where there is no variance, all pixels count the same
    factor = (relative + little * result.maps["weight"]) / (absolute + little)
    return patch_mean(covered, patch) * always[:, None, None] + of_rays, factor


@dataclass(frozen=True)
class _PatchMaps(SecondMoment):
    """Rule whose maps are means over patches of what `_PixelSums` gathers, per camera sample; w is 1/2."""

    gain: float = 1.0

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        return partial(_PixelSums, combiner=self.combiner or Settings.combiner, gain=self.gain)

    def fit(self, pilot: Mapping[float, Film]) -> Fit:
        """Return equal shares, and the maps."""
        return Fit(0.5, self.pooled(pilot[0.5])[0])


class _PixelSums(Curves):
    """Shadow rays of each technique, and variance curves in both measures; radiance times `gain` is the image's."""

    def __init__(self, pixels: int, shading_samples: int, combiner: str, gain: float) -> None:
        super().__init__(pixels, shading_samples, combiner)
        self._rays, self._radiance, self._gain = np.zeros((2, pixels)), np.zeros(pixels), gain

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block of `count` camera samples of every pixel, sample-major."""
        super().add(records, radiance, count)
        pixels = len(self._radiance)
        self._radiance += radiance.mean(axis=0, dtype=np.float64).reshape(count, -1).sum(axis=0) * self._gain
        pixel = np.arange(count * pixels) % pixels
        for record in records:
            # a ray is traced where the surface reflects: there the density of the other technique is not 0
            traced = pixel[slice(None) if record.sample is None else record.sample][record.pdf.min(axis=0) > 0]
            self._rays[record.technique_index] += np.bincount(traced, minlength=pixels)

    def sums(self) -> dict[str, Array]:
        """Return ``rays`` ``(2, P)``, both variances ``(G, P)``, and their ratio ``weight`` ``(P,)``."""
        curves, n = super().sums(), max(self._n, 1)
        # V(w) = curve + Var_y(I);  relMSE: V / (I^2 + epsilon)
        variance, weight = curves["curve"] + curves["position"], 1 / ((self._radiance / n) ** 2 + EPSILON)
        return {"rays": self._rays / n, "absolute": variance, "relative": variance * weight, "weight": weight}
