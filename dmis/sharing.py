"""Sharing statistics between pixels: sums over patches, averages with their neighbours."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dmis.filter import effective, gaussian, joint
from dmis.guides import SCALES
from dmis.tile import BASE
from dmis.variance import patch_mean, patch_sum
from dmis.vec import Array


def pool(
    sums: Mapping[str, Array],
    shape: tuple[int, int],
    patch: int,
    sigma: float | None = None,
    radius: int = 2,
    guides: Mapping[str, Array] | None = None,
) -> tuple[dict[str, Array], Array]:
    """Means over patches of statistics that were summed over patches of `BASE` pixels.

    Parameters
    ----------
    sums
        By name, ``(..., rows, columns)`` of base patches.
    shape
        ``(H, W)`` of the image in pixels.
    patch
        Side of the new patches, a multiple of `BASE`.
    sigma, radius
        Of a Gaussian over the new patches, in patches; None: no filter.
    guides
        Of base patches, see `dmis.guides`: the Gaussian is narrowed to neighbours that are alike. None: it is not.

    Returns
    -------
    means
        By name, ``(..., rows, columns)`` of the new patches.
    pixels
        To how many pixels with equal weights each mean amounts, ``(rows, columns)``.
    """
    every = {**sums, "pixels": patch_sum(np.ones(shape), BASE)}
    coarse = {name: patch_sum(a, patch // BASE) for name, a in every.items()}
    worth: Array | float = 1.0
    if sigma is not None and guides is not None:
        alike = {name: patch_mean(a, patch // BASE) for name, a in guides.items()}
        ends = np.cumsum([a[..., 0, 0].size for a in coarse.values()])[:-1]
        flat = np.concatenate([a.reshape(-1, *a.shape[-2:]) for a in coarse.values()])
        flat, worth = joint(flat, alike, SCALES, sigma, radius)
        parts = np.split(flat, ends)
        coarse = {name: part.reshape(a.shape) for (name, a), part in zip(coarse.items(), parts, strict=True)}
    elif sigma is not None:
        coarse = {name: _each(a, sigma, radius) for name, a in coarse.items()}
        worth = effective(sigma, radius)
    pixels = coarse.pop("pixels")
    return {name: a / pixels for name, a in coarse.items()}, pixels * worth


def _each(values: Array, sigma: float, radius: int) -> Array:
    """The Gaussian of each map in the last two axes."""
    flat = values.reshape(-1, *values.shape[-2:])
    return np.stack([gaussian(a, sigma, radius) for a in flat]).reshape(values.shape)
