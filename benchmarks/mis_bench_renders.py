"""Scenes of MIS-Bench, and errors of renders of the shares that a rule learned from pilot tables."""

from __future__ import annotations

import runpy
from dataclasses import replace
from time import process_time

import numpy as np

from dmis.base.vectors import Array
from dmis.bench.data import FULL, PACKAGED, SCENES, SMALL
from dmis.bench.judge import shares_and_samples
from dmis.bench.samples import cost_without_shadow_rays
from dmis.estimator.cost import RAY, count_camera_samples
from dmis.estimator.settings import Settings
from dmis.fit.fixed import Given
from dmis.fit.round import Round
from dmis.formats.load_scene import load_scene
from dmis.formats.shipped import SCENE_FOLDER
from dmis.intersect import UNTRACED
from dmis.pipeline.render import render
from dmis.scene.scene import Scene

SE, SECONDS, FIRST_SEED = 0.025, 12.0, 10_000
"""Relative standard error at which a measurement ends, CPU seconds at which it ends anyway, and its first seed, which
neither pilots nor curves have used."""
SIZES = {SMALL: (24, 18), "ten-lights": (60, 45), "veach-mis": (72, 54)}
"""Resolutions of scenes that differ from the others."""
BOUND = 0.01
"""Bound of the denominator of relative errors, as that of `dmis.experiment.metrics.relmse`."""


def load(name: str) -> tuple[Scene, Settings]:
    """Return a scene of the benchmark and its settings: independent points, no compensation of skies.

    Those of `FULL` have the whole image that their blocks are cut from. A ValueError if it is not one of `SCENES`,
    `FULL` and `PACKAGED`: of other data, the scene is not known.
    """
    if name not in (*SCENES, *FULL, *PACKAGED):
        raise ValueError(
            f"only scenes that come with dmis can be rendered, {', '.join((*SCENES, *FULL, *PACKAGED))}; got {name!r}"
        )
    settings = Settings(sampler="independent", compensation=0)
    full_name = "teapot-area-light" if name == SMALL else name.removeprefix("small-").removeprefix("full-")
    resolution = None if name in FULL else (48, 36) if name in PACKAGED else (100, 75)
    resolution = SIZES.get(name, resolution)
    if full_name == "many-lights":
        make = runpy.run_path(str(SCENE_FOLDER / "make_many_lights.py"))["many_lights"]
        return make() if resolution is None else make(resolution=resolution), settings
    file = "cornell" if full_name == "cornell-path" else full_name
    return load_scene(file, resolution), replace(settings, integrator="path" if "path" in name else "auto")


def measure(scene: Scene, settings: Settings, final: Round, seconds: float, spp: int = 32) -> tuple[Array, Array]:
    """Return error times counted cost of renders of a map, absolute and relative, and its relative standard error.

    Errors are variances over seeds, of the mean of the channels, so that no reference is needed: at least 8 seeds, and
    more until both standard errors are at most `SE`, or as many as take these CPU seconds.
    """
    shares, n = shares_and_samples(final)
    shape = scene.camera.resolution[::-1]
    weigh = "samples" if final.tilt is None else "heuristic"
    rule = Given(np.broadcast_to(shares, shape), n if isinstance(n, np.ndarray) else None, weigh)
    settings, costs = replace(settings, combiner=final.settings.combiner), []
    images: list[Array] = []
    begin, values, error = process_time(), np.zeros(2), np.ones(2)
    while len(images) < 8 or ((error > SE).any() and process_time() - begin < seconds):
        result = render(scene, rule, spp, seed=FIRST_SEED + len(images), parallel=1, settings=settings)
        images.append(result.image.mean(axis=2))
        rays = {**result.rays, UNTRACED: round(float(result.samples.sum())) - result.rays["camera"]}
        traced = sum(rays.get(kind, 0) for kind in ("shadow", "brdf")) / count_camera_samples(rays)
        costs.append(spp * (cost_without_shadow_rays(rays, settings.shading_samples) + RAY * traced))
        if len(images) % 8 == 0:
            grey = np.stack(images)
            mean = grey.mean(axis=0)
            squares = np.square(grey - mean) * (len(grey) / (len(grey) - 1))
            by_seed = np.stack([(squares * weight).mean(axis=(1, 2)) for weight in (1, 1 / (mean**2 + BOUND))])
            values = by_seed.mean(axis=1) * np.mean(costs)
            error = by_seed.std(axis=1) / np.sqrt(len(images)) / by_seed.mean(axis=1)
    return values, error


def fmt(values: Array) -> str:
    """Return the text of an absolute and a relative value."""
    return " ".join(f"{value:#.4g}" for value in values)
