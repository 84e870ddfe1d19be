"""Objectives of the literature: shares from one pilot at w = 1/2.

With ``X = f / q``, ``d = (p_l - p_b) / (p_l + p_b)`` and ``m(w) = p_w / q = 1 + (2 w - 1) d`` as in
`dmis.variance.curves`. An objective has the statistic that the pilot gathers, and solves for the share
of each patch; `dmis.fit.second_moment` makes rules of them. All but the first are approximations of the variance that
the first estimates itself, or stand-ins for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dmis.base.vectors import Array
from dmis.estimator.records import Record
from dmis.variance.curves import GRID, MIN_DENSITY_RATIO, samples_by_light, unrecorded_samples

Integrand = Callable[[Array, Array], Array]
"""From X and d of a light and a BRDF sample, ``(2, N)`` each, to values per camera sample ``(..., N)``."""


@dataclass(frozen=True)
class Objective:
    """What the pilot gathers, and the shares that follow from its means over patches.

    Attributes
    ----------
    integrand
        The function of the samples that is gathered.
    solve
        ``solve(means, cost) -> w``, ``(rows, columns)``, from the means over patches ``(..., rows, columns)`` and the
        cost of a camera sample at w = 0 and at w = 1.
    variance
        Whether the variance of the function is gathered in place of its mean.
    """

    integrand: Integrand
    solve: Callable[[Array, tuple[float, float]], Array]
    variance: bool = False


class Gather:
    """Means or unbiased variances per pixel of the integrand of an `objective`, summed over lights.

    A `dmis.estimator.records.Statistic` of the pilot.
    """

    def __init__(self, objective: Objective, pixels: int, shading_samples: int) -> None:
        self._objective = objective
        self._pixels = pixels
        self._shading_samples = shading_samples
        self._n = 0
        self._sum: Array | float = 0

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """See `dmis.estimator.records.Statistic.add`."""
        self._n += count
        n = radiance.shape[1]
        pairs = self._shading_samples // 2
        black = unrecorded_samples(2, n)  # so that there is a sum, even without a record
        for light in (*samples_by_light(records, self._shading_samples, n), black):
            for x, d in zip(*light, strict=True):
                values = self._objective.integrand(x, d)
                of_pixels = values.reshape(*values.shape[:-1], count, self._pixels)
                if self._objective.variance:
                    result = of_pixels.var(axis=-2, ddof=1, dtype=np.float64)
                else:
                    result = of_pixels.mean(axis=-2)
                self._sum = self._sum + count / pairs * result

    def sums(self) -> dict[str, Array]:
        """Return the sums of `values` per pixel, ``(..., P)``, see `dmis.estimator.records.Statistic.sums`."""
        return {"values": np.asarray(self._sum / max(self._n, 1))}


def _tangent(x: Array, d: Array) -> Array:
    """Return slope and bend of M2(w) at 1/2, ``(2, N)``."""
    square = x * x * d
    return np.stack([square.sum(axis=0) / 2, (square * d).sum(axis=0) / 2])


def _newton(means: Array, cost: tuple[float, float]) -> Array:
    """Return one Newton step of M2(w) from 1/2: ``1/2 + mean(X^2 d) / (4 mean(X^2 d^2))``."""
    slope, bend = means
    return 0.5 + _divide(slope, 4 * bend)


def _alone(x: Array, d: Array) -> Array:
    """Return f / p_i of the sample of each technique, ``(2, N)``."""
    # p_i / q of the technique that drew the sample
    ratio = np.stack([1 + d[0], 1 - d[1]])
    return x / np.maximum(ratio, MIN_DENSITY_RATIO)


def _inverse_variance(means: Array, cost: tuple[float, float]) -> Array:
    """Return shares in proportion to ``1 / (c_i v_i)``."""
    light, brdf = means
    return _proportion(brdf * cost[0], light * cost[1])


def _neyman(means: Array, cost: tuple[float, float]) -> Array:
    """Return shares in proportion to ``s_i / sqrt(c_i)``."""
    light, brdf = np.sqrt(np.maximum(means, 0))
    return _proportion(light / np.sqrt(cost[1]), brdf / np.sqrt(cost[0]))


def _squares(x: Array, d: Array) -> Array:
    """Return f / p_i of the sample of each technique, and its square, ``(2, 2, N)``."""
    alone = _alone(x, d)
    return np.stack([alone, alone * alone])


def _representativity(means: Array, cost: tuple[float, float]) -> Array:
    """Return shares in proportion to ``E[f / p_i]^2 / E[(f / p_i)^2]``; 1 for a technique that follows f."""
    first, second = means
    light, brdf = _divide(first**2, second)
    return _proportion(light, brdf)


def _divergence(x: Array, d: Array, gamma: float) -> Array:
    """Return ``xi(w) = E_q[(X / m)^gamma d]`` at the weights of the grid without its ends, ``(G - 2, N)``.

    It is in proportion to the negative slope of the divergence of order gamma between f and p_w.
    """
    x_to_gamma = x ** np.float32(gamma) if gamma != 1 else x
    xi = np.empty((len(GRID) - 2, x.shape[1]), np.float32)
    for g, w in enumerate(GRID[1:-1]):
        # m(w) = p_w / q = 1 + (2 w - 1) d
        m = np.maximum(1 + (2 * w - 1) * d, MIN_DENSITY_RATIO)
        xi[g] = (x_to_gamma * d / m ** np.float32(gamma)).sum(axis=0) / 2
    return xi


def _root(xi: Array, cost: tuple[float, float]) -> Array:
    """Return the root of xi, which falls with w because the divergence is convex; an end of the grid if it has none."""
    w = GRID[1:-1].astype(float)
    k = np.clip((xi > 0).sum(axis=0) - 1, 0, len(w) - 2)
    high, low = (np.take_along_axis(xi, i[None], axis=0)[0] for i in (k, k + 1))
    between = w[k] + (w[k + 1] - w[k]) * np.clip(_divide(high, high - low), 0, 1)
    cases = [(xi == 0).all(axis=0), (xi > 0).all(axis=0), (xi < 0).all(axis=0)]
    return np.select(cases, [0.5, 1.0, 0.0], between)


def _divide(a: Array, b: Array, otherwise: float = 0.0) -> Array:
    """Return a / b, and `otherwise` where b is 0."""
    return np.divide(a, b, out=np.full(np.shape(a), otherwise), where=b != 0)


def _proportion(a: Array, b: Array) -> Array:
    """Return a / (a + b), 1/2 where both are 0."""
    return _divide(a, a + b, 0.5)


_OBJECTIVES = {
    "taylor": Objective(_tangent, _newton),
    "inverse-variance": Objective(_alone, _inverse_variance, variance=True),
    "neyman": Objective(lambda x, d: x, _neyman, variance=True),  # W_i f / p_i with equal counts
    "representativity": Objective(_squares, _representativity),
    "kl": Objective(partial(_divergence, gamma=1.0), _root),
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
        return Objective(partial(_divergence, gamma=gamma), _root)
    if name not in _OBJECTIVES:
        raise ValueError(f"objective must be second-moment, {', '.join(OBJECTIVE_NAMES)}; got {name!r}")
    return _OBJECTIVES[name]
