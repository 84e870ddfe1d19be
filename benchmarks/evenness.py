"""Evenness of a scene's points: how much smaller than that of independent points their error is, and how it falls."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dmis import __version__
from dmis.base.atomic_files import check_writable, replacing
from dmis.estimator.settings import Settings
from dmis.experiment.oracle import Oracle
from dmis.experiment.oracle_renders import curve_settings, settings_key
from dmis.experiment.reference import REFERENCE_SEED, cache_path, from_cache
from dmis.pipeline.executor import Parallel
from dmis.pipeline.fingerprint import fingerprint
from dmis.pipeline.progress import Progress
from dmis.pipeline.render import render
from dmis.scene.scene import Scene
from dmis.variance.curves import HALF

EVEN_SPP, EVEN_RATIO, EVEN_SEEDS = 128, 4, 8
"""Camera samples per pixel at which `Evenness` is measured, what these are divided by for its slope, and renders of
each.
"""


@dataclass(frozen=True)
class Evenness:
    """Error of the balance heuristic with Sobol points over that with independent ones, as a power of the samples.

    Attributes
    ----------
    spp
        Camera samples per pixel at which `ratio` was measured.
    ratio
        Mean squared error with Sobol points over that with independent points.
    exponent
        a, where the error with Sobol points falls as n^-a: 1 for independent points, 3/2 for edges in the pixel.
    """

    spp: int
    ratio: float
    exponent: float


def measure_evenness(
    scene: Scene,
    oracle: Oracle,
    spp: int = EVEN_SPP,
    seeds: int = EVEN_SEEDS,
    *,
    settings: Settings | None = None,
    folder: str | os.PathLike[str] | None = None,
    parallel: Parallel = None,
    progress: Progress | bool | None = None,
) -> Evenness:
    """Return the evenness of a scene's Sobol points: measured at the first call, read from the cache afterwards.

    The error at `spp` and at a quarter of it is the variance over renders with different random numbers, of the mean of
    the channels, over all pixels. That with independent points is the oracle's.

    Parameters
    ----------
    spp, seeds
        Camera samples per pixel, a multiple of 4, and the number of renders at each of both numbers.
    settings, folder, parallel, progress
        See `dmis.experiment.oracle_renders.make_oracle`.
    """
    settings = curve_settings(scene, settings)
    key = {"dmis": __version__, "scene": fingerprint(scene), "spp": spp, "seeds": seeds, **settings_key(settings)}
    path = cache_path(scene, "evenness", key, folder, ".json")
    errors = from_cache(path, _read_errors, "evenness")
    if errors is None:
        path.parent.mkdir(parents=True, exist_ok=True)
        check_writable(path)
        settings = replace(settings, sampler="sobol")
        errors = []
        for n in (spp // EVEN_RATIO, spp):
            images = [
                render(
                    scene, "balance", n, seed=REFERENCE_SEED + 4 + k, settings=settings, parallel=parallel,
                    progress=progress,
                ).image.mean(axis=2, dtype=np.float64)
                for k in range(seeds)
            ]  # fmt: skip
            errors.append(float(np.var(images, axis=0, ddof=1).mean()))
        with replacing(path) as partial:
            partial.write_text(json.dumps({"errors": errors}))
    fewer, error = errors
    independent = oracle.mean(oracle.variance[HALF]) / spp
    if not (error > 0 and independent > 0):
        raise ValueError("evenness needs an image with noise; got one whose error is 0")
    return Evenness(spp, error / independent, float(np.log(fewer / error) / np.log(EVEN_RATIO)))


def _read_errors(path: Path) -> list[float]:
    """Return the two errors in a file of the cache."""
    return list(json.loads(path.read_text())["errors"])
