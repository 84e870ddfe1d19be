"""Multiple importance sampling: how samples are divided between two techniques, and how they are combined.

A camera sample carries S shading samples. A share ``w`` of a pixel's ``n = S spp`` shading samples goes to the first
technique (light sampling), ``1 - w`` to the second (BRDF sampling).

*Allocation.* The shares are rounded to whole samples systematically, with a random offset per pixel: slot ``i`` goes
to the first technique where ``floor((i+1) w + xi) > floor(i w + xi)``. At w = 1/2 and S = 2 that is exactly one
sample of each technique per camera sample.

*Combination.* Estimates are divided by the nominal shares, not by the realised counts: every slot belongs to the first
technique with probability w over the offset, whatever its neighbours do, so the estimate is unbiased even where a
technique's count happens to be 0.

A heuristic takes the effective densities ``a = w_own p_own`` and ``b = w_other p_other`` and returns ``W / a``, where
W is the MIS weight of the own technique's sample: the factor that multiplies ``f`` in its estimate. With the balance
heuristic it is ``1 / (a + b)``, the reciprocal of the mixture density. Source: Veach and Guibas 1995; Veach 1997,
chapter 9.

Frozen weights are those of equal counts, whatever the shares, see `against`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dmis.vec import TINY, Array

Heuristic = Callable[[Array, Array, bool], Array]
"""``(a, b, first) -> W / a``; `first` breaks ties, so that the weights of both techniques sum to 1."""
Allocation = Literal["systematic", "random"]


def balance(a: Array, b: Array, first: bool) -> Array:
    """``W = a / (a + b)``."""
    return 1 / np.maximum(a + b, TINY)


def power(beta: float) -> Heuristic:
    """``W = a^beta / (a^beta + b^beta)``, written with the ratio b/a so that nothing overflows."""
    if not beta > 0:
        raise ValueError(f"the exponent of the power heuristic must be positive; got {beta}")

    least = np.float32(1e-18 ** min(1, 2 / beta))  # of a / b; below it W is 0 to any float

    def heuristic(a: Array, b: Array, first: bool) -> Array:
        ratio = b / np.maximum(np.maximum(a, b * least), TINY)
        raised = ratio * ratio if beta == 2 else ratio ** np.float32(beta)
        return 1 / (np.maximum(a, TINY) * (1 + raised))

    return heuristic


def maximum(a: Array, b: Array, first: bool) -> Array:
    """``W = 1`` for the technique with the larger density, 0 for the other."""
    return ((a >= b) if first else (a > b)) / np.maximum(a, TINY)


def cutoff(alpha: float) -> Heuristic:
    """Balance among the techniques whose density is at least `alpha` times the largest."""
    if not 0 <= alpha <= 1:
        raise ValueError(
            f"the threshold of the cutoff heuristic must be in [0, 1], a share of the maximum; got {alpha}"
        )

    def heuristic(a: Array, b: Array, first: bool) -> Array:
        threshold = np.float32(alpha) * np.maximum(a, b)
        return (a >= threshold) / np.maximum(a + b * (b >= threshold), TINY)

    return heuristic


def against(combiner: str, share: Array) -> Array:
    """The share that the other technique has in the weights of samples of a technique with `share`: what is left of 1,
    but for the combiner ``frozen`` the same, so that the shares cancel in the weights.

    Frozen weights are ``W = p_own / (p_own + p_other)``, and a sample's estimate is ``W f / (share p_own)``, which is
    balance at the densities ``share p_own`` and ``share p_other``. With n samples in fixed shares its variance is
    ``(s_l^2 / w + s_b^2 / (1 - w)) / n``, s being standard deviations of ``W f / p_own``: least, ``(s_l + s_b)^2 /
    n``, at Neyman's allocation ``w = s_l / (s_l + s_b)``, and there never more than at equal counts. Source: Neyman
    1934; see the rule ``neyman``. Needs no statistics, costs nothing. Known failures: where a share is 0 a part of f
    is missing, a bias (hence `FROZEN`); rules that learn w for balance, such as ``second-moment``, minimise another
    variance.
    """
    return share if combiner == "frozen" else 1 - share


FROZEN = 0.05, 0.95
"""Range to which learned weights are clipped where the combiner is ``frozen``."""


def find(name: str) -> Heuristic:
    """A heuristic by name: ``balance``, ``power`` (exponent 2), ``power-3``, ``maximum``, ``cutoff`` (0.1),
    ``cutoff-0.5``. ``frozen`` is balance at other densities, see `against`; ``optimal`` and ``optimal-progressive``
    begin as balance, see `dmis.combine`; so does ``controlled``, see `dmis.control`.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    kind, dash, number = name.partition("-")
    try:
        value = float(number) if dash else None
    except ValueError:
        value = np.nan
    if name in ("balance", "frozen", "optimal", "optimal-progressive", "controlled"):
        return balance
    if kind == "maximum" and not dash:
        return maximum
    if kind == "power" and value == value:
        return power(2.0 if value is None else value)
    if kind == "cutoff" and value == value:
        return cutoff(0.1 if value is None else value)
    raise ValueError(
        f"combiner must be balance, power[-EXPONENT], maximum, cutoff[-THRESHOLD], frozen, optimal, "
        f"optimal-progressive or controlled; got {name!r}"
    )


@dataclass(frozen=True, eq=False)
class Counts:
    """How many of each camera sample's shading samples go to the first technique.

    Attributes
    ----------
    first
        ``(N,)`` int8, or one int for all samples.
    reached
        How many of its pixel's shading samples went to the first and to the second technique before this camera
        sample, ``(2, N)``; None if the same number goes there every time, or at random.
    """

    first: np.ndarray | int
    reached: np.ndarray | None = None

    def take(self, index: np.ndarray) -> Counts:
        """Those of the camera samples `index`."""
        reached = None if self.reached is None else self.reached.take(index, axis=1)
        return Counts(self.first if isinstance(self.first, int) else self.first.take(index), reached)


def allocate(
    w: Array | float,
    shading_samples: int,
    pixel: np.ndarray,
    number: np.ndarray,
    offset: Array,
    rng: np.random.Generator | None,
) -> Counts:
    """Divide the shading samples of N camera samples.

    Parameters
    ----------
    w
        Share of the first technique: ``(P,)`` for P pixels, or one number for all of them.
    shading_samples
        S, shading samples per camera sample.
    pixel, number
        Pixel of each camera sample, and number of the sample within it, ``(N,)``.
    offset
        Random offsets of the systematic rounding in [0, 1), ``(P,)``.
    rng
        None for systematic rounding; otherwise each shading sample picks its technique at random (the one-sample
        model of MIS), with numbers from here.
    """
    if np.ndim(w) == 0 and (rng is None or w in (0, 1)) and float(shading_samples * w).is_integer():
        return Counts(int(shading_samples * w))
    share = w if np.ndim(w) == 0 else np.asarray(w).take(pixel)
    if rng is not None:
        picks = rng.random((shading_samples, len(pixel)), dtype=np.float32) < share
        return Counts(picks.sum(axis=0, dtype=np.int8))
    share, offset, slot = np.asarray(share, np.float64), offset.take(pixel), number * shading_samples
    reached = np.floor(slot * share + offset).astype(np.int32)
    first = np.floor((slot + shading_samples) * share + offset).astype(np.int32) - reached
    return Counts(first.astype(np.int8), np.stack([reached, slot - reached]))
