"""Adaptive patches: as large as the curves of their parts agree, as small as they surely differ.

From the smallest patches upwards, four neighbours (fewer at the border) become one patch with one weight, unless
keeping their own weights surely gains.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from dmis.curves import HALF
from dmis.pooled import Pooled, allowed, least, weighed
from dmis.variance import patch_spread, patch_sum
from dmis.vec import Array

LARGEST = 64
"""Side in base patches of the largest patches."""
SELECTION = 2.0
"""Standard errors added to the guard of a split: the parts' weights are the best of many, so they look too good."""


def adaptive_patches(
    sums: Mapping[str, Array],
    pixels: Array,
    cost: Array,
    guard: float,
    prepare: Callable[[Pooled], Pooled] | None = None,
    price: float | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The weight of every base patch, from patches of the size that its surroundings allow.

    Parameters
    ----------
    sums
        Of `dmis.curves.Curves` over base patches, ``(..., rows, columns)``.
    pixels
        Of each base patch, ``(rows, columns)``.
    cost
        Of a camera sample at the weights of the grid, ``(G,)``.
    guard
        Standard errors that leaving w = 1/2 must gain in a patch; a split must gain `SELECTION` more.
    prepare
        What is done with the curves of patches of every size, such as `dmis.shrinkage.shrink`; None: nothing.
    price
        Of cost in variance, see `dmis.pooled.weighed`.

    Returns
    -------
    index
        Into the grid of weights, ``(rows, columns)``.
    size
        Side of the patch that each base patch belongs to, in base patches, ``(rows, columns)``.
    """
    shape = pixels.shape
    index = np.full(shape, HALF)
    size = np.ones(shape, int)
    # of the patches so far: total of objective - objective at 1/2, and the square of its standard error
    gain, error = np.zeros(shape), np.zeros(shape)
    times = 1
    may = allowed(sums["curve"].sum(axis=(1, 2)))
    while True:
        n = patch_sum(pixels, times)
        means: dict[str, Any] = {name: patch_sum(a, times) / n for name, a in sums.items()}
        curves = Pooled(**means, pixels=n)
        if prepare is not None:
            curves = prepare(curves)
        own = least(curves, cost, guard, may, price)
        objective = weighed(curves.variance, cost, price)
        spread = curves.gain_error(cost if price is None else np.ones_like(cost))
        merged = np.take_along_axis(objective - objective[HALF], own[None], axis=0)[0] * n
        merged_error = (np.take_along_axis(spread, own[None], axis=0)[0] * n) ** 2
        if times > 1:
            apart, apart_error = patch_sum(gain, 2), patch_sum(error, 2)
            keep = merged - apart > (guard + SELECTION) * np.sqrt(apart_error + merged_error)
            merged, merged_error = np.where(keep, apart, merged), np.where(keep, apart_error, merged_error)
            wide = patch_spread(~keep, times, shape)
        else:
            wide = np.ones(shape, bool)
        index = np.where(wide, patch_spread(own, times, shape), index)
        size = np.where(wide, times, size)
        gain, error = merged, merged_error
        if times >= LARGEST or gain.size == 1:
            return index, size
        times *= 2
