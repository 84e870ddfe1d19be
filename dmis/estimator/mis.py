"""MIS weights: heuristics, which weigh a sample by the densities of all techniques, and combiners by name.

A heuristic takes the effective densities ``a_j = w_j p_j`` and returns ``W / a_k``, where W is the MIS weight of a
sample of technique k: the factor that multiplies ``f`` in its estimate. With the balance heuristic it is
``1 / sum a_j``, the reciprocal of the mixture density. Source: Veach and Guibas 1995; Veach 1997, chapter 9.

A combiner makes one estimate of the shading samples of all techniques. A heuristic is all of it, but for one that needs
all samples of a pixel: that observes their records and corrects the pixel afterwards (`Combiner.collector`). What a
combiner needs of the settings is in its attributes, so that no other module depends on its name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from dmis.base.plugins import Later, Registry, guarded
from dmis.base.validate import check_array, number, positive
from dmis.base.vectors import TINY, Array

Heuristic = Callable[[Sequence[Array], int], Array]
"""``(a, k) -> W / a[k]``; k breaks ties, so that the weights of all techniques sum to 1."""
LARGEST_EXPONENT = 1e8
"""Exponent above which two float32 densities that differ have the weights 1 and 0 to float32's precision."""


def balance(a: Sequence[Array], k: int) -> Array:
    """``W = a_k / sum a``."""
    return 1 / np.maximum(_total(a), TINY)


def power(beta: float) -> Heuristic:
    """``W = a_k^beta / sum a^beta``, written with the ratios to a_k so that nothing overflows.

    From `LARGEST_EXPONENT` on it is `maximum`, its limit.
    """
    positive("the exponent of the power heuristic", beta)
    if beta > LARGEST_EXPONENT:
        return maximum
    least = np.float32(1e-18 ** min(1, 2 / beta))  # of a ratio; below it W is 0 to any float

    def raised(a: Array, b: Array) -> Array:
        ratio = b / np.maximum(np.maximum(a, b * least), TINY)
        return ratio * ratio if beta == 2 else ratio ** np.float32(beta)

    def heuristic(a: Sequence[Array], k: int) -> Array:
        others = _total(raised(a[k], b) for j, b in enumerate(a) if j != k)
        return 1 / (np.maximum(a[k], TINY) * (1 + others))

    return heuristic


def maximum(a: Sequence[Array], k: int) -> Array:
    """``W = 1`` for the technique with the largest density, 0 for the others."""
    wins = reduce(np.logical_and, (a[k] > b if j < k else a[k] >= b for j, b in enumerate(a) if j != k))
    return wins / np.maximum(a[k], TINY)


def cutoff(alpha: float) -> Heuristic:
    """Balance among the techniques whose density is at least `alpha` times the largest."""
    number("the threshold of the cutoff heuristic", alpha, 0, 1, "a share of the maximum")

    def heuristic(a: Sequence[Array], k: int) -> Array:
        threshold = np.float32(alpha) * reduce(np.maximum, a)
        return (a[k] >= threshold) / np.maximum(_total(b * (b >= threshold) for b in a), TINY)

    return heuristic


def _total(a: Iterable[Array]) -> Array:
    return reduce(np.add, a)


@dataclass(frozen=True)
class Combiner:
    """A combiner of MIS samples; with the defaults, a heuristic at the shares that samples were taken with.

    Attributes
    ----------
    name
        Its name in options and tables.
    heuristic
        Weights the samples; variance curves are those of this heuristic.
    collector
        From shares ``(2, P)`` or ``(2, 1)`` and numbers of samples ``(P,)`` makes the sums that correct pixels
        (`dmis.estimator.optimal_mis.Optimal`). It needs all samples of each light, which therefore have one share and
        known densities, of two techniques. None: it is a heuristic, whose weights are all there is.
    """

    name: str
    heuristic: Heuristic = balance
    collector: Callable[[Array, Array], Any] | None = None


FAMILIES: dict[str, tuple[Callable[[float], Heuristic], float]] = {"power": (power, 2.0), "cutoff": (cutoff, 0.1)}
"""Heuristics of a parameter, by name, and its default."""
COMBINERS: Registry[Combiner] = Registry(
    "combiner",
    {
        "balance": Combiner("balance"),
        "maximum": Combiner("maximum", maximum),
        "optimal": Later("dmis.estimator.optimal_mis", "OPTIMAL"),
    },
    reserved=dict.fromkeys(FAMILIES, "dmis has it for heuristics of a parameter"),
    source=lambda combiner: combiner.heuristic,
)
"""Combiners without a parameter, by name; `register_heuristic` adds to it."""


def register_heuristic(name: str, heuristic: Heuristic) -> None:
    """Make a heuristic of one's own known by its name, as in ``combiner=NAME`` of settings and rules.

    Parameters
    ----------
    name
        Letters and digits, words joined by ``_``.
    heuristic
        ``(a, k) -> W / a[k]``: from the effective densities ``a_j = w_j p_j``, K arrays ``(N,)``, the weight W of a
        sample of technique k over its own effective density, ``(N,)``. It is tried at some densities of two to four
        techniques, equal ones among them.

    Raises
    ------
    ValueError
        If the name is not right or taken, or the weights of all techniques are not finite, ``(N,)`` and of sum 1: an
        estimate with other weights has another mean.
    """
    COMBINERS.check(name, Combiner(name, heuristic))
    heuristic = guarded(f"heuristic {name}", heuristic, _check_over)
    rng = np.random.default_rng(1)
    for techniques, n in ((2, 1000), (3, 1000), (4, 8)):
        a = list(rng.exponential(size=(techniques, n)).astype(np.float32) ** 4)
        a[0][: n // 4] = 0  # a technique that does not reach the direction
        for density in a:
            density[n // 2 :] = rng.integers(1, 4, n // 2)  # equal ones among them
        with np.errstate(all="ignore"):  # what is not finite is refused
            total = sum(a[k] * heuristic(a, k) for k in range(techniques))
        wrong = ~(np.abs(total - 1) < 1e-3)  # of a NaN, too
        if wrong.any():
            raise ValueError(
                f"weights W of heuristic {name} must add up to 1 over the techniques; got {total[wrong][0]:.4g} for "
                f"the effective densities {', '.join(f'{density[wrong][0]:.4g}' for density in a)}. It must return "
                f"W / a[k], not W, and where densities are equal, k must break the tie"
            )
    COMBINERS[name] = Combiner(name, heuristic)


def _check_over(call: str, over: Any, a: Sequence[Array], k: int) -> None:
    """Raise a ValueError unless W / a[k] is right where a[k] is not 0."""
    check_array(call, over, a[k].size, str(a[k].shape), where=lambda: a[k] > 0)


def combiner_by_name(name: str) -> Combiner:
    """Return a combiner of `COMBINERS`, or of `FAMILIES`: ``power`` (exponent 2), ``power-3``, ``cutoff-0.5``.

    A ValueError if there is none of that name, or its number is out of range.
    """
    if name in COMBINERS:
        return COMBINERS[name]
    kind, dash, text = name.partition("-")
    try:
        heuristic, default = FAMILIES[kind]
        parameter = float(text) if dash else default
    except (KeyError, ValueError):
        from dmis.base.synonyms import COMBINERS as OLD
        from dmis.base.synonyms import advice

        raise COMBINERS.unknown(name, ", power[-EXPONENT], cutoff[-THRESHOLD]", advice(name, OLD, COMBINERS)) from None
    return Combiner(name, heuristic(parameter))
