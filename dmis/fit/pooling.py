"""Sharing statistics between pixels: sums over patches, averages with their neighbours."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dmis.base.patches import PATCH, patch_mean, patch_sum, row_blocks
from dmis.base.vectors import Array
from dmis.filter import check_taps, effective, gaussian, joint
from dmis.scene.feature_buffers import SCALES


def check_sharing(patch: int, size: int, sigma: float, guard: float) -> None:
    """Raise a ValueError unless these options of a rule that shares statistics are in range."""
    if not PATCH <= patch <= 65536 or patch % PATCH:
        raise ValueError(
            f"patch must be a multiple of {PATCH} pixels, in which curves are kept, of at most 65536; got {patch}"
        )
    check_taps(size)
    if not 0 < sigma < np.inf:
        raise ValueError(f"sigma must be positive and finite; got {sigma}")
    if not guard >= 0:
        raise ValueError(f"guard must not be negative, standard errors; got {guard}")


def pool(
    sums: Mapping[str, Array],
    shape: tuple[int, int],
    patch: int,
    sigma: float | None = None,
    radius: int = 2,
    guides: Mapping[str, Array] | None = None,
) -> tuple[dict[str, Array], Array]:
    """Means over patches of statistics that were summed over patches of `PATCH` pixels.

    Parameters
    ----------
    sums
        By name, ``(..., rows, columns)`` of base patches.
    shape
        ``(H, W)`` of the image in pixels.
    patch
        Side of the new patches, a multiple of `PATCH`.
    sigma, radius
        Of a Gaussian over the new patches, in patches; None: no filter.
    guides
        Of base patches, see `dmis.scene.feature_buffers`: the Gaussian is narrowed to neighbours that are alike. None:
        it is not.

    Returns
    -------
    means
        By name, ``(..., rows, columns)`` of the new patches.
    pixels
        To how many pixels with equal weights each mean amounts, ``(rows, columns)``.
    """
    every = {**sums, "pixels": patch_sum(np.ones(shape), PATCH)}
    coarse = {name: patch_sum(a, patch // PATCH) for name, a in every.items()}
    worth: Array | float = 1.0
    if sigma is not None and guides is not None:
        alike = {name: patch_mean(a, patch // PATCH) for name, a in guides.items()}
        coarse, worth = _joint(coarse, alike, sigma, radius)
    elif sigma is not None:
        coarse = {name: _each(a, sigma, radius) for name, a in coarse.items()}
        worth = effective(coarse["pixels"].shape, sigma, radius)
    pixels = coarse.pop("pixels")
    return {name: coarse.pop(name) / pixels for name in list(coarse)}, pixels * worth


def _joint(
    maps: Mapping[str, Array], guides: Mapping[str, Array], sigma: float, radius: int
) -> tuple[dict[str, Array], Array]:
    """The joint filter of all maps, some rows at a time with those that they are averaged with."""
    out = {name: np.empty(a.shape) for name, a in maps.items()}
    rows, columns = maps["pixels"].shape
    worth = np.empty((rows, columns))
    ends = np.cumsum([a[..., 0, 0].size for a in maps.values()])[:-1]
    for block in row_blocks(rows, max(16, 2 * radius)):
        near = slice(max(block.start - radius, 0), min(block.stop + radius, rows))
        flat = np.concatenate([a[..., near, :].reshape(-1, near.stop - near.start, columns) for a in maps.values()])
        flat, entries = joint(flat, {name: g[:, near] for name, g in guides.items()}, SCALES, sigma, radius)
        inner = slice(block.start - near.start, block.stop - near.start)
        worth[block] = entries[inner]
        for a, found in zip(out.values(), np.split(flat[:, inner], ends), strict=True):
            a[..., block, :] = found.reshape(a[..., block, :].shape)
    return out, worth


def _each(values: Array, sigma: float, radius: int) -> Array:
    """The Gaussian of each map in the last two axes."""
    flat = values.reshape(-1, *values.shape[-2:])
    return np.stack([gaussian(a, sigma, radius) for a in flat]).reshape(values.shape)
