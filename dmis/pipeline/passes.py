"""Passes over an image: cut it into tiles, read finished ones from a checkpoint, render the rest, merge all of them."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from types import TracebackType
from typing import Any

import numpy as np

from dmis.base.malloc import release
from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.cost import rays_of_all_pixels
from dmis.estimator.patterns import PatternMap
from dmis.estimator.records import Statistic
from dmis.estimator.settings import Settings
from dmis.fit.rule import Pilot
from dmis.pipeline.checkpoint import Store
from dmis.pipeline.executor import Parallel, Workers, check_parallel
from dmis.pipeline.film import FilmTile, PassFilm
from dmis.pipeline.job import FinalPass, Job
from dmis.pipeline.progress import Progress
from dmis.pipeline.tile import Tile, make_tiles
from dmis.scene.feature_buffers import render_feature_buffers
from dmis.variance.moments import Film, join
from dmis.variance.replicates import mean_of_replicates, replicate_seed

Observer = Callable[[Sequence[Tile]], None]
"""Called with the tiles of a pass before they are rendered."""
_CHECKPOINT_BYTES = 24  # of a pixel in a pass, statistics not counted


class Passes:
    """Renders the passes of a job; a context manager that closes the executor.

    Parameters
    ----------
    parallel, checkpoint
        As those of `dmis.pipeline.render.render`.
    progress
        Called after each tile.
    observer
        See `Observer`.

    Attributes
    ----------
    rays
        Rays traced in all passes so far, by kind.
    embree_seconds
        CPU seconds of the ray queries of all tiles that were rendered so far.

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
        observer: Observer | None = None,
    ) -> None:
        self._job, self._progress, self._observer = job, progress, observer
        self._pixels = math.prod(job.scene.camera.resolution)
        self.rays: Counter[str] = Counter()
        self.embree_seconds = 0.0
        parallel = check_parallel(parallel)
        self._store: Store | None = None
        if checkpoint is not None:
            passes = (len(job.rule.pilot) + 1) * job.settings.replicates
            self._store = Store(checkpoint, job.key, _CHECKPOINT_BYTES * self._pixels * passes)
        self._workers = Workers(job.scene, parallel)

    def __enter__(self) -> Passes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._workers.close(now=kind is not None)

    def pilot(self) -> tuple[dict[Any, Pilot], list[Film]]:
        """Render the pilot: one pass for each weight, and the feature buffers if the rule needs them.

        Returns
        -------
        pilot
            By weight.
        first_round
            Moments of the samples of each replicate, from which the final ones go on; none if they do not.
        """
        job = self._job
        replicates = job.settings.replicates if job.rule.continues else 1
        pilot, first_round = {}, []
        for number, (w, spp) in enumerate(job.pilot_samples.items()):
            parts = [
                self.render(
                    self._pass_number(number, replicate), "pilot", spp // replicates, shares_of(w), job.pilot_settings,
                    job.statistic,
                )
                for replicate in range(replicates)
            ]  # fmt: skip
            pilot[w] = _pool_replicates(parts)
            first_round += [part.moments for part in parts] if job.rule.continues else []
        if job.rule.needs_features:
            features, rays = render_feature_buffers(job.scene)
            self.rays["guide"] += rays
            pilot = {w: replace(p, features=features) for w, p in pilot.items()}
            release(self._pixels)
        return pilot, first_round

    def final(self, final: FinalPass, first_round: Sequence[Film]) -> Film:
        """Render the final pass, a pass for each replicate; the moments per pixel, with those of the `first_round`."""
        films = []
        for replicate in range(final.settings.replicates):
            number = self._pass_number(len(self._job.rule.pilot), replicate)
            film = self.render(
                number, "final", final.samples, final.shares, final.settings, control=final.control,
                patterns=final.patterns,
            ).moments  # fmt: skip
            films.append(film if final.patterns is None else join(first_round[replicate], film, final.patterns.begin))
        return mean_of_replicates(films, exact=True)

    def _pass_number(self, number: int, replicate: int) -> int:
        """Return the number of a pass over a replicate, which is its own; those of the first replicate come first."""
        return number + replicate * (len(self._job.rule.pilot) + 1)

    def render(
        self,
        pass_: int,
        stage: str,
        spp: Array | int,
        shares: Array,
        settings: Settings,
        statistic: Callable[[int, int], Statistic] | None = None,
        control: Array | None = None,
        patterns: PatternMap | None = None,
    ) -> Pilot:
        """Render one pass and return its moments, rays and sums.

        Parameters
        ----------
        pass_
            Number of the pass, which its random streams are made from; it tells the replicate, too.
        stage
            Name of the pass for `Progress`.
        spp, shares, settings, statistic, control, patterns
            As in `dmis.pipeline.tile.make_tiles`.
        """
        resolution = self._job.scene.camera.resolution
        seed = replicate_seed(self._job.seed, pass_ // (len(self._job.rule.pilot) + 1))
        tiles = make_tiles(resolution, seed, pass_, spp, shares, settings, statistic, control, patterns)
        if self._observer:
            self._observer(tuple(tiles))
        film = PassFilm.empty(resolution, len(tiles))
        for film_tile in self._store.finished_tiles(pass_) if self._store else ():
            film.merge_tile(film_tile)
        release(self._pixels)
        tiles.sort(key=lambda tile: tile.camera_samples, reverse=True)  # so that no large one is waited for at the end
        missing = [tile for tile in tiles if not film.done[tile.number]]
        total = sum(tile.camera_samples for tile in tiles)
        finished = total - sum(tile.camera_samples for tile in missing)
        with closing(self._workers.render(missing)) as results:
            for tile, rendered in results:
                self.embree_seconds += rendered.embree_seconds
                film_tile = FilmTile.of(tile, rendered)
                if self._store:
                    self._store.append(film_tile)
                film.merge_tile(film_tile)
                finished += tile.camera_samples
                if self._progress:
                    self._progress(stage, finished, total)
        release(self._pixels)
        self.rays.update(rays_of_all_pixels(film.rays))
        moments = Film(spp if isinstance(spp, int) else spp[..., None], film.mean, film.root)
        techniques = tuple(settings.techniques)
        of_pass = moments, dict(film.rays), film.sums, settings.shading_samples
        return Pilot(*of_pass, techniques=techniques, budget=self._job.spp)


def _pool_replicates(pilots: Sequence[Pilot]) -> Pilot:
    """Return the pilot of all replicates of a first round."""
    if len(pilots) == 1:
        return pilots[0]
    rays = sum((Counter(pilot.rays) for pilot in pilots), Counter[str]())
    sums = {name: np.sum([pilot.sums[name] for pilot in pilots], axis=0) for name in pilots[0].sums}
    moments = mean_of_replicates([pilot.moments for pilot in pilots], exact=False)
    return replace(pilots[0], moments=moments, rays=rays, sums=sums, replicates=len(pilots))
