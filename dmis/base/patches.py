"""Square patches of pixels: their sums and means, and the map that gives each pixel its patch's value."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dmis.base.vectors import Array


def patch_sum(values: Array, size: int) -> Array:
    """Return sums over square patches of `size` entries in the last axes, ``(..., ceil(H / size), ceil(W / size))``.

    Patches at the right and bottom border may be smaller. A `size` larger than the image means one patch.
    """
    if size < 1:
        raise ValueError(f"patch must be at least 1 pixel; got {size}")
    if size == 1:
        return values
    for axis in (-2, -1):  # the first entries of all patches, the second, ...: np.add.reduceat is slow in short runs
        lines = np.moveaxis(values, axis, 0)
        total = lines[::size].copy(order="K")
        for k in range(1, min(size, len(lines))):
            line = lines[k::size]
            total[: len(line)] += line
        values = np.moveaxis(total, 0, axis)
    return values


def row_blocks(rows: int, size: int = 16) -> Iterator[slice]:
    """Return slices of `size` rows that cover `rows` rows, so that intermediate arrays stay in the cache."""
    return (slice(k, min(k + size, rows)) for k in range(0, rows, size))


def patch_mean(image: Array, size: int) -> Array:
    """Return means over square patches; those of smaller patches at the border divide by their own pixels."""
    if size == 1:
        return image
    height, width = image.shape[-2:]
    return patch_sum(image, size) / (patch_sum(np.ones((height, 1)), size) * patch_sum(np.ones((1, width)), size))


PATCH = 4
"""Side of the patches over which a tile sums its statistics, in pixels."""

EVERYWHERE = slice(None), slice(None)
COLOURS = tuple((slice(y, None, 2), slice(x, None, 2)) for y in (0, 1) for x in (0, 1))
"""The pixels of each of four colours, 2x2 neighbours having all of them: rows and columns in an image."""


def other_colours(colour: int) -> list[int]:
    """Return the three other colours, whose samples may decide how the pixels of one `colour` are sampled."""
    return [k for k in range(len(COLOURS)) if k != colour]


def patch_spread(values: Array, size: int, shape: tuple[int, int], at: tuple[slice, slice] = EVERYWHERE) -> Array:
    """Return the values ``(..., rows, columns)`` of the patches of the pixels `at` some places of an image (H, W)."""
    rows, columns = (np.arange(n)[part] // size for n, part in zip(shape, at, strict=True))
    return values[..., rows[:, None], columns]


def pixels_apart(image: Array) -> Array:
    """Return the pixels of each patch of an image ``(..., H, W)``, ``(PATCH, PATCH, ..., rows, columns)``.

    Beyond the border they are 0.
    """
    *outer, height, width = image.shape
    padded = np.pad(image, [(0, 0)] * len(outer) + [(0, -height % PATCH), (0, -width % PATCH)])
    split = padded.reshape(*outer, padded.shape[-2] // PATCH, PATCH, -1, PATCH)
    return np.moveaxis(split, (-3, -1), (0, 1))


def pixels_together(apart: Array, shape: tuple[int, int]) -> Array:
    """Return the image ``(..., H, W)`` whose pixels `pixels_apart` has taken apart."""
    split = np.moveaxis(apart, (0, 1), (-3, -1))
    *outer, rows, _, columns, _ = split.shape
    return split.reshape(*outer, PATCH * rows, PATCH * columns)[..., : shape[0], : shape[1]]


def by_colour(image: Array) -> Array:
    """Return an image ``(..., H, W)`` once for each colour, with 0 at the pixels of the others, ``(4, ..., H, W)``."""
    apart = np.zeros((len(COLOURS), *image.shape), image.dtype)
    for of_colour, (rows, columns) in zip(apart, COLOURS, strict=True):
        of_colour[..., rows, columns] = image[..., rows, columns]
    return apart
