"""Rules of six objectives of the literature: shares of light samples from one pilot at w = 1/2.

With ``X = f / q``, ``d = (p_l - p_b) / (p_l + p_b)`` and ``m(w) = p_w / q = 1 + (2 w - 1) d`` as in
`dmis.variance.curves`. The pilot gathers the mean, or the variance, of a function of X and d; from its means over
patches each rule solves for the shares. All are approximations of the variance, which the rule ``second-moment``
estimates itself, or stand-ins for it; none has a guard.

What they save: docs/results.md, *Rules of the literature*.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

import dmis
from dmis.base.patches import patch_spread
from dmis.base.validate import positive
from dmis.variance.curves import GRID, MIN_DENSITY_RATIO


class _Objective(dmis.PooledRule):
    """Base class of the rules: shares of patches from the means of what the pilot gathers."""

    variance = False
    """Whether the variance of the integrand is gathered in place of its mean."""

    def integrand(self, x, d):
        """Return what is gathered, ``(..., N)``, from X and d of a light and a BRDF sample, ``(2, N)`` each."""
        raise NotImplementedError

    def solve(self, means, cost):
        """Return the shares of patches from the means ``(..., rows, columns)``, and the costs at w = 0 and w = 1."""
        raise NotImplementedError

    @property
    def statistic(self):
        return partial(dmis.Gather, self.integrand, variance=self.variance)

    def fit(self, pilot):
        film = pilot[0.5]
        means, _ = self.pooled(film)
        brdf, light = self.sample_cost(film, np.array([[0, 1], [1, 0]])).tolist()
        weight = np.clip(self.solve(means["values"], (brdf, light)), 0, 1)
        return dmis.Fit(patch_spread(weight, self.patch, film.mean.shape[:2]), {"patch": weight})


class Taylor(_Objective):
    """Choose shares by one Newton step of the second moment from w = 1/2: Lu et al. 2013.

    ``w = 1/2 + mean(X^2 d) / (4 mean(X^2 d^2))``. Moves too little where the best share is at an end.
    """

    def integrand(self, x, d):
        """Return slope and bend of M2(w) at 1/2, ``(2, N)``."""
        square = x * x * d
        return np.stack([square.sum(axis=0) / 2, (square * d).sum(axis=0) / 2])

    def solve(self, means, cost):
        slope, bend = means
        return 0.5 + _divide(slope, 4 * bend)


class InverseVariance(_Objective):
    """Choose shares in proportion to 1 / variance of each technique alone: Havran and Sbert 2014.

    Shares are in proportion to ``1 / (c_i v_i)``. Variances are heavy-tailed: a technique whose spike was not seen gets
    nearly all samples.
    """

    variance = True

    def integrand(self, x, d):
        """Return f / p_i of the sample of each technique, ``(2, N)``."""
        return _alone(x, d)

    def solve(self, means, cost):
        light, brdf = means
        return _proportion(brdf * cost[0], light * cost[1])


class Neyman(_Objective):
    """Choose shares in proportion to the deviations of weighed contributions: Neyman 1934, Sbert et al. 2016.

    Shares are in proportion to ``s_i / sqrt(c_i)``, s_i being the deviation of ``W_i f / p_i``. That is optimal if the
    *weights* stay those of equal counts, a final round of tilt 1/2: that is the estimator of Sbert, Havran and
    Szirmay-Kalos, "Variance analysis of multi-sample and one-sample multiple importance sampling", Computer Graphics
    Forum 35(7), 2016, costs included. With the balance heuristic the weights change with w, and there is no guarantee.
    """

    variance = True

    def integrand(self, x, d):
        """Return W_i f / p_i at equal counts, which is X."""
        return x

    def solve(self, means, cost):
        light, brdf = np.sqrt(np.maximum(means, 0))
        return _proportion(light / np.sqrt(cost[1]), brdf / np.sqrt(cost[0]))


class Representativity(_Objective):
    """Choose shares by how evenly f / p of each technique is spread: Pajot et al. 2011.

    Shares are in proportion to ``E[f / p_i]^2 / E[(f / p_i)^2]``, 1 for a technique that follows f. The authors
    estimate it from photon maps.
    """

    def integrand(self, x, d):
        """Return f / p_i of the sample of each technique, and its square, ``(2, 2, N)``."""
        alone = _alone(x, d)
        return np.stack([alone, alone * alone])

    def solve(self, means, cost):
        first, second = means
        light, brdf = _divide(first**2, second)
        return _proportion(light, brdf)


class _Divergence(_Objective):
    """Base class of divergences: the share is the root of ``xi(w) = E_q[(X / m)^gamma d]``, their negative slope."""

    gamma = 1.0

    def integrand(self, x, d):
        """Return the terms of xi at the shares of the grid without its ends, ``(G - 2, N)``."""
        x_to_gamma = x ** np.float32(self.gamma) if self.gamma != 1 else x
        xi = np.empty((len(GRID) - 2, x.shape[1]), np.float32)
        for g, w in enumerate(GRID[1:-1]):
            # m(w) = p_w / q = 1 + (2 w - 1) d
            m = np.maximum(1 + (2 * w - 1) * d, MIN_DENSITY_RATIO)
            xi[g] = (x_to_gamma * d / m ** np.float32(self.gamma)).sum(axis=0) / 2
        return xi

    def solve(self, means, cost):
        """Return the root of xi, which falls with w because the divergence is convex; an end if it has none."""
        xi = means
        w = GRID[1:-1].astype(float)
        k = np.clip((xi > 0).sum(axis=0) - 1, 0, len(w) - 2)
        high, low = (np.take_along_axis(xi, i[None], axis=0)[0] for i in (k, k + 1))
        between = w[k] + (w[k + 1] - w[k]) * np.clip(_divide(high, high - low), 0, 1)
        cases = [(xi == 0).all(axis=0), (xi > 0).all(axis=0), (xi < 0).all(axis=0)]
        return np.select(cases, [0.5, 1.0, 0.0], between)


class KullbackLeibler(_Divergence):
    """Choose shares that minimise the Kullback-Leibler divergence of f and the mixture: Sbert et al."""


@dataclass(frozen=True, kw_only=True)
class Tsallis(_Divergence):
    """Choose shares that minimise the divergence of order gamma of f and the mixture: Sbert et al.

    gamma = 1 is the Kullback-Leibler divergence, which is robust; gamma = 2 is the second moment.
    """

    gamma: float = 2.0

    def __post_init__(self):
        super().__post_init__()
        positive("gamma", self.gamma)


def _alone(x, d):
    """Return f / p_i of the sample of each technique, ``(2, N)``."""
    # p_i / q of the technique that drew the sample
    ratio = np.stack([1 + d[0], 1 - d[1]])
    return x / np.maximum(ratio, MIN_DENSITY_RATIO)


def _divide(a, b, otherwise=0.0):
    """Return a / b, and `otherwise` where b is 0."""
    return np.divide(a, b, out=np.full(np.shape(a), otherwise), where=b != 0)


def _proportion(a, b):
    """Return a / (a + b), 1/2 where both are 0."""
    return _divide(a, a + b, 0.5)


dmis.register_rule("taylor", Taylor)
dmis.register_rule("inverse-variance", InverseVariance)
dmis.register_rule("neyman", Neyman)
dmis.register_rule("representativity", Representativity)
dmis.register_rule("kl", KullbackLeibler)
dmis.register_rule("tsallis", Tsallis)
