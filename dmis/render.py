"""Rendering with a rule: pilot, fit, final pass, one image.

The budget `spp` includes the pilot. Pilot and final image are both unbiased, and are averaged with weights fixed
beforehand, their camera samples: so the result is unbiased although the weights were learned. (Weighting by estimated
variance would not be.) Work is cut into tiles (`dmis.tile`) for any `concurrent.futures.Executor`.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmis import __version__
from dmis.estimator import Settings
from dmis.fit import Rule, make_rule
from dmis.samplers import Kind
from dmis.scene import Scene
from dmis.tile import Rendered, Tile, render_tile, split
from dmis.variance import Moments
from dmis.vec import Array

Progress = Callable[[str, int, int], None]
"""``progress(stage, done, total)``, in camera samples; stages are ``pilot`` and ``final``."""
CHECKPOINT_SECONDS = 10.0


@dataclass(frozen=True, eq=False)
class Result:
    """An image and how it came about.

    Attributes
    ----------
    image
        ``(H, W, 3)`` float32 linear RGB, row 0 on top.
    variance
        ``(H, W, 3)`` float32: estimated variance of `image` itself (of the mean, not of one sample); NaN at one
        sample. It takes samples to be independent, so it is too large where systematic rounding or a structured
        sampler spreads them.
    weight
        ``(H, W)`` float32: share of light samples in the final pass.
    samples
        ``(H, W)`` float32: camera samples rendered, pilot included, whether or not it is part of the image.
    seconds
        ``pilot``, ``fit``, ``render`` (the final pass) and their sum ``total``.
    rays
        Rays traced, by kind: ``camera``, ``shadow`` (towards lights), ``brdf``, ``uniform``, ``specular``.
    maps
        Diagnostics of the rule.
    provenance
        What is needed to make the image again; plain JSON data.
    """

    image: Array
    variance: Array
    weight: Array
    samples: Array
    seconds: Mapping[str, float]
    rays: Mapping[str, int]
    maps: Mapping[str, np.ndarray]
    provenance: Mapping[str, Any]
    tiles: tuple[Tile, ...] = field(default=(), repr=False)


def render(
    scene: Scene,
    rule: Rule | str = "thesis",
    spp: int = 128,
    *,
    seed: int = 0,
    sampler: Kind | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> Result:
    """Render `scene`.

    Parameters
    ----------
    rule
        A rule or its text, ``balance``, ``fixed:0.25``, ``thesis:patch=16``; see `dmis.fit.RULES`.
    spp
        Camera samples per pixel, the rule's pilot included.
    seed
        Not negative. The image depends on it, on nothing in the machine.
    sampler
        Shorthand for ``settings.sampler``. The pilot is always independent, because a sample variance assumes it.
    settings
        Estimator settings; a rule's own settings (its combiner, its sampler) replace those.
    threads
        Number of threads if no executor is given; default: one per processor.
    executor
        Where tiles are rendered; any `concurrent.futures.Executor`.
    progress
        Called in this thread after each tile.
    checkpoint
        A file that finished tiles are saved to every few seconds and when interrupted; if it exists, rendering goes
        on from it. It is removed at the end.

    Raises
    ------
    ValueError
        If an argument is out of range, or the checkpoint belongs to a different image.
    """
    rule_text = rule if isinstance(rule, str) else repr(rule)
    rule = make_rule(rule) if isinstance(rule, str) else rule
    given = {} if sampler is None else {"sampler": sampler}
    settings = replace(settings or Settings(), **{**given, **rule.settings})
    pilot_spp = sum(rule.pilot.values())
    _check(spp, pilot_spp, seed, threads, rule_text)
    provenance = {
        "dmis": __version__,
        "scene": scene.name,
        "scene_hash": fingerprint(scene),
        "resolution": list(scene.camera.resolution),
        "rule": rule_text,
        "spp": spp,
        "seed": seed,
        "settings": asdict(settings),
    }
    owned = None
    if executor is None:
        executor = owned = ThreadPoolExecutor(threads or os.cpu_count() or 1)
    store = _Store(checkpoint, provenance)
    work = _Work(scene, seed, settings, executor, progress, store)
    try:
        _ = scene.plan, scene.intersector
        begin = time.perf_counter()
        pilot = {w: work.render(k, "pilot", n, w, "independent") for k, (w, n) in enumerate(sorted(rule.pilot.items()))}
        fitted = time.perf_counter()
        fit = rule.fit(pilot)
        final_begin = time.perf_counter()
        final = work.render(len(pilot), "final", spp - pilot_spp, fit.weight, settings.sampler)
        end = time.perf_counter()
    except BaseException:
        store.save()
        if owned is not None:
            owned.shutdown(wait=False, cancel_futures=True)
        raise
    if owned is not None:
        owned.shutdown()
    image, variance = _combine([*pilot.values(), final] if settings.reuse_pilot else [final])
    store.remove()
    shape = image.shape[:2]
    return Result(
        image=image,
        variance=variance,
        weight=np.broadcast_to(np.asarray(fit.weight, np.float32), shape).copy(),
        samples=np.full(shape, spp, np.float32),
        seconds={
            "pilot": fitted - begin,
            "fit": final_begin - fitted,
            "render": end - final_begin,
            "total": end - begin,
        },
        rays=dict(work.rays),
        maps=fit.maps,
        provenance={**provenance, "rays": dict(work.rays)},
        tiles=tuple(work.tiles),
    )


def _check(spp: int, pilot_spp: int, seed: int, threads: int | None, rule: str) -> None:
    if spp < 1 or spp != int(spp):
        raise ValueError(f"spp must be a whole number of at least 1; got {spp}")
    if spp <= pilot_spp:
        raise ValueError(
            f"spp must be more than the pilot's {pilot_spp} camera samples, because the budget includes the pilot "
            f"of rule {rule}; got {spp}"
        )
    if spp > 2**20:
        raise ValueError(f"spp must be at most 2**20; got {spp}")
    if seed < 0 or seed != int(seed):
        raise ValueError(f"seed must be a whole number that is not negative; got {seed}")
    if threads is not None and threads < 1:
        raise ValueError(f"threads must be at least 1; got {threads}")


def _combine(parts: list[Moments]) -> tuple[Array, Array]:
    """Average images by their sample counts; variance of the average."""
    n = sum(part.n for part in parts)
    image = sum(part.mean * (part.n / n) for part in parts)
    counted = [part for part in parts if part.n > 1]
    variance = np.full(parts[0].mean.shape, np.nan)
    if len(counted) == len(parts):
        variance = sum((part.variance() * (part.n / n**2) for part in parts), np.zeros(parts[0].mean.shape))
    return np.asarray(image, np.float32), variance.astype(np.float32)


def fingerprint(scene: Scene) -> str:
    """A short hash of the description: camera, meshes, materials, lights."""
    lights = [(type(light).__name__, [getattr(light, f.name) for f in fields(light)]) for light in scene.lights]
    materials = [part.material for part in scene.parts]
    camera = scene.camera
    digest = hashlib.sha256(
        pickle.dumps((camera.fov, camera.resolution, camera.corner, camera.frame, lights, materials))
    )
    digest.update(np.asarray(camera.to_world, np.float64).tobytes())
    for part in scene.parts:
        digest.update(np.asarray(part.mesh.vertices, np.float32).tobytes())
        digest.update(np.asarray(part.mesh.faces, np.int32).tobytes())
    return digest.hexdigest()[:16]


class _Work:
    """Passes over the image, tile by tile."""

    def __init__(
        self,
        scene: Scene,
        seed: int,
        settings: Settings,
        executor: Executor,
        progress: Progress | None,
        store: _Store,
    ) -> None:
        self._scene, self._seed, self._settings = scene, seed, settings
        self._executor, self._progress, self._store = executor, progress, store
        self.rays: Counter[str] = Counter()
        self.tiles: list[Tile] = []

    def render(self, pass_: int, stage: str, spp: int, w: Array | float, sampler: Kind) -> Moments:
        """One pass: `spp` camera samples at weight `w`, one number or ``(H, W)``."""
        width, height = self._scene.camera.resolution
        tiles = []
        for number, (rows, columns) in enumerate(split((width, height), spp)):
            local = w if np.ndim(w) == 0 else np.asarray(w)[slice(*rows), slice(*columns)].reshape(-1)
            tiles.append(Tile(self._seed, pass_, number, rows, columns, spp, local, sampler, self._settings))
        self.tiles.extend(tiles)
        mean, m2, done = self._store.start(pass_, (height, width, 3), len(tiles), self.rays)
        waiting: dict[Future[Rendered], Tile] = {}
        total, finished = height * width * spp, 0
        for tile in tiles:
            if done[tile.number]:
                finished += _area(tile) * spp
            else:
                waiting[self._executor.submit(render_tile, self._scene, tile)] = tile
        try:
            for future in as_completed(list(waiting)):
                tile, rendered = waiting.pop(future), future.result()
                area = slice(*tile.rows), slice(*tile.columns)
                mean[area], m2[area] = rendered.moments.mean, rendered.moments.m2
                done[tile.number] = True
                self.rays.update(rendered.rays)
                finished += _area(tile) * spp
                self._store.tick(self.rays)
                if self._progress:
                    self._progress(stage, finished, total)
        except BaseException:
            for future in waiting:
                future.cancel()
            raise
        return Moments(spp, mean, m2)


def _area(tile: Tile) -> int:
    return (tile.rows[1] - tile.rows[0]) * (tile.columns[1] - tile.columns[0])


class _Store:
    """Finished tiles of all passes, kept in a file from time to time."""

    def __init__(self, path: str | os.PathLike[str] | None, provenance: Mapping[str, Any]) -> None:
        self._path = None if path is None else Path(path)
        self._key = json.dumps(provenance, sort_keys=True)
        self._passes: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._rays: Counter[str] = Counter()
        self._saved = time.monotonic()
        self._loaded: dict[str, np.ndarray] = {}
        if self._path is None or not self._path.exists():
            return
        try:
            with np.load(self._path, allow_pickle=False) as file:
                self._loaded = dict(file)
            key = str(self._loaded["key"])
        except Exception as error:
            raise ValueError(f"checkpoint {self._path} is not readable as one: {error}") from error
        if key != self._key:
            raise ValueError(
                f"checkpoint {self._path} belongs to a different image; remove it, or use the same arguments. "
                f"It holds {key}; asked for is {self._key}"
            )

    def start(
        self, pass_: int, shape: tuple[int, int, int], tiles: int, rays: Counter[str]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Arrays of a pass: mean, sum of squared deviations, and which tiles are done; from the file if it has them."""
        if not self._passes and "rays" in self._loaded:
            rays.update(json.loads(str(self._loaded["rays"])))
        if f"mean{pass_}" in self._loaded:
            arrays = tuple(self._loaded.pop(f"{name}{pass_}") for name in ("mean", "m2", "done"))
        else:
            arrays = (np.zeros(shape), np.zeros(shape), np.zeros(tiles, bool))
        self._passes[pass_] = arrays  # type: ignore[assignment]
        return self._passes[pass_]

    def tick(self, rays: Counter[str]) -> None:
        """Save if the last time is long enough ago."""
        self._rays = rays
        if self._path is not None and time.monotonic() - self._saved > CHECKPOINT_SECONDS:
            self.save()

    def save(self) -> None:
        """Write the file; an interruption leaves the previous one whole."""
        if self._path is None or not self._passes:
            return
        arrays = {"key": np.array(self._key), "rays": np.array(json.dumps(self._rays))}
        for pass_, (mean, m2, done) in self._passes.items():
            arrays |= {f"mean{pass_}": mean, f"m2{pass_}": m2, f"done{pass_}": done}
        partial = self._path.with_name(self._path.name + ".partial")
        with open(partial, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        os.replace(partial, self._path)
        self._saved = time.monotonic()

    def remove(self) -> None:
        """The image is finished: the file has served."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)
