"""Windows: a part of an image that is rendered with the bits that it has in the whole.

Random numbers of a tile's stream, such as those of Russian roulette, go to the samples of the tile in turn. So all
tiles that a window touches are rendered wholly, and cut; its bits are right with any sampler and integrator. A rule
that learns has no films of the rest of the image; to it a window is an image of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from dmis.base.window import Window
from dmis.fit.fixed import Fixed
from dmis.fit.round import Round
from dmis.fit.rule import Rule
from dmis.image import MAX_PIXELS
from dmis.pipeline.film import FilmTile, PassFilm
from dmis.pipeline.tile import Tile
from dmis.scene.camera import Camera

OF_WHOLE = "the same pixels as in the whole image"
"""Value of ``window`` in the provenance of a window whose pixels have the bits of the whole image."""
OWN_IMAGE = "an image of its own to this rule; fixed shares, as of balance, give the pixels of the whole image"
"""Value of ``window`` in the provenance of another window."""


def window_of(camera: Camera, rule: Rule) -> tuple[Window | None, dict[str, Any]]:
    """Return the window that a camera shows, to be rendered as in the whole image, and notes for the provenance.

    None if the rule learns, or the whole is larger than an image may be. The notes are ``window``, `OF_WHOLE` or
    `OWN_IMAGE`; ``crop``, the pixels x0, y0, x1, y1; and ``frame``, width and height of the whole image.
    """
    frame = camera.frame or camera.resolution
    (x0, y0), (width, height) = camera.corner, camera.resolution
    window = (x0, y0, x0 + width, y0 + height)
    place = {"crop": list(window), "frame": list(frame)}
    if not isinstance(rule, Fixed) or math.prod(frame) > MAX_PIXELS:
        return None, {"window": OWN_IMAGE, **place}
    return window, {"window": OF_WHOLE, **place}


class WindowFilm(PassFilm):
    """The film of a window, into which tiles of the whole image are merged, as far as they are in it."""

    def __init__(self, window: Window, tiles: int, round_: Round) -> None:
        x0, y0, x1, y1 = window
        super().__init__((x1 - x0, y1 - y0), tiles, round_)
        self._sides = (y0, y1), (x0, x1)

    def touched(self, tiles: Sequence[Tile]) -> list[Tile]:
        """Return those of the tiles that have pixels of the window."""
        return [t for t in tiles if all(begin < end for begin, end in self._common(t.rows, t.columns))]

    def merge_tile(self, tile: FilmTile) -> None:
        """Merge the pixels of a tile that are in the window, and count all of its rays."""
        sides = tile.rows, tile.columns
        common = self._common(*sides)
        inside = tuple(slice(begin - side[0], end - side[0]) for (begin, end), side in zip(common, sides, strict=True))
        rows, columns = (
            (begin - first, end - first) for (begin, end), (first, _) in zip(common, self._sides, strict=True)
        )
        super().merge_tile(
            replace(tile, rows=rows, columns=columns, mean=tile.mean[inside], root=tile.root[inside], sums={})
        )

    def _common(self, *sides: tuple[int, int]) -> list[tuple[int, int]]:
        """Return the rows and columns ``(begin, end)`` of the whole image that a tile and the window share."""
        pairs = zip(sides, self._sides, strict=True)
        return [(max(tile[0], window[0]), min(tile[1], window[1])) for tile, window in pairs]
