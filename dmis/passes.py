"""One pass over an image: it is cut into tiles, what a checkpoint has is taken from there, the rest is rendered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import closing

import numpy as np

from dmis.checkpoint import Store
from dmis.fit import Pilot
from dmis.memory import release
from dmis.scene import Scene
from dmis.settings import Settings
from dmis.tile import Statistic, Tile, batch_size, split
from dmis.variance import Film
from dmis.vec import Array
from dmis.workers import Workers

Progress = Callable[[str, int, int], None]
"""``progress(stage, done, total)``, in camera samples; stages are ``pilot`` and ``final``."""


class Passes:
    """Passes over the image, tile by tile.

    Attributes
    ----------
    rays
        Traced in all of them, by kind.
    tiles
        Of all of them.
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
        w: Array | float,
        settings: Settings,
        statistic: Callable[[int, int], Statistic] | None = None,
        control: Array | None = None,
        later: Array | float | None = None,
    ) -> Pilot:
        """One pass: `spp` camera samples at weight `w` (see `dmis.fit.Fit`), `later` behind the first surface, each one
        number or ``(H, W)``; `control` is ``(H, W, 3)``.
        """
        width, height = self._scene.camera.resolution
        tiles = []
        cut = split((width, height), int(np.mean(spp)), not isinstance(spp, int), batch_size(settings))
        for number, (rows, columns) in enumerate(cut):
            area = slice(*rows), slice(*columns)
            local, behind = _local(w, area), None if later is None else _local(later, area)
            count = spp if isinstance(spp, int) else spp[area].reshape(-1)
            beta = None if control is None else control[area].reshape(-1, 3).T.astype(np.float32)
            tile = Tile(self._seed, pass_, number, rows, columns, count, local, settings, statistic, beta, behind)
            tiles.append(tile)
        self.tiles.extend(tiles)
        stored = self._store.start(pass_, (height, width, 3), len(tiles))
        release(width * height)
        tiles.sort(key=_samples, reverse=True)  # so that no large one is waited for at the end
        missing = [tile for tile in tiles if not stored.done[tile.number]]
        total = sum(map(_samples, tiles))
        finished = total - sum(map(_samples, missing))
        with closing(self._workers.render(missing)) as results:
            for tile, rendered in results:
                self._store.put(tile, rendered)
                finished += _samples(tile)
                if self._progress:
                    self._progress(stage, finished, total)
        release(width * height)
        self.rays.update(stored.rays)
        n = spp if isinstance(spp, int) else spp[..., None]
        film = Film(n, stored.mean, stored.root)
        return Pilot(
            film, dict(stored.rays), stored.sums, settings.shading_samples, techniques=tuple(settings.techniques)
        )


def _local(w: Array | float, area: tuple[slice, slice]) -> Array | float:
    """What a `dmis.tile.Tile` has of it."""
    found = np.asarray(w)
    if found.ndim < 2:
        return found[:, None] if found.ndim else w
    return found[..., *area].reshape(*found.shape[:-2], -1)


def _samples(tile: Tile) -> int:
    """Camera samples of a tile."""
    area = (tile.rows[1] - tile.rows[0]) * (tile.columns[1] - tile.columns[0])
    return area * tile.spp if isinstance(tile.spp, int) else int(tile.spp.sum())
