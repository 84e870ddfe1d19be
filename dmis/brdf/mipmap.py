"""Images averaged over the footprint of a pixel, for the textures that a camera ray meets.

An image is kept at halved sizes, each texel the mean of those below. The footprint of a pixel is an ellipse in the
image: its shorter axis chooses the level, between two of which values are interpolated, and bilinear lookups along the
longer one are summed with a Gaussian that ends at both tips, ``exp(-2 r^2) - exp(-2)``.

Sources: Williams, "Pyramidal Parametrics", 1983; McCormack et al., "Feline", 1999; the falloff is that of pbrt-v2.
"""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.texture import Image

MOST_LOOKUPS = 8
"""Lookups along the longer axis of a footprint; a longer one is as wide as these need, as in pbrt."""


def averaged(image: Image, uv: Array, steps: tuple[Array, Array]) -> Array:
    """Return mean values of an image around coordinates, ``(C, N)``.

    Parameters
    ----------
    image
        The texture.
    uv
        Texture coordinates ``(2, N)``.
    steps
        By how much they change from a pixel to the next, along x and along y, ``(2, N)`` each.
    """
    height, width, channels = image.texels.shape
    size = np.array([[image.scale[0] * width], [image.scale[1] * height]], np.float32)
    x, y = (np.hypot(*(step * size)) for step in steps)
    longer = np.where(x >= y, *steps)
    length = np.maximum(x, y)
    width_in_texels = np.maximum(np.maximum(np.minimum(x, y), length / MOST_LOOKUPS), 1)
    level = np.minimum(np.log2(width_in_texels), len(image.levels) - 1)
    lookups = np.clip(np.ceil(length / width_in_texels), 1, MOST_LOOKUPS)
    out = np.empty((channels, uv.shape[1]), np.float32)
    for n in np.unique(lookups):
        index = np.flatnonzero(lookups == n)
        radii = (2 * np.arange(n) + 1) / n - 1
        weights = np.exp(-2 * radii**2) - np.exp(-2)
        weights /= weights.sum()
        at, along, levels = uv.take(index, axis=1), longer.take(index, axis=1), level.take(index)
        total = np.zeros((channels, len(index)), np.float32)
        for radius, weight in zip(radii.astype(np.float32), weights.astype(np.float32), strict=True):
            total += weight * _between(image, at + radius * along, levels)
        out[:, index] = total
    return out


def _between(image: Image, uv: Array, level: Array) -> Array:
    """Return values ``(C, N)`` at coordinates ``(2, N)``, linear between the two levels around `level` ``(N,)``."""
    out = np.empty((image.texels.shape[2], len(level)), np.float32)
    finer = level.astype(np.int8)
    for k in np.unique(finer):
        index = np.flatnonzero(finer == k)
        at, share = uv.take(index, axis=1), level.take(index) - np.float32(k)
        value = image.levels[k](at)
        if share.any():
            value = value + share * (image.levels[k + 1](at) - value)
        out[:, index] = value
    return out
