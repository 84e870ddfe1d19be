"""Sizes of images, and windows: parts of an image, ``(x0, y0, x1, y1)`` in pixels from the top left."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from dmis.base.validate import whole

MAX_PIXELS = 2**25
"""Most pixels of an image that is rendered or read from a file: 400 MB of RGB."""
MAX_SIDE = 65535
"""Most pixels on a side of an image that is rendered or read from a file."""
MAX_CHANNELS = 64
"""Most channels of an image file that is read."""
MAX_VALUES = 16 * MAX_PIXELS
"""Most values of all channels of an image file that is read."""
Window = tuple[int, int, int, int]
"""First column and row, and the column and row after the last: ``(x0, y0, x1, y1)``."""


def window_area(window: Iterable[Any] | None, resolution: Sequence[int]) -> tuple[slice, slice]:
    """Return rows and columns of a window of an image of `resolution` (width, height); None: those of the image.

    A ValueError if it is empty, not inside of the image, or not four whole numbers.
    """
    if window is None:
        return slice(None), slice(None)
    width, height = resolution
    try:
        x0, y0, x1, y1 = (whole("window", side) for side in window)
        if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
            raise ValueError
    except (TypeError, ValueError):
        raise ValueError(
            f"a window must be (x0, y0, x1, y1) in pixels with 0 <= x0 < x1 <= {width} and 0 <= y0 < y1 <= {height}, "
            f"the size of the image; got {window}"
        ) from None
    return slice(y0, y1), slice(x0, x1)


def overlap(area: tuple[slice, slice], window: Window) -> tuple[tuple[slice, slice], tuple[slice, slice]] | None:
    """Return the rows and columns that an area and a window share, from the corner of each; None: they share none."""
    rows, columns = area
    left, top = max(columns.start, window[0]), max(rows.start, window[1])
    right, bottom = min(columns.stop, window[2]), min(rows.stop, window[3])
    if left >= right or top >= bottom:
        return None

    def from_corner(x: int, y: int) -> tuple[slice, slice]:
        return slice(top - y, bottom - y), slice(left - x, right - x)

    return from_corner(columns.start, rows.start), from_corner(window[0], window[1])


def check_size(width: int, height: int, channels: int = 1, most_values: int = MAX_VALUES) -> None:
    """Refuse an image that is empty or too large, before memory is taken for it."""
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS):
        raise ValueError(
            f"resolution must be 1 to {MAX_SIDE} pixels on a side and at most {MAX_PIXELS} pixels; got {width}x{height}"
        )
    if not 1 <= channels <= MAX_CHANNELS or channels * width * height > most_values:
        raise ValueError(
            f"an image must have at most {MAX_CHANNELS} channels, and {most_values} values in them; "
            f"got {channels} of {width}x{height}"
        )
