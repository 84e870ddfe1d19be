"""Shading samples as a table of NumPy arrays: what weight rules learn from, without the renderer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from dmis.base.vectors import TINY, Array, take
from dmis.estimator.cost import CAMERA, RAY, count_camera_samples, surface_points
from dmis.estimator.mis import SHADING
from dmis.estimator.records import Record
from dmis.estimator.settings import Settings, make_settings
from dmis.fit.fixed import Fixed
from dmis.pipeline.job import budget_of, resolve
from dmis.pipeline.tile import make_tiles, render_tile
from dmis.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class SampleTable:
    """R rows: the shading samples of camera samples, and a row of each camera sample itself, technique -1.

    The radiance of a camera sample is the sum over its rows of ``f / (w p_l + (1 - w) p_b) / S``. The row of technique
    -1 has what no technique estimates, such as emission that the camera sees, and ``p_l = p_b = 1 / S``. Shading
    samples without a row have f = 0, and the other technique could not draw them.

    Attributes
    ----------
    pixel, camera_sample
        Number of the pixel in row order, and of the camera sample in its pixel, ``(R,)``.
    w
        Share of light samples, the same in all rows, ``(R,)``.
    technique, sample_index
        0 light sampling, 1 BRDF sampling; which of the camera sample's samples of it this is, ``(R,)``.
    light
        Number of the light, and on paths of the vertex, whose integral the sample estimates, ``(R,)``.
    f
        Integrand in linear RGB with the throughput of its path, ``(R, 3)``; 0 where the light is occluded.
    p_l, p_b
        Densities of both techniques in the sample's direction, per solid angle, ``(R,)``.
    cost
        Cost of the shadow ray, if one is traced; of technique -1, of the rest (`dmis.estimator.cost`), ``(R,)``.
    shape
        ``(H, W)`` of the image.
    spp, shading_samples
        Camera samples per pixel, and S.
    rays
        Rays traced by kind.
    """

    pixel: np.ndarray
    camera_sample: np.ndarray
    w: Array
    technique: np.ndarray
    sample_index: np.ndarray
    light: np.ndarray
    f: Array
    p_l: Array
    p_b: Array
    cost: Array
    shape: tuple[int, int]
    spp: int
    shading_samples: int
    rays: Mapping[str, int]

    def rows(self, index: np.ndarray) -> SampleTable:
        """Return some rows, by their numbers or a mask."""
        return replace(self, **{name: getattr(self, name)[index] for name in COLUMNS})

    def estimates(self, tilt: float | None = None) -> Array:
        """Return what each row estimates alone, ``f / p_w``; of a heuristic with a `tilt` in place of w, ``(R, 3)``."""
        # (t_k / w_k) f / (t p_l + (1 - t) p_b)   (docs/theory.md, Eq. 8a)
        w = float(self.w[0])
        t = w if tilt is None else tilt
        ratio = np.array([1, t / max(w, 1e-9), (1 - t) / max(1 - w, 1e-9)])
        p = np.maximum(t * self.p_l + (1 - t) * self.p_b, TINY)
        return np.asarray(self.f * (ratio[self.technique + 1] / p)[:, None])

    def radiance(self, tilt: float | None = None) -> Array:
        """Return the radiance of the camera samples, ``(spp, H, W, 3)``; 0 for pixels without rows."""
        size = self.spp * int(np.prod(self.shape))
        sums = [np.bincount(self.place(), channel, size) for channel in self.estimates(tilt).T]
        return np.stack(sums, axis=-1).reshape(self.spp, *self.shape, 3) / self.shading_samples

    def place(self) -> np.ndarray:
        """Return the number of each row's camera sample in the image, first samples of all pixels first, ``(R,)``."""
        return self.camera_sample.astype(np.int64) * int(np.prod(self.shape)) + self.pixel


COLUMNS = tuple(field.name for field in fields(SampleTable))[:10]
"""Names of the columns of a `SampleTable`."""


def samples(
    scene: Scene,
    pixels: Sequence[int] | np.ndarray | None = None,
    *,
    spp: int = 16,
    weight: float = 0.5,
    seed: int = 0,
    settings: Settings | None = None,
    **options: Any,
) -> SampleTable:
    """Return the shading samples of pixels that ``render(scene, f"fixed:{weight}", spp, seed=seed)`` draws.

    Parameters
    ----------
    pixels
        Numbers of pixels in row order, ``row * width + column``, ``(P,)``; None: all. A pixel has the same samples in
        any choice. A tuple is refused, because it looks like a column and a row.
    weight
        Share w of light samples.
    spp, seed, settings, options
        See `dmis.pipeline.render.render`.
    """
    job = resolve(scene, Fixed(weight), spp, seed, make_settings(settings, **options))
    height, width = shape = job.given_scene.camera.resolution[::-1]
    chosen = _pixel_numbers(pixels, height, width)
    left, top, _, _ = job.window or (0, 0, width, height)
    resolution = job.scene.camera.resolution  # of a window, that of the whole image
    recorder, rays = _Recorder(weight, job.settings.shading_samples), Counter[str]()
    for tile in make_tiles(resolution, seed, 0, next(job.rule.rounds(budget_of(job)))):
        row, column = np.mgrid[tile.area] - np.reshape((top, left), (2, 1, 1))
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        recorder.begin(np.where(inside, row * width + column, -1).reshape(-1))
        if np.isin(recorder.pixels, chosen).any():
            observed = replace(tile, round=replace(tile.round, statistic=lambda *_: recorder))
            rays.update(render_tile(job.scene, observed).rays)
    columns = dict(zip(COLUMNS, map(np.concatenate, zip(*recorder.rows, strict=True)), strict=True))
    columns["f"] *= np.float32(job.gain)
    s = job.settings.shading_samples
    columns["cost"][columns["technique"] < 0] = cost_without_shadow_rays(rays, s)
    table = SampleTable(**columns, shape=shape, spp=spp, shading_samples=s, rays=rays)
    return table.rows(np.isin(table.pixel, chosen))


def cost_without_shadow_rays(rays: Mapping[str, int], shading_samples: int) -> float:
    """Return the cost of a camera sample, delta lights included, without the rays of its shading samples."""
    of_deltas = (SHADING + RAY) * rays.get("delta", 0) / count_camera_samples(rays)
    return surface_points(rays) * (CAMERA + SHADING * shading_samples) + of_deltas


def _pixel_numbers(pixels: Any, height: int, width: int) -> np.ndarray:
    """Return the numbers of the pixels that `samples` is given, ``(P,)``; a ValueError for others."""
    chosen = np.arange(height * width) if pixels is None else np.asarray(pixels)
    whole = chosen.ndim == 1 and chosen.dtype.kind in "iu" and not isinstance(pixels, tuple)
    if not whole or not chosen.size or chosen.min() < 0 or chosen.max() >= height * width:
        raise ValueError(
            f"pixels must be whole numbers from 0 to {height * width - 1}, row * width + column, in a list or an array "
            f"of one dimension; got {pixels!r}"
        )
    return chosen


class _Recorder:
    """Statistic that keeps the shading samples of one tile after the other, as `rows` of `COLUMNS`."""

    def __init__(self, w: float, shading_samples: int) -> None:
        self._w, self._s = w, shading_samples
        self._lights: dict[tuple[int, ...], int] = {}
        self.rows: list[tuple[Array, ...]] = []

    def begin(self, pixels: np.ndarray) -> None:
        """Begin a tile of some pixels ``(P,)``."""
        self.pixels, self._n = pixels, 0

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """See `dmis.estimator.records.Statistic.add`."""
        every, rest = np.arange(radiance.shape[1]), radiance.astype(np.float64)
        for record in records:
            sample, (p_l, p_b) = take(every, record.sample), record.pdf
            rest[:, sample] -= record.value / np.float64(self._s)
            f = record.value * np.float32(self._w * p_l + (1 - self._w) * p_b)
            # a direction that both techniques may draw is reflected, so that its ray is traced
            kept = ((p_l > 0) & (p_b > 0)) | (f > 0).any(axis=0)
            light = self._lights.setdefault(record.key, len(self._lights))
            labels = record.technique_index, record.sample_index, light
            self._append(sample[kept], labels, f[:, kept], p_l[kept], p_b[kept], RAY)
        rest[np.abs(rest) < 1e-6 * radiance] = 0  # rounding errors
        self._append(every, (-1, 0, 0), rest, 1 / self._s, 1 / self._s, 0)
        self._n += count

    def _append(self, sample: np.ndarray, labels: tuple[int, ...], f: Array, *values: Array | float) -> None:
        """Add rows of camera samples; `values` are p_l, p_b and cost."""
        n, pixels = len(sample), len(self.pixels)
        w, *others = (np.broadcast_to(np.float32(value), n) for value in (self._w, *values))
        places = self.pixels[sample % pixels], self._n + sample // pixels
        self.rows.append((*places, w, *(np.full(n, k, np.int16) for k in labels), f.T.astype(np.float32), *others))

    def sums(self) -> dict[str, Array]:
        """Return nothing: the samples are kept."""
        return {}
