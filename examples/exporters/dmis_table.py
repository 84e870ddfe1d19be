"""Write the doctor's table of a scene that dmis renders: ``python dmis_table.py teapot-area-light table.npz``.

Direct light with independent points: one light sample and one BRDF sample of each light and camera sample. The columns
are those of docs/doctor.md.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

import dmis
from dmis.base.vectors import TINY, take
from dmis.estimator.settings import make_settings
from dmis.fit.fixed import Fixed
from dmis.intersect import Intersector
from dmis.pipeline.job import budget_of, resolve
from dmis.pipeline.tile import make_tiles, render_tile

COLUMNS = (
    "pixel camera_sample technique light lobe f p_l p_b direction normal geometric_normal distance light_normal"
).split()


class Recorder:
    """Statistic that keeps the shading samples of one tile after the other as rows of `COLUMNS`."""

    wants = dmis.Wants(directions=True)

    def __init__(self, lights: Any) -> None:
        self.rows: list[tuple[np.ndarray, ...]] = []
        self.meshes = [None if light.mesh() is None else light.mesh() for light in lights]
        self.casters = [mesh and Intersector(mesh.vertices, mesh.faces) for mesh in self.meshes]

    def begin(self, pixels: np.ndarray) -> None:
        """Begin a tile of some pixels ``(P,)``."""
        self.pixels, self.done = pixels, 0

    def add(self, records: Any, radiance: np.ndarray, count: int) -> None:
        """Add one batch, see `dmis.estimator.records.Statistic`."""
        for record in records:
            p_l, p_b = record.pdf
            f = record.value * (p_l + p_b) / 2  # the value is f / (p_l / 2 + p_b / 2)
            kept = np.flatnonzero(((p_l > 0) & (p_b > 0)) | (f > 0).any(axis=0))
            sample = take(np.arange(radiance.shape[1]), record.sample)[kept]
            surface, light = record.surface.take(kept), record.key[-1] % len(self.meshes)
            p, wi = record.p[:, kept], record.wi[:, kept]
            self.rows.append((
                self.pixels[sample % len(self.pixels)],
                self.done + sample // len(self.pixels),
                np.full(len(kept), record.technique_index, np.int8),
                np.full(len(kept), light, np.int16),
                np.full(len(kept), len(surface.reflection), np.int16),
                f[:, kept].T,
                p_l[kept],
                p_b[kept],
                *(np.broadcast_to(a, p.shape).T for a in (wi, surface.n, surface.ng)),
                *self.geometry_of_light(light, p, wi),
            ))  # fmt: skip
        self.done += count

    def geometry_of_light(self, light: int, p: np.ndarray, wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return distances ``(N,)`` and normals ``(N, 3)`` where directions meet a light; infinite ones of a sky."""
        mesh = self.meshes[light]
        if mesh is None or not p.size:
            return np.full(p.shape[1], np.inf, np.float32), -wi.T
        hits = self.casters[light].closest(np.ascontiguousarray(p), np.ascontiguousarray(wi))
        corners = mesh.vertices[mesh.faces[np.maximum(hits.prim, 0)]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), TINY)
        return hits.distance, normal.astype(np.float32)

    def sums(self) -> dict[str, np.ndarray]:
        """Return nothing: the samples are kept."""
        return {}


def table(scene: dmis.Scene, spp: int = 16, seed: int = 0) -> dict[str, Any]:
    """Return the columns of the table by name."""
    job = resolve(scene, Fixed(0.5), spp, seed, make_settings(None, sampler="independent", compensation=0))
    width, height = job.scene.camera.resolution
    recorder = Recorder(job.scene.plan.sampled_lights(job.settings.lights, 0))
    for tile in make_tiles((width, height), seed, 0, next(job.rule.rounds(budget_of(job)))):
        y, x = np.mgrid[tile.area].reshape(2, -1)
        recorder.begin(y * width + x)
        render_tile(job.scene, replace(tile, round=replace(tile.round, statistic=lambda *_: recorder)))
    columns = dict(zip(COLUMNS, map(np.concatenate, zip(*recorder.rows, strict=True)), strict=True))
    columns["f"] *= np.float32(job.gain)
    return columns | {"version": 1, "light_samples": 1, "brdf_samples": 1, "shape": (height, width)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("output")
    parser.add_argument("--spp", type=int, default=16)
    options = parser.parse_args()
    np.savez(options.output, **table(dmis.load_scene(options.scene), options.spp))
