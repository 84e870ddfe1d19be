"""A page to paint shares and numbers of samples on an image, which shows the error times time that they would have.

The template ``play.html`` beside this module has its elements, ``play.css`` the style, ``play.js`` the script and
``play_model.js`` the numbers. Nothing is rendered in the page: the curves of an oracle say what a map is worth.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.base.patches import patch_mean
from dmis.base.vectors import Array
from dmis.estimator.settings import Settings
from dmis.experiment.oracle import Oracle, between
from dmis.experiment.oracle_renders import make_oracle, measure_patches
from dmis.experiment.reference import make_reference
from dmis.fit.registry import Thesis
from dmis.image import tonemap
from dmis.pipeline.render import render
from dmis.report.comparer import png
from dmis.report.templates import filled
from dmis.scene.scene import Scene
from dmis.variance.curves import GRID

MOST_SAMPLES = 16
"""Largest number of samples of a patch in `best_with_samples`, over the mean; its inverse is the smallest."""


def play_page(scene: Scene, spp: int, patch: int, settings: Settings, **options: Any) -> str:
    """Return the page of a scene, HTML that needs no network. Its oracle and its image are kept in the cache.

    Light samples of skies have no compensation unless `settings` say so, so that w = 1/2 is the rule ``balance``. `spp`
    and `patch` are those of `dmis.experiment.oracle_renders.make_oracle`, `options` of `dmis.pipeline.render.render`.

    Raises
    ------
    ValueError
        If an argument is out of range, or the scene has nothing to mix or no noise.
    """
    options["settings"] = settings = replace(settings, preset=None, compensation=settings.compensation or 0)
    oracle = make_oracle(scene, spp, patch, **options)
    image = make_reference(scene, 64, **options).mean
    cost, factor = measure_patches(scene, patch, **options)
    # the pilot alone decides the map: 6 samples, and one of the final pass
    thesis = render(scene, Thesis(weigh="samples"), 7, **options).weight
    absolute = Oracle(oracle.variance, cost, patch, spp, thesis.shape)
    measures = {"relative": replace(absolute, variance=oracle.variance * factor), "absolute": absolute}
    return page_of(measures, image, thesis, scene.name, spp)


def page_of(measures: Mapping[str, Oracle], image: Array, thesis: Array, scene: str, spp: int) -> str:
    """Return the page of curves of ``relative`` and ``absolute`` errors.

    `image` is linear RGB ``(H, W, 3)``, and `thesis` the share map of the thesis's rule, ``(H, W)``.
    """
    maps = {}
    curves = measures["absolute"]
    even, w = np.ones_like(curves.pixel_share), patch_mean(thesis, curves.patch)
    for name, judge in measures.items():
        named = {
            "thesis": (w, even),
            "oracle": (best_even(judge), even),
            "oracle + samples": best_with_samples(judge),
        }
        maps[name] = {label: list(map(_text, pair)) for label, pair in named.items()}
    data = {
        "shape": [*image.shape[:2], *even.shape],
        "patch": curves.patch,
        "most": MOST_SAMPLES,
        "image": png(np.round(255 * tonemap(image.astype(np.float32))).astype(np.uint8)),
        "grid": [round(float(w), 6) for w in GRID],
        "curves": {"cost": _text(curves.cost)} | {name: _text(judge.variance) for name, judge in measures.items()},
        "maps": maps,
    }
    return filled("play.html", title=f"Beat the oracle: {scene}", scene=scene, spp=spp, data=data)


def best_even(curves: Oracle) -> Array:
    """Return the best shares per patch, ``(rows, columns)``, with even samples.

    They are those of `GRID` without its ends: where one technique alone misses a light, its variance is in samples too
    rare to be seen, and the best share by some samples may be the worst by others.
    """
    inner = replace(curves, variance=curves.variance[1:-1], cost=curves.cost[1:-1])
    return GRID[1:-1][inner.best_index(costly=True)]


def best_with_samples(curves: Oracle) -> tuple[Array, Array]:
    """Return the best shares and numbers of samples per patch, ``(rows, columns)`` each, the numbers of mean 1."""
    # n ~ sqrt(V / C),  w = argmin V C   (docs/theory.md, Eq. 20)
    w = GRID[1:-1][(np.maximum(curves.variance, 0) * curves.costs)[1:-1].argmin(axis=0)]
    v, c = np.maximum(between(curves.variance, w), 0), between(curves.costs, w)
    n = np.sqrt(np.divide(v, c, out=np.zeros_like(v), where=c > 0))
    return w, np.clip(n / max(curves.mean(n), 1e-30), 1 / MOST_SAMPLES, MOST_SAMPLES)


def _text(values: Array) -> str:
    """Return an array as base64 of little-endian float32."""
    return base64.b64encode(np.asarray(values, "<f4").tobytes()).decode("ascii")
