"""The rule ``simplex``: shares of K techniques per patch, where the variance times cost is least.

For two techniques the rule ``second-moment`` does the same on a finer grid. Techniques k = 1..K with shares w_k of sum
1, points of the simplex, and densities p_k are mixed by the balance heuristic (docs/theory.md, Eq. 18, is the same for
two techniques): a sample of k has the value ``Y_k = f F_k / p_w``, ``p_w = sum_j w_j p_j``. F_k is 1, except for
techniques whose density is not known (``resampled``): there p_k is an approximation of the density, and the factor F_k
corrects for it. With

    m_k(w) = E_k[Y_k],  M2(w) = sum_k w_k E_k[Y_k^2],  sum_k w_k m_k = I

a shading sample has the variance ``M2 - sum_k w_k m_k^2`` at a point y, if the numbers of samples are fixed: the
variance within each technique, which is ``M2 - I^2 - w (1 - w) D^2`` for two. A camera sample takes the mean of S of
them, n_k of technique k, where n_k is rounded up or down (`rounding_covariance`), so that

    V(w) = Var_y(I) + E_y[M2 - sum_k w_k m_k^2] / S + sum_kl cov(n_k, n_l) / S^2 Cov_y(m_k, m_l).

A pilot at equal shares gives all of that for every w. Where the density is known, E_k is estimated from the samples of
all such techniques, weighted by p_k over their mixture: if one technique misses a light, the samples of the others find
it. Where the density is not known, ``E_k[Y_k]`` is the mean over the samples of technique k alone.

If all densities are known M2 is ``integral of f^2 / p_w``, convex in w, with one minimum. V, and M2 with an
approximate density, need not be, so the rule takes the least value on a grid.

What it saves: docs/results.md, *Several techniques*.
"""

import itertools
import math
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

import dmis
from dmis.base.patches import patch_spread, patch_sum
from dmis.base.vectors import TINY
from dmis.estimator.mis import technique_by_name
from dmis.variance.curves import (
    CURVE_BATCH,
    MIN_DENSITY_RATIO,
    mean_square,
    power_of_two_near,
    product_of_halves,
    select_pixels,
    squared_mean,
    summed_variance,
    with_gain_square,
)

dmis.load_plugin("resampled")  # the technique of the default mix

GRID_STEPS = 6
"""Largest number of steps of the grid from one technique alone to another; `grid` rounds it down to a multiple of K."""
SMALLEST_SHARE = 0.03
"""Least positive share of a technique in the points of the grid near the border of the simplex."""
PRICES = 2.0 ** -np.arange(6)
"""Prices of cost in variance that are tried, times that at `baseline_point`."""


# Variance curves ------------------------------------------------------------------------------------------------------


@cache
def grid(techniques):
    """Return the shares at which V is estimated, ``(K, G)``, and for each point one without zero shares, ``(G,)``.

    The points are even steps over the simplex. Points on its border, which leave techniques out, have a second point
    in its interior, where these techniques have the share `SMALLEST_SHARE`.

    Returns
    -------
    shares
        Points of the simplex, ``(K, G)``.
    interior
        Index of the interior point of each border point, and of each interior point itself, ``(G,)``.
    """
    # a multiple of K has the point of equal shares
    steps = techniques * (GRID_STEPS // techniques)
    compositions = itertools.product(range(steps + 1), repeat=techniques)
    even = np.array([c for c in compositions if sum(c) == steps]).T / steps
    zeros = (even == 0).sum(axis=0)
    twins = np.where(even == 0, SMALLEST_SHARE, even * (1 - SMALLEST_SHARE * zeros))[:, zeros > 0]
    interior = np.arange(even.shape[1])
    interior[zeros > 0] = even.shape[1] + np.arange(twins.shape[1])
    shares = np.concatenate([even, twins], axis=1)
    return shares, np.concatenate([interior, np.arange(even.shape[1], shares.shape[1])])


def baseline_point(exact):
    """Return the index of the point of `grid` that rules leave only for a significant gain.

    It has equal shares of the techniques whose density is known (`exact`), which are the cheap ones; of all techniques
    if fewer than two densities are known.
    """
    shares = np.array(exact if sum(exact) > 1 else [True] * len(exact), float)
    return int(np.abs(grid(len(exact))[0] - (shares / shares.sum())[:, None]).sum(axis=0).argmin())


class SimplexCurves:
    """Sums over camera samples, per pixel, of V(w) at the points of `grid`, from pilot samples at equal shares.

    `dmis.variance.curves.Curves` is the same for two techniques.

    Parameters
    ----------
    pixels
        Number of pixels of the tile.
    shading_samples
        Shading samples of each camera sample of the pilot: K S, an even number S of each technique. A final camera
        sample has S in all.
    exact
        Whether the density of each technique is known, ``(K,)``.
    """

    def __init__(self, pixels, shading_samples, exact=(True, True)):
        self._exact = exact
        self._s = shading_samples // len(exact)
        self._shares, _ = grid(len(exact))
        # cov(n_k, n_l) / S^2 of each point, as a sum of v v^T
        self._rounding = [_projections(rounding_covariance(shares, self._s)) for shares in self._shares.T]
        self._n = 0
        self._curve, self._pattern, self._second = np.zeros((3, self._shares.shape[1], pixels), np.float64)
        self._total = np.zeros(pixels, np.float64)

    def add(self, records, radiance, count):
        """Add one block: `count` camera samples of every pixel, sample-major, and their radiance ``(3, N)``."""
        self._total += summed_variance(radiance, count)
        self._n += count
        lights = list(samples_by_light(records, self._s, len(self._exact), radiance.shape[1]))
        unit = max((power_of_two_near(x) for x, _ in lights), default=np.float32(1))
        pixels = max(1, CURVE_BATCH // (len(self._exact) * self._s * count))
        for begin in range(0, len(self._total) if lights else 0, pixels):
            batch = slice(begin, begin + pixels)
            samples = [
                SamplesTowardsLight(select_pixels(x, batch, count) / unit, select_pixels(r, batch, count), self._exact)
                for x, r in lights
            ]
            self._add(samples, batch, count, float(unit) ** 2)

    def _add(self, lights, pixels, count, unit_2):
        """Add the curves of some `pixels`, from samples in units whose square is `unit_2`."""
        for g, (shares, rounding) in enumerate(zip(self._shares.T.astype(np.float32), self._rounding, strict=True)):
            means = 0
            for light in lights:
                second, mean = light.at(shares)
                # sum_k w_k m_k^2 at y
                at_y = np.einsum("k,k...->...", shares, [product_of_halves(m) for m in mean])
                # E_y[M2 - sum_k w_k m_k^2] / S
                self._second[g, pixels] += unit_2 / self._s * second.reshape(count, -1).sum(axis=0)
                self._curve[g, pixels] += unit_2 / self._s * (second - at_y).reshape(count, -1).sum(axis=0)
                means = mean + means
            # sum_kl cov(n_k, n_l) / S^2 Cov_y(m_k, m_l) = sum over v of Var_y(v . m)
            for projection in np.einsum("ek,ktn->etn", rounding, means):
                of_pixels = mean_square(projection, count) - squared_mean(projection, count)
                self._pattern[g, pixels] += unit_2 * count * of_pixels

    def sums(self):
        """Return the sums per pixel that are averaged over patches.

        ``curve`` ``(G, P)``, the square of its difference from `baseline_point` as ``gain_square``, and Var_y(I) as
        ``position`` ``(P,)``.
        """
        n = max(self._n, 1)
        techniques = len(self._exact)
        equal = baseline_point((True,) * techniques)
        at = baseline_point(self._exact)
        # Var_y(I) = the pilot's variance less its curve: that of equal shares with K S shading samples in place of S
        position = (self._total - self._curve[equal] / techniques) / n
        return with_gain_square((self._curve + self._pattern) / n, self._second / n, at) | {"position": position}


def samples_by_light(records, s, techniques, n):
    """Yield ``X = f F / q`` (the mean of its channels) and ``r_k = p_k / q`` of the pilot, one light after the other.

    q is the mean of the p_k. X is ``(S, K, N)``: S samples of each technique of N camera samples. The ratios are
    ``(S, K, K, N)``: of each sample, those of all techniques. Samples that are not recorded met no light: X is 0.
    """
    lights = {}
    for record in records:
        if record.key not in lights:
            x = np.zeros((s, techniques, n), np.float32)
            r = np.zeros((s, techniques, techniques, n), np.float32)
            r[:] = np.eye(techniques, dtype=np.float32)[..., None] * techniques
            lights[record.key] = x, r
        x, r = lights[record.key]
        where = slice(None) if record.sample is None else record.sample
        x[record.sample_index, record.technique_index, where] += record.value.mean(axis=0)
        # r_k = p_k / q,  q = sum_j p_j / K
        ratios = record.pdf / np.maximum(record.pdf.mean(axis=0), TINY)
        for k, p in enumerate(ratios):
            r[record.sample_index, record.technique_index, k, where] = p
    yield from lights.values()


class SamplesTowardsLight:
    """Estimates of M2(w) and m_k(w) from the shading samples towards one light, see `samples_by_light`."""

    def __init__(self, x, r, exact):
        self._exact = np.flatnonzero(exact)
        self._approximate = np.flatnonzero(~np.asarray(exact))
        self._x = x.swapaxes(0, 1)
        self._r = np.ascontiguousarray(r.transpose(2, 1, 0, 3))  # first axis: density, second: technique of the sample
        # p_k over the mixture of the techniques of known density, which drew their samples
        ratios = self._r[np.ix_(self._exact, self._exact)]
        mixture = np.maximum(ratios.sum(axis=0) / max(len(ratios), 1), MIN_DENSITY_RATIO)
        self._relative = ratios / mixture

    def at(self, shares):
        """Return the second moment and the means of shading samples at the `shares` ``(K,)``.

        Returns
        -------
        second
            Estimates of M2, ``(N,)``.
        means
            Estimates of m_k, ``(K, S, N)``; those of different S are independent.
        """
        techniques, rows, n = self._x.shape
        # Y = f F / p_w = X / m,  m = p_w / q = sum_k w_k r_k
        m = shares[0] * self._r[0]
        for share, r in zip(shares[1:], self._r[1:], strict=True):
            m += share * r
        y = self._x / np.maximum(m, MIN_DENSITY_RATIO, out=m)
        means = np.zeros((techniques, rows, n), np.float32)
        second = np.zeros(n, np.float32)
        # density known: m_k = E[Y p_k / mixture], M2 = sum_k w_k E[Y^2 p_k / mixture], over samples of techniques j
        for relative, k in zip(self._relative, self._exact, strict=True):
            for ratio, j in zip(relative, self._exact, strict=True):
                term = ratio * y[j]
                means[k] += term
                term *= y[j]
                second += shares[k] * term.sum(axis=0)
        means /= max(len(self._exact), 1)
        second /= max(len(self._exact), 1)
        # density not known: m_k = E_k[Y_k], M2 = sum_k w_k E_k[Y_k^2]
        for k in self._approximate:
            means[k] = y[k]
            second += shares[k] * (y[k] * y[k]).sum(axis=0)
        return second / rows, means


def _projections(covariance):
    """Return the rows v, ``(E, K)``, with which the covariance is the sum of ``v v^T``."""
    values, vectors = np.linalg.eigh(covariance)
    positive = values > 1e-9
    return (vectors[:, positive] * np.sqrt(values[positive])).T.astype(np.float32)


def rounding_covariance(shares, shading_samples):
    """Return the covariance of ``n_k / S``, the realised shares of a camera sample's S shading samples, ``(K, K)``.

    They differ from the `shares` by the systematic rounding of `dmis.estimator.allocation.systematic_counts`.
    """
    targets = np.asarray(shares, np.float64)
    covariance = np.zeros((len(targets), len(targets)))
    for probability, counts in _roundings(tuple(targets), shading_samples):
        off = np.array(counts) / shading_samples - targets
        covariance += probability * np.outer(off, off)
    return covariance


def _roundings(shares, n):
    """Yield all ways to round n times the shares, with their probabilities."""
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


# Rule -----------------------------------------------------------------------------------------------------------------


def best_points(curves, cost, guard, allowed, area):
    """Return the points of the grid, ``(rows, columns)``, for which the image's error times its time is least.

    That is ``sum V sum C`` over patches of the `area` ``(rows, columns)`` in pixels. Patches minimise ``V + price C``
    (`dmis.guarded_argmin`). At the minimum the price is ``sum V / sum C`` there, which may be far from
    that at `baseline_point`: a technique that costs twice as much may have a quarter of the variance. So prices from
    that at the baseline point downwards are tried.
    """
    variance = np.maximum(curves.variance, 0)
    baseline_price = (variance[curves.baseline] * area).sum() / area.sum() / cost[curves.baseline]
    candidates = []
    for price in baseline_price * PRICES:
        index = dmis.guarded_argmin(curves, cost, guard, allowed, price)
        error = (np.take_along_axis(variance, index[None], axis=0)[0] * area).sum()
        candidates.append((error * (cost[index] * area).sum(), index))
    return min(candidates, key=lambda candidate: candidate[0])[1]


@dataclass(frozen=True)
class Simplex(dmis.PooledRule):
    """Choose shares of several techniques that minimise variance and cost per patch.

    `dmis.fit.second_moment.SecondMoment` does the same for two, on a finer grid.

    Parameters
    ----------
    mix
        Names of the techniques, joined by ``+``.
    spp
        Samples of the pilot, at equal shares: an even multiple of K of at least 2 K, which become camera samples with
        K times the shading samples, K times fewer.
    patch, filter, size, sigma, cost, guard, reuse, combiner, sampler, compensation
        See `dmis.fit.pooling.PooledRule`; the baseline point is `baseline_point`.

    Notes
    -----
    The maps of its `Fit` are ``patch``, shares of all techniques ``(K, rows, columns)``, ``variance``, and
    ``variances`` ``(G, rows, columns)``.
    """

    mix: str = "light+brdf+resampled"
    multi_technique = True

    def __post_init__(self):
        super().__post_init__()
        names = self.techniques
        for name in names:
            technique_by_name(name)
        if len(names) < 2 or len(set(names)) < len(names):
            raise ValueError(f"mix must be two or more different techniques joined by +; got {self.mix!r}")
        if self.spp < 2 * len(names) or self.spp % 2 or self.spp % len(names):
            raise ValueError(
                f"spp of the pilot must be an even multiple of {len(names)}, the number of techniques, and at least "
                f"{2 * len(names)}; got {self.spp}"
            )

    @property
    def techniques(self):
        """Names of the techniques, in the order of the shares."""
        return tuple(self.mix.split("+"))

    @property
    def pilot(self):
        k = len(self.techniques)
        return {0.5 if k == 2 else (1 / k,) * k: self.spp}

    @property
    def statistic(self):
        """Makes the statistic that the pilot gathers."""
        return partial(SimplexCurves, exact=self._exact)

    @property
    def _exact(self):
        return tuple(technique_by_name(name).exact for name in self.techniques)

    def fit(self, pilot):
        """Return the shares of all techniques, from the pilot at equal shares."""
        (samples,) = pilot.values()
        shape = samples.mean.shape[:2]
        means, pixels = self.pooled(samples)
        shares, inside = grid(len(self.techniques))
        curves = dmis.PatchCurves(**means, pixels=pixels, baseline=baseline_point(self._exact))
        area = patch_sum(np.ones(shape), self.patch)
        # a technique may be left out where that is as good for the image as `SMALLEST_SHARE`, see `allowed_weights`
        of_image = (curves.curve * area).sum(axis=(1, 2))
        allowed = of_image <= of_image[inside]
        index = best_points(curves, self.sample_cost(samples, shares), self.guard, allowed, area)
        patches = shares[:, index]
        maps = {
            "patch": patches,
            "variance": np.maximum(np.take_along_axis(curves.variance, index[None], axis=0)[0], 0),
            "variances": curves.variance,
        }
        return dmis.Fit(np.stack([patch_spread(share, self.patch, shape) for share in patches]), maps)


dmis.register_rule("simplex", Simplex)
