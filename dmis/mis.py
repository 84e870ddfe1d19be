"""Multiple importance sampling: how samples are divided between techniques, and how they are combined.

A camera sample carries S shading samples. A share ``w`` of a pixel's ``n = S spp`` shading samples goes to the first
technique (light sampling), ``1 - w`` to the second (BRDF sampling). K > 2 techniques have shares ``w_1 .. w_K`` of sum
1, a point of the simplex. See `shares` for how both are written.

*Allocation.* The shares are rounded to whole samples systematically, with a random offset per pixel: slot ``i`` goes
to the first technique where ``floor((i+1) w + xi) > floor(i w + xi)``. At w = 1/2 and S = 2 that is exactly one
sample of each technique per camera sample. Of more than two techniques, those behind the first divide what it leaves
in the same way, each with an offset of its own.

*Combination.* Estimates are divided by the nominal shares, not by the realised counts: every slot belongs to the first
technique with probability w over the offset, whatever its neighbours do, so the estimate is unbiased even where a
technique's count happens to be 0.

A heuristic takes the effective densities ``a_k = w_k p_k`` and returns ``W / a_own``, where W is the MIS weight of the
own technique's sample: the factor that multiplies ``f`` in its estimate. With the balance heuristic it is
``1 / sum a_k``, the reciprocal of the mixture density. Source: Veach and Guibas 1995; Veach 1997, chapter 9.

Frozen weights are those of equal counts, whatever the shares, see `against`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Literal

import numpy as np

from dmis.vec import TINY, Array

Heuristic = Callable[[Sequence[Array], int], Array]
"""``(a, own) -> W / a[own]``; which one is `own` breaks ties, so that the weights of all techniques sum to 1."""
Allocation = Literal["systematic", "random"]


def shares(w: Array | float) -> tuple[Array | float, ...]:
    """Shares of all techniques: ``(w, 1 - w)`` of a number or ``(N,)``, the rows of ``(K, N)`` or ``(K, 1)``."""
    return tuple(w) if np.ndim(w) == 2 else (w, 1 - w)  # type: ignore[arg-type]


def balance(a: Sequence[Array], own: int) -> Array:
    """``W = a_own / sum a``."""
    return 1 / np.maximum(_total(a), TINY)


def power(beta: float) -> Heuristic:
    """``W = a_own^beta / sum a^beta``, written with the ratios to a_own so that nothing overflows."""
    if not beta > 0:
        raise ValueError(f"the exponent of the power heuristic must be positive; got {beta}")

    least = np.float32(1e-18 ** min(1, 2 / beta))  # of a ratio; below it W is 0 to any float

    def raised(a: Array, b: Array) -> Array:
        ratio = b / np.maximum(np.maximum(a, b * least), TINY)
        return ratio * ratio if beta == 2 else ratio ** np.float32(beta)

    def heuristic(a: Sequence[Array], own: int) -> Array:
        others = _total(raised(a[own], b) for k, b in enumerate(a) if k != own)
        return 1 / (np.maximum(a[own], TINY) * (1 + others))

    return heuristic


def maximum(a: Sequence[Array], own: int) -> Array:
    """``W = 1`` for the technique with the largest density, 0 for the others."""
    wins = reduce(np.logical_and, (a[own] > b if k < own else a[own] >= b for k, b in enumerate(a) if k != own))
    return wins / np.maximum(a[own], TINY)


def cutoff(alpha: float) -> Heuristic:
    """Balance among the techniques whose density is at least `alpha` times the largest."""
    if not 0 <= alpha <= 1:
        raise ValueError(
            f"the threshold of the cutoff heuristic must be in [0, 1], a share of the maximum; got {alpha}"
        )

    def heuristic(a: Sequence[Array], own: int) -> Array:
        threshold = np.float32(alpha) * reduce(np.maximum, a)
        return (a[own] >= threshold) / np.maximum(_total(b * (b >= threshold) for b in a), TINY)

    return heuristic


def _total(a: Iterable[Array]) -> Array:
    return reduce(np.add, a)


def against(combiner: str, shares: Sequence[Array | float], own: int) -> Sequence[Array | float]:
    """The shares that count in the weights of samples of the technique `own`: `shares`, but for the combiner
    ``frozen`` all the same, so that they cancel in the weights.

    Frozen weights are ``W = p_own / (p_own + p_other)``, and a sample's estimate is ``W f / (share p_own)``, which is
    balance at the densities ``share p_own`` and ``share p_other``. With n samples in fixed shares its variance is
    ``(s_l^2 / w + s_b^2 / (1 - w)) / n``, s being standard deviations of ``W f / p_own``: least, ``(s_l + s_b)^2 /
    n``, at Neyman's allocation ``w = s_l / (s_l + s_b)``, and there never more than at equal counts. Source: Neyman
    1934; see the rule ``neyman``. Needs no statistics, costs nothing. Known failures: where a share is 0 a part of f
    is missing, a bias (hence `FROZEN`); rules that learn w for balance, such as ``second-moment``, minimise another
    variance.
    """
    return [shares[own]] * len(shares) if combiner == "frozen" else shares


FROZEN = 0.05, 0.95
"""Range of weights where the combiner is ``frozen``; those of a fit are clipped to it."""


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


def exponent(name: str) -> float | None:
    """Of the densities in the weights of a heuristic by name, 1 for balance; None if it is no power of them."""
    heuristic, (kind, _, number) = find(name), name.partition("-")
    if heuristic is balance:
        return 1.0
    return float(number or 2) if kind == "power" else None


@dataclass(frozen=True, eq=False)
class Counts:
    """How each camera sample's shading samples are divided.

    Attributes
    ----------
    each
        How many go to each technique but the last, which has the rest: ``(N,)`` int8, or one int for all camera
        samples.
    reached
        How many of its pixel's shading samples went to each technique before this camera sample, ``(K, N)``; None if
        the same number goes there every time, or at random, or if nobody asks.
    """

    each: tuple[np.ndarray | int, ...]
    reached: np.ndarray | None = None

    @property
    def first(self) -> np.ndarray | int:
        """How many go to the first technique."""
        return self.each[0]

    def take(self, index: np.ndarray) -> Counts:
        """Those of the camera samples `index`."""
        reached = None if self.reached is None else self.reached.take(index, axis=1)
        return Counts(tuple(n if isinstance(n, int) else n.take(index) for n in self.each), reached)


def allocate(
    w: Array | float,
    shading_samples: int,
    pixel: np.ndarray,
    number: np.ndarray,
    offset: Array,
    rng: np.random.Generator | None,
    tally: bool = True,
) -> Counts:
    """Divide the shading samples of N camera samples.

    Parameters
    ----------
    w
        See `shares`: ``(P,)`` or ``(K, P)`` for P pixels, or one number or ``(K, 1)`` for all of them.
    shading_samples
        S, shading samples per camera sample.
    pixel, number
        Pixel of each camera sample, and number of the sample within it, ``(N,)``.
    offset
        Random offsets of the systematic rounding in [0, 1), ``(P,)`` for two techniques, ``(K - 1, P)`` for more.
    rng
        None for systematic rounding; otherwise each shading sample picks its technique at random (the one-sample
        model of MIS), with numbers from here.
    tally
        Whether to count `Counts.reached`, which only samplers with a sequence ask for.
    """
    parts = shares(w)
    if (np.ndim(w) == 0 or np.shape(w)[1:] == (1,)) and (rng is None or any(np.all(share == 1) for share in parts)):
        whole = [float(shading_samples * np.max(share)) for share in parts[:-1]]
        if all(n.is_integer() for n in whole):
            return Counts(tuple(int(n) for n in whole))
    if rng is not None:
        u = rng.random((shading_samples, len(pixel)), dtype=np.float32)
        bounds = (_of_samples(np.asarray(bound), pixel) for bound in itertools.accumulate(parts[:-1]))
        below = [(u < bound).sum(axis=0, dtype=np.int8) for bound in bounds]
        return Counts(tuple(np.diff(below, axis=0, prepend=np.int8(0))))
    each: list[np.ndarray] = []
    reached: list[np.ndarray] = []
    slot, left = number * shading_samples, np.asarray(shading_samples)
    for k, (share, of_pixel) in enumerate(zip(parts[:-1], np.atleast_2d(offset), strict=True)):
        fraction = np.asarray(share, np.float64)  # of what the techniques before it have left
        if k:
            rest = np.sum(np.broadcast_arrays(*parts[k:]), axis=0, dtype=np.float64)
            fraction = np.divide(fraction, rest, out=np.zeros_like(rest), where=rest > 0)
        fraction, start = _of_samples(fraction, pixel), of_pixel.take(pixel)
        before, after = ((n * fraction + start).astype(np.int32) for n in (slot, slot + left))  # rounded down
        each.append(after - before)
        reached.append(before)
        slot, left = slot - before, left - each[-1]
    return Counts(tuple(n.astype(np.int8) for n in each), np.stack([*reached, slot]) if tally else None)


def _of_samples(of_pixels: Array, pixel: np.ndarray) -> Array:
    """What camera samples have of what their pixels have, ``(P,)``; or of what all have."""
    return of_pixels if of_pixels.size == 1 else of_pixels.take(pixel)


def rounding(shares: Sequence[float], shading_samples: int) -> Array:
    """Covariance of the shares of a camera sample's S shading samples that techniques really get, ``(K, K)``, after
    systematic rounding by `allocate`.
    """
    wanted = np.asarray(shares, np.float64)
    found = np.zeros((len(wanted), len(wanted)))
    for probability, counts in _roundings(tuple(wanted), shading_samples):
        off = np.array(counts) / shading_samples - wanted
        found += probability * np.outer(off, off)
    return found


def _roundings(shares: tuple[float, ...], n: int) -> Iterator[tuple[float, tuple[int, ...]]]:
    """All ways to round n times the shares, and their probabilities."""
    if len(shares) == 1:
        yield 1.0, (n,)
        return
    rest = sum(shares)
    exact = n * shares[0] / rest if rest > 0 else 0.0
    low = math.floor(exact + 1e-9)
    for count, probability in ((low, 1 - exact + low), (low + 1, exact - low)):
        if probability > 1e-9:
            for other, counts in _roundings(shares[1:], n - count):
                yield probability * other, (count, *counts)
