"""Passes over an image: cut it into tiles, read finished ones from a checkpoint, render the rest, merge all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import closing

from dmis.base.malloc import release
from dmis.base.vectors import Array
from dmis.estimator.records import Statistic
from dmis.estimator.settings import Settings
from dmis.fit.rule import Pilot
from dmis.pipeline.checkpoint import Store
from dmis.pipeline.executor import Workers
from dmis.pipeline.film import FilmTile, PassFilm
from dmis.pipeline.tile import Tile, make_tiles
from dmis.scene.scene import Scene
from dmis.variance.moments import Film

Progress = Callable[[str, int, int], None]
"""``progress(stage, done, total)``, in camera samples; stages are ``pilot`` and ``final``."""


class Passes:
    """Renders passes over an image, tile by tile, on the film of each pass.

    Attributes
    ----------
    rays
        Rays traced in all passes so far, by kind.
    tiles
        Tiles of all passes so far.
    """

    def __init__(
        self,
        scene: Scene,
        seed: int,
        workers: Workers,
        progress: Progress | None,
        store: Store,
    ) -> None:
        self._scene, self._seed = scene, seed
        self._workers, self._progress, self._store = workers, progress, store
        self.rays: Counter[str] = Counter()
        self.tiles: list[Tile] = []

    def render(
        self,
        pass_: int,
        stage: str,
        spp: Array | int,
        shares: Array,
        settings: Settings,
        statistic: Callable[[int, int], Statistic] | None = None,
        control: Array | None = None,
    ) -> Pilot:
        """Render one pass and return its moments, rays and sums.

        Parameters
        ----------
        pass_
            Number of the pass, which its random streams are made from.
        stage
            Name of the pass for `Progress`.
        spp, shares, settings, statistic, control
            As in `dmis.pipeline.tile.make_tiles`.
        """
        width, height = self._scene.camera.resolution
        tiles = make_tiles((width, height), self._seed, pass_, spp, shares, settings, statistic, control)
        self.tiles.extend(tiles)
        film = PassFilm.empty((width, height), len(tiles))
        for film_tile in self._store.finished_tiles(pass_):
            film.merge_tile(film_tile)
        release(width * height)
        tiles.sort(key=lambda tile: tile.camera_samples, reverse=True)  # so that no large one is waited for at the end
        missing = [tile for tile in tiles if not film.done[tile.number]]
        total = sum(tile.camera_samples for tile in tiles)
        finished = total - sum(tile.camera_samples for tile in missing)
        with closing(self._workers.render(missing)) as results:
            for tile, rendered in results:
                film_tile = FilmTile.of(tile, rendered)
                self._store.append(film_tile)
                film.merge_tile(film_tile)
                finished += tile.camera_samples
                if self._progress:
                    self._progress(stage, finished, total)
        release(width * height)
        self.rays.update(film.rays)
        moments = Film(spp if isinstance(spp, int) else spp[..., None], film.mean, film.root)
        techniques = tuple(settings.techniques)
        return Pilot(moments, dict(film.rays), film.sums, settings.shading_samples, techniques=techniques)
