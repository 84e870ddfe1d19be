"""Measure CPU time per light sample with 10 to 98,000 lamps or triangles, and errors with 1,000 lamps.

A light sample takes the difference of two renders' CPU time, with 12 and with 4 light samples of each camera sample,
over the number of samples: selection, sampling, shading, shadow ray. Errors are variances of 8 seeds, relative to
I^2 + .01 (mean I)^2; seeds of lamps other than 0 are for choosing constants.

With numbers of lamps it compares a tree with samples of each lamp, at equal CPU time.

Run: python benchmarks/many_lights.py [SEED [COUNT ...]]        (two minutes)
"""

from __future__ import annotations

import runpy
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import dmis
from dmis.geometry.shapes import grid

SCENES = runpy.run_path(str(Path(__file__).parent.parent / "scenes" / "make_many_lights.py"))
RESOLUTION, SPP, SEEDS = (96, 60), 32, 8


def timed(scene: dmis.Scene, rule: str, spp: int = SPP, **options: Any) -> tuple[np.ndarray, float]:
    """Return the image of a render in this thread, and its CPU seconds."""
    begin = time.process_time()
    image = dmis.render(scene, rule, spp, parallel=1, **options).image
    return image, time.process_time() - begin


def time_per_sample(scene: dmis.Scene, lights: str) -> float:
    """Return nanoseconds per light sample, the least of five."""
    times = {
        s: [timed(scene, "fixed:1", lights=lights, shading_samples=s, seed=k)[1] for k in range(5)] for s in (12, 4)
    }
    return 1e9 * (min(times[12]) - min(times[4])) / (8 * SPP * np.prod(RESOLUTION))


def divided(scene: dmis.Scene, cells: int = 7) -> dmis.Scene:
    """Return the scene with lamps of ``2 * cells**2`` triangles each, where they were parallelograms."""
    lights = {}
    for lamp in scene.lights:
        assert isinstance(lamp, dmis.QuadLight)
        corner, edges = np.array(lamp.corner), np.array([lamp.edge_u, lamp.edge_v])
        lines = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, cells + 1)], indexing="ij"), axis=-1)
        mesh = grid(corner + lines @ edges, None, lines)
        lights[id(lamp)] = dmis.MeshLight(mesh.vertices, mesh.faces, lamp.radiance)
    lamps = [dmis.light_part(light) for light in lights.values()]
    parts = (*(part for part in scene.parts if part.light is None), *lamps)
    return replace(scene, parts=parts, lights=tuple(lights.values()))


def errors(scene: dmis.Scene, rule: str, lights: str, spp: int = SPP) -> np.ndarray:
    """Return relMSE, MSE and CPU seconds of a render."""
    images, seconds = zip(*(timed(scene, rule, spp, lights=lights, seed=k) for k in range(SEEDS)), strict=True)
    mean, variance = np.mean(images, axis=0), np.var(images, axis=0, ddof=1)
    relative = variance / (mean**2 + 0.01 * mean.mean() ** 2)
    return np.array([relative.mean(), variance.mean(), np.median(seconds)])


def compare_with_all(seed: int, count: int, rule: str) -> None:
    """Print errors of a tree over those of samples of each lamp, by as many camera samples as take as long."""
    scene = SCENES["many_lights"](seed, count, RESOLUTION)
    each, spp = errors(scene, rule, "all", 8), 8
    timed(scene, rule, spp, lights="tree")
    while 1.4 * timed(scene, rule, spp, lights="tree")[1] < each[2]:
        spp *= 2
    tree = errors(scene, rule, "tree", spp)
    relative, absolute = (tree * tree[2] / each / each[2])[:2]
    print(f"{count} lamps, {rule}: tree / all, relMSE x s {relative:.2f}, MSE x s {absolute:.2f}", flush=True)


def main(seed: int = 1, *counts: int) -> None:
    for count in counts:
        for rule in ("balance", "auto"):
            compare_with_all(seed, count, rule)
    if counts:
        return
    for lights, count in (("even", 10), ("tree", 10), ("tree", 100), ("tree", 1000), ("tree", 98_000)):
        scene = SCENES["many_lights"](seed, min(count, 1000), RESOLUTION)
        if count > 1000:
            scene = divided(scene)
        timed(scene, "fixed:1", lights=lights)
        print(
            f"{count:>7,} lamps or triangles, {lights}: {time_per_sample(scene, lights):.0f} ns per light sample",
            flush=True,
        )
    scene = SCENES["many_lights"](seed, 1000, RESOLUTION)
    for rule in ("balance", "auto"):
        for lights in ("even", "power", "tree"):
            relative, absolute, cost = errors(scene, rule, lights)
            print(f"{rule}, {lights}: relMSE x s {relative * cost:.4g}, MSE x s {absolute * cost:.4g}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
