"""Pooling of statistics over pixels: means over patches, filtered with those of neighbouring patches."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dmis.base.patches import PATCH, patch_mean, patch_sum, row_blocks
from dmis.base.vectors import Array
from dmis.filter import effective, gaussian, joint
from dmis.scene.feature_buffers import FEATURE_SCALES


def pool(
    sums: Mapping[str, Array],
    shape: tuple[int, int],
    patch: int,
    sigma: float | None = None,
    radius: int = 2,
    features: Mapping[str, Array] | None = None,
) -> tuple[dict[str, Array], Array]:
    """Return means over patches of statistics that were summed over patches of `PATCH` pixels.

    Parameters
    ----------
    sums
        By name, ``(..., rows, columns)`` of base patches; ``pixels`` are the pixels in them, if not all.
    shape
        ``(H, W)`` of the image in pixels.
    patch
        Side of the new patches, a multiple of `PATCH`.
    sigma, radius
        Of a Gaussian over the new patches, in patches; None: no filter.
    features
        Feature buffers of base patches, see `dmis.scene.feature_buffers`: the Gaussian is narrowed to neighbours with
        similar features. None: it is not.

    Returns
    -------
    means
        By name, ``(..., rows, columns)`` of the new patches.
    pixels
        Effective number of pixels in each mean, ``(rows, columns)``.
    """
    sums = sums if "pixels" in sums else {"pixels": patch_sum(np.ones(shape), PATCH), **sums}
    coarse = {name: patch_sum(a, patch // PATCH) for name, a in sums.items()}
    del sums  # the filtered ones take the place of sums that the caller does not keep
    patches: Array | float = 1.0  # effective number of patches in each mean
    if sigma is not None and features is not None:
        of_patches = {name: patch_mean(a, patch // PATCH) for name, a in features.items()}
        coarse, patches = _joint(coarse, of_patches, sigma, radius)
    elif sigma is not None:
        coarse = {name: _gaussian_of_maps(a, sigma, radius) for name, a in coarse.items()}
        patches = effective(coarse["pixels"].shape, sigma, radius)
    pixels = coarse.pop("pixels")
    return {name: coarse.pop(name) / pixels for name in list(coarse)}, pixels * patches


def _joint(
    maps: Mapping[str, Array], features: Mapping[str, Array], sigma: float, radius: int
) -> tuple[dict[str, Array], Array]:
    """Return all maps after the joint filter, and the effective number of patches; computed some rows at a time."""
    filtered = {name: np.empty(a.shape) for name, a in maps.items()}
    rows, columns = maps["pixels"].shape
    patches = np.empty((rows, columns))
    ends = np.cumsum([a[..., 0, 0].size for a in maps.values()])[:-1]
    for block in row_blocks(rows, max(16, 2 * radius)):
        near = slice(max(block.start - radius, 0), min(block.stop + radius, rows))
        flat = np.concatenate([a[..., near, :].reshape(-1, near.stop - near.start, columns) for a in maps.values()])
        flat, entries = joint(flat, {name: g[:, near] for name, g in features.items()}, FEATURE_SCALES, sigma, radius)
        inner = slice(block.start - near.start, block.stop - near.start)
        patches[block] = entries[inner]
        for a, part in zip(filtered.values(), np.split(flat[:, inner], ends), strict=True):
            a[..., block, :] = part.reshape(a[..., block, :].shape)
    return filtered, patches


def _gaussian_of_maps(values: Array, sigma: float, radius: int) -> Array:
    """Return each map, of the last two axes, after the Gaussian filter."""
    flat = values.reshape(-1, *values.shape[-2:])
    return np.stack([gaussian(a, sigma, radius) for a in flat]).reshape(values.shape)
