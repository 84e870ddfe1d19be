"""Checkpoints: finished tiles of an image, kept in a file, so that interrupted work is not lost."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dmis.tile import BASE, Rendered, Tile

SECONDS = 10.0
"""Between two times that the file is written."""


@dataclass(eq=False)
class Pass:
    """What is finished of one pass over the image."""

    mean: np.ndarray
    m2: np.ndarray
    done: np.ndarray
    rays: Counter[str]
    sums: dict[str, np.ndarray]

    def put(self, tile: Tile, rendered: Rendered) -> None:
        """Enter a tile."""
        area = slice(*tile.rows), slice(*tile.columns)
        self.mean[area], self.m2[area] = rendered.moments.mean, rendered.moments.m2
        corner = tile.rows[0] // BASE, tile.columns[0] // BASE
        for name, values in rendered.sums.items():
            if name not in self.sums:
                whole = (-(-n // BASE) for n in self.mean.shape[:2])
                self.sums[name] = np.zeros((*values.shape[:-2], *whole))
            rows, columns = (slice(c, c + n) for c, n in zip(corner, values.shape[-2:], strict=True))
            self.sums[name][..., rows, columns] = values
        self.rays.update(rendered.rays)
        self.done[tile.number] = True


class Store:
    """Finished tiles of all passes, kept in a file from time to time."""

    def __init__(self, path: str | os.PathLike[str] | None, provenance: Mapping[str, Any]) -> None:
        self._path = None if path is None else Path(path)
        self._key = json.dumps(provenance, sort_keys=True)
        self._passes: dict[int, Pass] = {}
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

    def start(self, pass_: int, shape: tuple[int, int, int], tiles: int) -> Pass:
        """A pass, as far as the file has it."""
        loaded = {k.partition(":")[2]: a for k, a in self._loaded.items() if k.startswith(f"{pass_}:")}
        if loaded:
            rays = Counter(json.loads(str(loaded.pop("rays"))))
            mean, m2, done = (loaded.pop(name) for name in ("mean", "m2", "done"))
            self._passes[pass_] = Pass(mean, m2, done, rays, loaded)
        else:
            self._passes[pass_] = Pass(np.zeros(shape), np.zeros(shape), np.zeros(tiles, bool), Counter(), {})
        return self._passes[pass_]

    def tick(self) -> None:
        """Save if the last time is long enough ago."""
        if self._path is not None and time.monotonic() - self._saved > SECONDS:
            self.save()

    def save(self) -> None:
        """Write the file; an interruption leaves the previous one whole."""
        if self._path is None or not self._passes:
            return
        arrays = {"key": np.array(self._key)}
        for number, p in self._passes.items():
            rays = np.array(json.dumps(p.rays))
            parts = {"mean": p.mean, "m2": p.m2, "done": p.done, "rays": rays, **p.sums}
            arrays |= {f"{number}:{name}": array for name, array in parts.items()}
        partial = self._path.with_name(self._path.name + ".partial")
        with open(partial, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        os.replace(partial, self._path)
        self._saved = time.monotonic()

    def remove(self) -> None:
        """The image is finished: the file has served."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)
