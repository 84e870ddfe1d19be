"""Objectives of the literature: shares from one pilot at w = 1/2.

With ``X = f / q``, ``d = (p_l - p_b) / (p_l + p_b)`` and ``m(w) = p_w / q = 1 + (2 w - 1) d`` as in
`dmis.variance.curves`. An objective has the statistic that the pilot gathers, and solves for the share
of each patch; `dmis.fit.second_moment` makes rules of them. All but the first are approximations of the variance that
the first estimates itself, or stand-ins for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.records import Record, Statistic
from dmis.variance.curves import GRID, MIN_DENSITY_RATIO, samples_by_light, unrecorded_samples

Means = Mapping[str, Array]
"""Means over pixels of what was gathered, ``(..., rows, columns)``."""
Integrand = Callable[[Array, Array], Mapping[str, Array]]
"""From X and d of a light and a BRDF sample, ``(2, N)`` each, to values per camera sample ``(..., N)``."""


@dataclass(frozen=True)
class Objective:
    """A statistic of the pilot, and the shares that follow from its means over patches.

    Attributes
    ----------
    statistic
        Called with the number of pixels and of shading samples, see `dmis.estimator.records.Statistic`.
    solve
        ``solve(means, cost) -> w``, `cost` of a camera sample at w = 0 and at w = 1.
    """

    statistic: Callable[[int, int], Statistic]
    solve: Callable[[Means, tuple[float, float]], Array]


class Gather:
    """Means per pixel of functions of the pilot's samples, or their unbiased variances.

    Parameters
    ----------
    integrand
        The functions. Lights are gathered one by one and added up.
    variance
        Whether variances are wanted.
    """

    def __init__(self, integrand: Integrand, variance: bool, pixels: int, shading_samples: int) -> None:
        self._integrand, self._variance, self._pixels = integrand, variance, pixels
        self._shading_samples = shading_samples
        self._n = 0
        self._sums: dict[str, Array] = {}

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """See `dmis.estimator.records.Statistic.add`."""
        self._n += count
        n, pairs = radiance.shape[1], self._shading_samples // 2
        black = unrecorded_samples(2, n)  # so that every name has a sum, even without a record
        for light in (*samples_by_light(records, self._shading_samples, n), black):
            for x, d in zip(*light, strict=True):
                for name, values in self._integrand(x, d).items():
                    of_pixels = values.reshape(*values.shape[:-1], count, self._pixels)
                    if self._variance:
                        result = of_pixels.var(axis=-2, ddof=1, dtype=np.float64)
                    else:
                        result = of_pixels.mean(axis=-2)
                    self._sums[name] = self._sums.get(name, 0) + count / pairs * result

    def sums(self) -> dict[str, Array]:
        """See `dmis.estimator.records.Statistic.sums`."""
        return {name: a / max(self._n, 1) for name, a in self._sums.items()}


def _tangent(x: Array, d: Array) -> dict[str, Array]:
    square = x * x * d
    return {"slope": square.sum(axis=0) / 2, "bend": (square * d).sum(axis=0) / 2}


def _newton(means: Means, cost: tuple[float, float]) -> Array:
    """Return one Newton step of M2(w) from 1/2: ``1/2 + mean(X^2 d) / (4 mean(X^2 d^2))``."""
    return 0.5 + _divide(means["slope"], 4 * means["bend"])


def _alone(x: Array, d: Array) -> dict[str, Array]:
    """Return f / p_i of the sample of each technique, ``(2, N)``."""
    # p_i / q of the technique that drew the sample
    ratio = np.stack([1 + d[0], 1 - d[1]])
    return {"alone": x / np.maximum(ratio, MIN_DENSITY_RATIO)}


def _halves(x: Array, d: Array) -> dict[str, Array]:
    """Return the weighted contribution of each technique, ``W_i f / p_i`` with equal counts, ``(2, N)``."""
    return {"halves": x}


def _squares(x: Array, d: Array) -> dict[str, Array]:
    alone = _alone(x, d)["alone"]
    return {"first": alone, "second": alone * alone}


def _inverse_variance(means: Means, cost: tuple[float, float]) -> Array:
    """Return shares in proportion to ``1 / (c_i v_i)``."""
    light, brdf = means["alone"]
    return _proportion(brdf * cost[0], light * cost[1])


def _neyman(means: Means, cost: tuple[float, float]) -> Array:
    """Return shares in proportion to ``s_i / sqrt(c_i)``."""
    light, brdf = np.sqrt(np.maximum(means["halves"], 0))
    return _proportion(light / np.sqrt(cost[1]), brdf / np.sqrt(cost[0]))


def _representativity(means: Means, cost: tuple[float, float]) -> Array:
    """Return shares in proportion to ``E[f / p_i]^2 / E[(f / p_i)^2]``; 1 for a technique that follows f."""
    light, brdf = _divide(means["first"] ** 2, means["second"], 0.0)
    return _proportion(light, brdf)


def _tsallis(gamma: float, x: Array, d: Array) -> dict[str, Array]:
    """Return ``xi(w) = E_q[(X / m)^gamma d]`` at the weights of the grid, without its ends, ``(G - 2, N)``."""
    raised = x ** np.float32(gamma) if gamma != 1 else x
    out = np.empty((len(GRID) - 2, x.shape[1]), np.float32)
    for g, w in enumerate(GRID[1:-1]):
        m = np.maximum(1 + (2 * w - 1) * d, MIN_DENSITY_RATIO)
        out[g] = (raised * d / m ** np.float32(gamma)).sum(axis=0) / 2
    return {"xi": out}


def _root(means: Means, cost: tuple[float, float]) -> Array:
    """Return the root of xi, which falls with w because the divergence is convex; an end of the grid if it has none."""
    xi, w = means["xi"], GRID[1:-1].astype(float)
    k = np.clip((xi > 0).sum(axis=0) - 1, 0, len(w) - 2)
    high, low = (np.take_along_axis(xi, i[None], axis=0)[0] for i in (k, k + 1))
    between = w[k] + (w[k + 1] - w[k]) * np.clip(_divide(high, high - low), 0, 1)
    between = np.where((xi > 0).all(axis=0), 1.0, np.where((xi < 0).all(axis=0), 0.0, between))
    return np.where((xi == 0).all(axis=0), 0.5, between)


def _divide(a: Array, b: Array, otherwise: float = 0.0) -> Array:
    """Return a / b, and `otherwise` where b is 0."""
    return np.divide(a, b, out=np.full(np.shape(a), otherwise), where=b != 0)


def _proportion(a: Array, b: Array) -> Array:
    """Return a / (a + b), 1/2 where both are 0."""
    return _divide(a, a + b, 0.5)


_OBJECTIVES = {
    "taylor": Objective(partial(Gather, _tangent, False), _newton),
    "inverse-variance": Objective(partial(Gather, _alone, True), _inverse_variance),
    "neyman": Objective(partial(Gather, _halves, True), _neyman),
    "representativity": Objective(partial(Gather, _squares, False), _representativity),
    "kl": Objective(partial(Gather, partial(_tsallis, 1.0), False), _root),
}
OBJECTIVE_NAMES = (*_OBJECTIVES, "tsallis")


def objective(name: str, gamma: float = 2.0) -> Objective:
    """Return an objective by name; `gamma` is the order of ``tsallis``.

    ``taylor``
        Lu, Pacanowski, Granier 2013: one Newton step of the second moment. Two sums per pixel. Moves too little where
        the best weight is at an end.
    ``inverse-variance``
        After Havran and Sbert 2014: shares by the variances of the techniques alone, which are heavy-tailed: a
        technique whose spike was not seen gets nearly all.
    ``neyman``
        Neyman 1934: by the standard deviations of the weighted contributions. Optimal if the *weights* stay those of
        equal counts: with the combiner ``frozen`` it is the estimator of Sbert, Havran and Szirmay-Kalos, "Variance
        analysis of multi-sample and one-sample multiple importance sampling", Computer Graphics Forum 35(7), 2016,
        costs included. With the balance heuristic the weights change with w, and there is no guarantee.
    ``representativity``
        After Pajot et al. 2011, who estimate it from photon maps; here it is how evenly f / p_i is spread in the pilot.
    ``kl``, ``tsallis``
        Sbert, Szirmay-Kalos et al.: the root of ``xi(w) = E_q[(X / m)^gamma d]``, gamma = 1 for the Kullback-Leibler
        divergence of f and p_w, robust; gamma = 2 for the second moment.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    if name == "tsallis":
        return Objective(partial(Gather, partial(_tsallis, gamma), False), _root)
    if name not in _OBJECTIVES:
        raise ValueError(f"objective must be second-moment, {', '.join(OBJECTIVE_NAMES)}; got {name!r}")
    return _OBJECTIVES[name]
