"""Which heuristic combines the final samples best, from the curves of several that one pilot told.

Each heuristic has weights that are best for it (`dmis.curves`), so what counts is the error times time that each
reaches with its own. It is estimated from patches of `SIDE` pixels: large enough that noise in their curves, of which
the least is taken, flatters none; and one choice for the whole image, because within an image the same one won almost
everywhere in all scenes that were measured. The balance heuristic is never much worse than another (Veach and Guibas
1995), the power heuristic is better where one technique has nearly all of the integrand to itself: then weights need
not go as far from w = 1/2, which saves rays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dmis import mis
from dmis.curves import HALF, allowed, weighed
from dmis.sharing import pool
from dmis.variance import patch_sum
from dmis.vec import Array

SIDE = 16
"""Of patches, in pixels."""


def check_choice(names: Sequence[str]) -> None:
    """Refuse combiners that have no curves of their own to choose by."""
    for name in names:
        if name != "balance" and mis.find(name) is mis.balance:
            raise ValueError(
                f"combiners to choose from must be heuristics: balance, power, maximum or cutoff; got {name!r}"
            )
    if len(set(names)) < len(names):
        raise ValueError(f"combiners to choose from must differ; got {', '.join(names)}")


def choose(sums: Mapping[str, Array], shape: tuple[int, int], cost: Array, guard: float, counts: bool) -> int:
    """The heuristic with the least error times time: its index.

    The first is left only for a gain of more than `guard` standard errors. These are taken from the squares of the
    patches' gains, as if their mean were 0: too large, so that a gain in a few patches alone, which may be a few rare
    samples, is not sure.

    Parameters
    ----------
    sums
        See `dmis.curves.Curves.sums`, over patches of `dmis.tile.BASE` pixels, of several combiners.
    shape
        ``(H, W)`` of the image in pixels.
    cost
        Of a camera sample at the weights of `dmis.curves.GRID`.
    counts
        Whether patches have different numbers of samples, see `dmis.curves.weighed`.
    """
    means, _ = pool({name: sums[name] for name in ("curve", "position")}, shape, SIDE)
    curves, area = means["curve"], patch_sum(np.ones(shape), SIDE)
    if curves.ndim == 5:  # of several classes, which have the same weight here
        curves = curves.sum(axis=1)
    variance = np.maximum(curves + np.maximum(means["position"], 0), 0)
    price = None if counts else float((variance[0, HALF] * area).sum() / area.sum() / cost[HALF])
    least = np.stack([_least(own, v, area, cost, price) for own, v in zip(curves, variance, strict=True)])
    gains = (least - least[0]) * area
    total, error = gains.sum(axis=(1, 2)), np.sqrt((gains * gains).sum(axis=(1, 2)))
    sure = total < -guard * error
    sure[0] = True
    return int(np.where(sure, total, np.inf).argmin())


def _least(curve: Array, variance: Array, area: Array, cost: Array, price: float | None) -> Array:
    """What patches add to the image's error times time at their best weights, ``(rows, columns)``."""
    may = allowed((curve * area).sum(axis=(1, 2)))
    least = weighed(variance[may], cost[may], price).min(axis=0)
    return np.asarray(least if price is not None else np.sqrt(least))
