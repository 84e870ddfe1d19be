"""Figure of docs/results.md: why bounds depend on the resolution."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from common import print_canvas, write_webp
from mis_bench_renders import load
from weight_bounds import ShareTiltMoments, resized, variance

from dmis import plot
from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.settings import Settings
from dmis.fit.fixed import Fixed
from dmis.fit.round import Round, pilot_settings
from dmis.pipeline.job import resolve
from dmis.pipeline.render import render
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.scene import Scene

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
VIEWS, VIEW = {"teapot-area-light": (24, 73), "killeroo-diffuse": (96, 84)}, 25
"""Top left pixels of parts of images at an eighth of their side, row and column, and the side of the parts there."""
SIDE, SPP = 4, 256
"""Pixels of a side of a tile, whose camera samples are one batch, and camera samples per pixel."""


def draw_edges() -> None:
    """Draw which part of the variance no weight changes, of the same views at an eighth of the side and in full."""
    figure, axes = print_canvas(2, 3, 4.2)
    for line, (name, corner) in zip(axes, VIEWS.items(), strict=True):
        scene, settings = load(f"full-{name}")
        window = np.array([corner[1], corner[0], corner[1] + VIEW, corner[0] + VIEW])
        views = [resized(scene, 8).crop(window), scene.crop(8 * window)]
        plot.picture(line[0], render(views[1], "balance", 64, settings=settings).image, name)
        for axis, view, divisor in zip(line[1:], views, (8, 1), strict=True):
            width, height = (n // divisor for n in scene.camera.resolution)
            part = edge_map(view, settings)
            shown = plot.heat(axis, part, f"of {width}×{height} pixels", cmap="magma", vmin=0, vmax=1)
            axis.set_facecolor("0.6")
    figure.colorbar(shown, ax=axes, label="part of V(½) that no weight changes")
    write(figure, "edges-and-resolution")


def edge_map(scene: Scene, settings: Settings, spp: int = SPP) -> Array:
    """Return Var_y(I) over V at w = 1/2 of each pixel, ``(H, W)``; NaN where V is below a thousandth of its mean."""
    job = resolve(scene, Fixed(0.5), spp, 0, settings).alone
    job.scene.prepare()
    width, height = scene.camera.resolution
    result = np.zeros((2, height, width))
    round_ = Round(spp, shares_of(0.5), pilot_settings(job.settings, paired=True))
    for number, (y, x) in enumerate(np.ndindex(-(-height // SIDE), -(-width // SIDE))):
        rows, columns = (slice(a * SIDE, min((a + 1) * SIDE, n)) for a, n in ((y, height), (x, width)))
        statistics: list[ShareTiltMoments] = []

        def keep(pixels: int, s: int, statistics: list[ShareTiltMoments] = statistics) -> ShareTiltMoments:
            statistics.append(ShareTiltMoments(pixels, s, np.array([0.5], np.float32)))
            return statistics[-1]

        render_tile(job.scene, Tile(1, 0, number, (rows, columns), replace(round_, statistic=keep)))
        sums = statistics[0].sums()
        v = variance(sums["terms"], sums["position"], grid=np.array([0.5], np.float32))[0, 0]
        result[:, rows, columns] = np.reshape([sums["position"], v], (2, rows.stop - rows.start, -1))
    part, v = result
    low = v < 1e-3 * v.mean()
    return np.where(low, np.nan, np.clip(part / np.where(low, 1, v), 0, 1))


def write(figure: Any, stem: str) -> None:
    """Write a figure as WebP."""
    picture = IMAGES / f"{stem}.png"
    figure.savefig(picture, dpi=200)
    write_webp(picture, picture.with_suffix(".webp"))
    picture.unlink()
