"""Passes over an image, one for each round: read finished tiles from a checkpoint, render the rest, merge them."""

from __future__ import annotations

import math
import os
import time
from collections import Counter, defaultdict
from contextlib import closing
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from dmis.base.window import overlap
from dmis.fit.round import Round
from dmis.pipeline.executor import Parallel, Workers, check_parallel
from dmis.pipeline.job import Job
from dmis.pipeline.progress import Progress
from dmis.pipeline.tile import Tile, layout, make_tiles, render_tile
from dmis.variance.moments import Film

if TYPE_CHECKING:
    from dmis.pipeline.checkpoint import Store

_CHECKPOINT_BYTES = 24  # of a pixel in a pass, statistics not counted


class Passes:
    """Renders the passes of a job; a context manager that closes the executor.

    Parameters
    ----------
    parallel, checkpoint
        As those of `dmis.pipeline.render.render`.
    progress
        Called after each tile.

    Attributes
    ----------
    rays, pilot_rays
        Rays traced in all rounds so far, and in those of the pilot, by kind.
    seconds
        Time of the rounds so far, by their stage.
    embree_seconds
        CPU seconds of the ray queries of all tiles that were rendered so far.
    worker_seconds
        CPU seconds of all tiles that other processes have rendered so far.

    Raises
    ------
    ValueError
        If `parallel` is not right, or the checkpoint belongs to a different image.
    OSError
        If the checkpoint cannot be written.
    """

    def __init__(
        self,
        job: Job,
        parallel: Parallel = None,
        progress: Progress | None = None,
        checkpoint: str | os.PathLike[str] | None = None,
    ) -> None:
        self._job, self._progress = job, progress
        self._rounds = self._samples = 0
        self._pixels = math.prod(job.given_scene.camera.resolution)
        self.rays, self.pilot_rays = Counter[str](), Counter[str]()
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.embree_seconds = self.worker_seconds = 0.0
        # one thread is this one, so that a debugger or profiler sees what it does
        serial = parallel == 1 and not isinstance(parallel, bool)
        parallel = 1 if serial else check_parallel(parallel)
        self._store: Store | None = None
        if checkpoint is not None:
            from dmis.pipeline.checkpoint import Store
            from dmis.pipeline.fingerprint import content_hashes

            # all that the tiles depend on, by content
            hashes = content_hashes(job.given_scene, job.rule, job.settings)
            key = {**job.provenance, **hashes, "tiles": layout(job.settings)}
            self._store = Store(checkpoint, key, _CHECKPOINT_BYTES * self._pixels * (len(job.rule.pilot) + 1))
        job.scene.prepare()
        job.scene.plan.prepare(job.settings.lights, job.settings.sky_compensation)  # before workers get the scene
        self._workers = None if serial else Workers(job.scene, parallel)

    def __enter__(self) -> Passes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._workers is not None:
            self._workers.close()

    def render(self, round_: Round) -> Film:
        """Render a round over the image and return its film; one that goes on joins the samples before it.

        A ValueError if the round is not one of this image, see `dmis.fit.round.Round.checked`.
        """
        began, job = time.perf_counter(), self._job
        width, height = job.given_scene.camera.resolution
        round_ = round_.checked((height, width))
        n, before = round_.spp, round_.before
        n = n if isinstance(n, int) else n[..., None]
        mean, root = before.unlocked() if before else np.zeros((2, height, width, 3), np.float32)
        film = Film(
            n if before is None else n + before.n,
            mean,
            root,
            shading_samples=round_.settings.shading_samples,
            techniques=round_.mixture,
            budget=job.spp,
        )
        tiles = make_tiles(job.scene.camera.resolution, job.seed, self._rounds, round_)
        if job.window is not None:
            tiles = [tile for tile in tiles if overlap(tile.area, job.window)]
        self._render_tiles(tiles, round_, film)
        self._rounds += 1
        self.rays.update(film.rays)
        self.pilot_rays.update(film.rays if round_.stage == "pilot" else {})
        if round_.needs_features:
            from dmis.scene.feature_buffers import render_feature_buffers, render_pixel_features

            of_pixels = round_.needs_features == "pixels"
            features, rays = (render_pixel_features if of_pixels else render_feature_buffers)(job.given_scene)
            film = replace(film, features=features)
            self.rays["guide"] += rays
        film.lock()
        self.seconds[round_.stage] += time.perf_counter() - began
        return film

    def _render_tiles(self, tiles: list[Tile], round_: Round, film: Film) -> None:
        """Merge all tiles into the film: those of a checkpoint, then the others, the largest first.

        So none is waited for at the end.
        """
        tiles.sort(key=lambda tile: tile.camera_samples, reverse=True)
        by_number = {tile.number: tile for tile in tiles}
        stage, finished = round_.stage, self._samples
        for number, part in self._store.finished_tiles(self._rounds) if self._store else ():
            if tile := by_number.pop(number, None):
                self._merge(film, part, tile, round_.before)
                finished += tile.camera_samples
        missing = list(by_number.values())
        self._samples += sum(tile.camera_samples for tile in tiles)
        total = self._samples if stage == "final" else max(self._samples, self._pixels * self._job.spp)  # to come
        here = ((tile, render_tile(self._job.scene, tile)) for tile in missing)
        with closing(here if self._workers is None else self._workers.render(missing)) as results:
            for tile, part in results:
                self.embree_seconds += part.embree_seconds
                self.worker_seconds += part.worker_seconds
                if self._store:
                    self._store.append(tile, part)
                self._merge(film, part, tile, round_.before)
                finished += tile.camera_samples
                if self._progress:
                    self._progress(stage, finished, total)

    def _merge(self, film: Film, part: Film, tile: Tile, before: Film | None) -> None:
        """Merge the film of a tile into that of the image, or of a window as far as the tile is in it."""
        place = tile.area
        if self._job.window is not None and (common := overlap(tile.area, self._job.window)):
            inside, place = common
            part = part.of_area(inside)
        film.merge(part, place, before)
