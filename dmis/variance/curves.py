"""Variance V(w) of a camera sample at every share w of light samples, from one pilot (docs/theory.md, Eqs. 15 to 18).

A pilot at w = 1/2 draws from ``q = (p_l + p_b) / 2``. With ``X = f / q`` of a shading sample and
``d = (p_l - p_b) / (p_l + p_b)`` in its direction, the mixture of any weight is ``p_w = m q`` with
``m(w) = 1 + (2 w - 1) d``, so every pilot sample gives the value that it would have had at any w. Samples of both
techniques estimate the variance of both, which is what makes it work: if one technique misses a light, the samples of
the other one find it.

At a point y, where a camera sample meets the scene, let ``I(y)`` be the radiance reflected there,
``M2(y, w) = E_q[X^2 / m]`` the second moment, and ``D(y, w) = E_q[2 d X / m]`` the difference between the means of
``f / p_w`` over light samples and over BRDF samples (over both together the mean is I). With fixed shares, a shading
sample has the variance ``M2 - I^2 - w (1 - w) D^2`` at y. A camera sample takes the mean of S of them, n of which are
light samples, where n changes from one camera sample to the next so that it is ``w S`` on average. Its variance is

    V(w) = Var_y(I) + E_y[M2 - I^2 - w (1 - w) D^2] / S + var(n / S) Var_y(D).

Edges and textures are in the first term, which does not depend on w; the rest is the *curve*. Along a path I and D are
sums over its surfaces, and y stands for all of these: given them, shading samples at one do not depend on those at
another, so that curves add up, ``M2 - I^2 - w (1 - w) D^2`` of each light and surface with the path's throughput in f.
What is seen of later surfaces and what noise the path itself has is in the first term. Squares come from products of
independent estimates, those at y of two halves of the same camera sample's shading samples, so all of it is unbiased.
(Taking y for one more dimension of a shading sample would let the shading samples of a camera sample look independent,
which flatters the weights that use one technique alone.)

All this holds for the balance heuristic. Another one (`dmis.estimator.mis`) values a sample of technique i at
``c_i = f h_i``, and the same pilot gives its curve: with ``r_l = p_l / q = 1 + d``, ``r_b = p_b / q = 1 - d`` and
shares w_i,

    M2(y, w) = E_q[X^2 sum w_i r_i (q h_i)^2],  D(y, w) = E_q[X q (r_l h_l - r_b h_b)],

where ``q h_i`` is the value of the heuristic for the effective densities ``w_l r_l`` and ``w_b r_b``.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from dmis.base.vectors import TINY, Array
from dmis.estimator.mis import Combiner, balance, combiner_by_name
from dmis.estimator.patterns import SHARES
from dmis.estimator.records import Record, Wants

GRID = np.array([0, 0.03, 0.08, 0.16, 0.27, 0.38, 0.5, 0.62, 0.73, 0.84, 0.92, 0.97, 1], np.float32)
"""Shares w of light samples at which V(w) is estimated: dense at the ends, where the curves are steep."""
GRID_SHARES = np.stack([GRID, 1 - GRID])
"""Shares of both techniques at `GRID`, shape (2, G)."""
HALF = int(np.flatnonzero(GRID == 0.5)[0])
"""Index of w = 1/2 in `GRID`."""
MIN_DENSITY_RATIO = np.float32(1e-9)
"""Lower bound of the ratios p_w / q and p_i / q, so that divisions by them stay finite."""
CURVE_BATCH = 2**16
"""Shading samples, about, whose curves are computed in one batch, so that their arrays stay in the cache."""
CURVE_ROUNDING = 3e-5
"""Rounding error of a pixel's curve, as a share of its second moment. A curve is the difference of float32 sums, each
of which is off by 1e-6 or less; the error may be the same in all pixels, so it is assumed to be larger, because
averaging over pixels does not remove it.
"""


class Curves:
    """Sums over camera samples, per pixel, of the curves V(w) at shares of a grid, from pilot samples at w = 1/2.

    Parameters
    ----------
    pixels
        Number of pixels of the tile.
    shading_samples
        Shading samples of each camera sample of the pilot, a multiple of 4; a final camera sample has S, half as many.
    combiner
        Heuristic of the final samples, whose curves are estimated, by name; the pilot uses the balance heuristic.
    grid
        Shares w from 0 to 1, both included, and 1/2 among them, ``(G,)`` ascending.
    """

    def __init__(self, pixels: int, shading_samples: int, combiner: str = "balance", grid: Array = GRID) -> None:
        self._s = shading_samples // 2
        self._n = 0
        self._combiner = combiner_by_name(combiner)
        self._grid = grid
        self._half = int(np.flatnonzero(grid == 0.5)[0])
        self._w_times_rest = (grid * (1 - grid))[:, None].astype(np.float64)
        self._rounding_variance = share_variance(self._s, grid)
        self._curve, self._pattern, self._second = np.zeros((3, len(grid), pixels), np.float64)
        self._total, self._pilot = np.zeros((2, pixels), np.float64)

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block: `count` camera samples of every pixel, sample-major, and their radiance ``(3, N)``."""
        self._total += summed_variance(radiance, count)
        self._n += count
        lights = list(samples_by_light(records, 2 * self._s, radiance.shape[1]))
        if not lights:
            return
        unit = max(power_of_two_near(x) for x, _ in lights)
        pixels = len(self._total)
        blocks = max(1, round(pixels * 2 * self._s * count / CURVE_BATCH))
        for begin, end in itertools.pairwise(np.linspace(0, pixels, blocks + 1, dtype=int)):
            batch = slice(begin, end)
            samples = [(select_pixels(x, batch, count) / unit, select_pixels(d, batch, count)) for x, d in lights]
            self._add(samples, batch, count, float(unit) ** 2)

    def _add(self, samples: Sequence[tuple[Array, Array]], pixels: slice, count: int, unit_2: float) -> None:
        """Add the curves of some `pixels`, from X and d towards each light.

        X is given in units whose square is `unit_2`.
        """
        scale = count * unit_2
        lights = [_SamplesTowardsLight(x, d, count, self._combiner) for x, d in samples]
        # I^2 of each light, summed
        radiance_2 = sum(light.radiance_2 for light in lights)
        second, squared, pattern = np.zeros((3, len(self._grid), pixels.stop - pixels.start))
        # M2(0) and M2(1): of one technique alone, all heuristics are the same
        for end in (0, -1):
            second[end] = sum(light.single_technique(self._grid[end]) for light in lights)
        for g, w in enumerate(self._grid[1:-1].astype(float), 1):
            # M2(w) and E_y[D^2], summed over the lights
            second_moments, differences = zip(*(light.moments(w) for light in lights), strict=True)
            second[g] = sum(second_moments)
            squared[g] = sum(mean_square(d, count) for d in differences)
            # Var_y(D) = E_y[D^2] - E_y[D]^2, where D is that of all lights together
            total = sum(differences[1:], differences[0])
            pattern[g] = squared[g] if len(lights) == 1 else mean_square(total, count)
            pattern[g] -= squared_mean(total, count)
        # E_y[M2 - I^2 - w (1 - w) D^2] / S
        self._second[:, pixels] += scale / self._s * second
        self._curve[:, pixels] += scale / self._s * (second - radiance_2 - self._w_times_rest * squared)
        self._pattern[:, pixels] += scale * pattern
        # the same of the pilot: the balance heuristic at w = 1/2
        self._pilot[pixels] += scale / self._s * sum(light.pilot_variance() for light in lights)

    def sums(self) -> dict[str, Array]:
        """Return the sums per pixel that `dmis.fit.pooling.PatchCurves` averages over patches.

        ``curve`` ``(G, P)``, its squared gain over w = 1/2, see `with_gain_square`, Var_y(D) as ``pattern``
        ``(G, P)``, and Var_y(I) as ``position`` ``(P,)``.
        """
        n = max(self._n, 1)
        pattern = self._pattern / n
        # E_y[M2 - I^2 - w (1 - w) D^2] / S + var(n / S) Var_y(D)
        curve = self._curve / n + self._rounding_variance[:, None] * pattern
        # Var_y(I) = the pilot's variance less its curve: V(1/2) of balance with 2 S shading samples in place of S
        position = self._total / n - self._pilot / n / 2
        return with_gain_square(curve, self._second / n, self._half) | {"pattern": pattern, "position": position}


class PatternCurves(Curves):
    """Sums of the curves at the shares of `dmis.estimator.patterns.PATTERNS`, whose counts need no rounding.

    Sums are kept apart by the colour of the pixels (`dmis.base.patches.COLOURS`): what is decided for the pixels of a
    colour comes from the others' samples, so that a pixel's own may be part of its image.

    Parameters
    ----------
    pixels, shading_samples, combiner
        See `Curves`.
    lights
        L, number of lights whose variances are kept separately, see `dmis.estimator.patterns`; 0: none.
    """

    wants = Wants(sums="colours")

    def __init__(self, pixels: int, shading_samples: int, combiner: str = "balance", lights: int = 0) -> None:
        super().__init__(pixels, shading_samples, combiner, SHARES)
        self._lights = np.zeros((lights + 1, pixels)) if lights else None
        self._rounding_variance = np.zeros(len(SHARES))

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block, as `Curves.add` does."""
        super().add(records, radiance, count)
        if self._lights is not None:
            *lights, rest = self._lights
            left = radiance.copy()
            for total, of_light in zip(lights, self._take_lights(records, len(lights), left), strict=True):
                total += summed_variance(of_light, count)
            rest += summed_variance(left, count)

    def _take_lights(self, records: Sequence[Record], lights: int, radiance: Array) -> Array:
        """Return what the first surface reflects of each light, ``(L, 1, N)``, and take it from `radiance`."""
        of_lights = np.zeros((lights, 1, radiance.shape[1]), np.float32)
        for record in records:
            if len(record.key) == 1 and record.key[0] < lights:
                where = slice(None) if record.sample is None else record.sample
                value = record.value / np.float32(2 * self._s)
                radiance[:, where] -= value
                of_lights[record.key[0], 0, where] += value.mean(axis=0)
        return of_lights

    def sums(self) -> dict[str, Array]:
        """Return the sums per pixel, see `Curves.sums`.

        Those of rounding are left out. In their place is `lights`, the variance of what the first surface reflects of
        each light, and of all the rest, ``(L + 1, P)``.
        """
        sums = super().sums()
        del sums["pattern"]
        lights = {} if self._lights is None else {"lights": self._lights / max(self._n, 1)}
        return sums | lights


def summed_variance(radiance: Array, count: int) -> Array:
    """Return `count` times the variance of the camera samples ``(3, count * P)`` of each pixel, ``(P,)``.

    A ValueError if there are fewer than two camera samples.
    """
    if count < 2:
        raise ValueError(f"curves need at least two camera samples, because they are variances; got {count}")
    return np.asarray(count * radiance.mean(axis=0).reshape(count, -1).var(axis=0, ddof=1))


def with_gain_square(curve: Array, second: Array, baseline: int) -> dict[str, Array]:
    """Return a `curve` ``(G, P)``, and the square of its difference from the `baseline` point as ``gain_square``.

    Where all samples are alike, a curve is rounding error, which must not be taken for a gain: squares have that of the
    `second` moment ``(G, P)`` at both points, too.
    """
    rounding_2 = np.square(CURVE_ROUNDING * second)
    gain_square = np.square(curve - curve[baseline]) + rounding_2 + rounding_2[baseline]
    gain_square[baseline] = 0
    return {"curve": curve, "gain_square": gain_square}


def samples_by_light(records: Sequence[Record], shading_samples: int, n: int) -> Iterator[tuple[Array, Array]]:
    """Yield X (the mean of its channels) and d of all shading samples, one light after the other.

    Both are ``(S / 2, 2, N)``: pairs of a light and a BRDF sample of N camera samples. Samples without a record have
    the values of `unrecorded_samples`.
    """
    lights: dict[tuple[int, ...], tuple[Array, Array]] = {}
    for record in records:
        if record.key not in lights:
            lights[record.key] = unrecorded_samples(shading_samples, n)
        x, d = lights[record.key]
        where = slice(None) if record.sample is None else record.sample
        at = record.sample_index, record.technique_index, where
        x[at] += record.value.mean(axis=0)
        # d = (p_l - p_b) / (p_l + p_b)
        d[at] = (record.pdf[0] - record.pdf[1]) / np.maximum(record.pdf[0] + record.pdf[1], TINY)
    yield from lights.values()


def unrecorded_samples(shading_samples: int, n: int) -> tuple[Array, Array]:
    """Return X and d of shading samples that are not recorded, because they meet no light that the surface reflects.

    Both are ``(S / 2, 2, N)``. X is 0. d is 1 for light samples (they point below the surface: p_b = 0) and -1 for BRDF
    samples (p_l = 0).
    """
    x, d = np.zeros((2, shading_samples // 2, 2, n), np.float32)
    d[:, 0] = 1
    d[:, 1] = -1
    return x, d


def select_pixels(a: Array, pixels: slice, count: int) -> Array:
    """Return the samples of some pixels, from samples ``(..., count * P)`` in sample-major order."""
    return a.reshape(*a.shape[:-1], count, -1)[..., pixels].reshape(*a.shape[:-1], -1)


def share_variance(s: float, grid: Array = GRID) -> Array:
    """Return var(n / S) at the shares of a grid, ``(G,)``, where n is w S, rounded down or up."""
    # n is floor(w S) + 1 with probability r, the fractional part of w S, so that var(n) = r (1 - r)
    fraction = grid.astype(np.float64) * s % 1
    return fraction * (1 - fraction) / s**2


def power_of_two_near(x: Array) -> np.float32:
    """Return a power of two near the largest ``|x|``: in units of it, squares of small numbers are not 0 in float32."""
    return np.float32(2.0 ** np.floor(np.log2(max(float(x.max()), float(-x.min()), 1e-37))))


class _SamplesTowardsLight:
    """Estimates of I^2, M2(w) and D(w) from the shading samples towards one light, see `samples_by_light`.

    Second moments M2 are ``(P,)``, of P pixels; differences D are estimated by each pair, ``(S / 2, N)``.
    """

    def __init__(self, x: Array, d: Array, count: int, combiner: Combiner) -> None:
        self._x = x
        self._d = d
        self._count = count
        self._combiner = combiner
        self._x_2 = x * x
        self._x_d = x * d
        # I(y) is estimated by the mean X of a pair
        self.radiance_2 = mean_square(x.mean(axis=1), count)
        if combiner.heuristic is not balance:
            # r_l = p_l / q = 1 + d,  r_b = p_b / q = 1 - d
            r_l, r_b = (np.maximum(r, MIN_DENSITY_RATIO) for r in (1 + d, 1 - d))
            self._x_l = x / np.sqrt(r_l)
            self._x_b = x / np.sqrt(r_b)
            self._pairs = x[:, 0] + x[:, 1]
            # p_b / p_l = (1 - d) / (1 + d)
            self._ratio = (1 - d) / r_l

    def single_technique(self, w: float) -> Array:
        """Return M2 of one technique alone, at w = 0 or 1."""
        # M2(w) = E_q[X^2 / m(w)],  m(w) = p_w / q = 1 + (2 w - 1) d
        m = np.maximum(1 + self._d * np.float32(2 * w - 1), MIN_DENSITY_RATIO)
        return _mean(self._x_2 / m, self._count)

    def pilot_variance(self) -> Array:
        """Return the variance at y of a shading sample of the pilot, balance at w = 1/2, ``(P,)``."""
        # M2 - I^2 - w (1 - w) D^2 at w = 1/2
        second, difference = self._balance_moments(0.5)
        return np.asarray(second - self.radiance_2 - mean_square(difference, self._count) / 4, np.float64)

    def moments(self, w: float) -> tuple[Array, Array]:
        """Return M2 and D of the heuristic at w, between 0 and 1."""
        return self._balance_moments(w) if self._combiner.heuristic is balance else self._heuristic_moments(w)

    def _balance_moments(self, w: float) -> tuple[Array, Array]:
        """Return M2 and D of the balance heuristic."""
        # m(w) = p_w / q = 1 + (2 w - 1) d
        m = self._d * np.float32(2 * w - 1)
        m += 1
        one_over_m = np.reciprocal(m, out=m)
        # M2(w) = E_q[X^2 / m]
        second = _mean(self._x_2 * one_over_m, self._count)
        # D(w) = E_q[2 d X / m]: the sum over a pair, because its mean has the factor 2
        one_over_m *= self._x_d
        return second, one_over_m[:, 0] + one_over_m[:, 1]

    def _heuristic_moments(self, w: float) -> tuple[Array, Array]:
        """Return M2 and D of any heuristic, from its MIS weights W_l and W_b = 1 - W_l.

        A sample of technique i has the value ``f h_i``, where ``q h_i = W_i / (w_i r_i)``.
        """
        # W_l depends on (1 - w) p_b / (w p_l) alone
        densities = [np.ones_like(self._ratio), self._ratio * np.float32((1 - w) / w)]
        weight_l = self._combiner.heuristic(densities, 0)
        weighted = self._x * weight_l
        # D = E_q[X (W_l / w - W_b / (1 - w))] = E_q[X (W_l / w - 1)] / (1 - w), where a pair is the mean of two
        difference = weighted[:, 0] + weighted[:, 1]
        difference *= np.float32(1 / w)
        difference -= self._pairs
        difference *= np.float32(0.5 / (1 - w))
        weight_b = np.subtract(1, weight_l, out=weighted)
        # M2 = E_q[X^2 W_l^2 / r_l] / w + E_q[X^2 W_b^2 / r_b] / (1 - w)
        for weight, x_i in ((weight_l, self._x_l), (weight_b, self._x_b)):
            weight *= x_i
            weight *= weight
        second = _mean(weight_l, self._count) / np.float32(w) + _mean(weight_b, self._count) / np.float32(1 - w)
        return second, difference


def _mean(values: Array, count: int) -> Array:
    """Return the mean over the shading samples of each pixel, ``(P,)``, of values ``(S / 2, 2, N)``."""
    rows = values.reshape(-1, values.shape[2] // count)
    return np.asarray(np.add.reduce(rows, axis=0) / np.float32(len(rows)))


def mean_square(pairs: Array, count: int) -> Array:
    """Return E_y[D^2] of each pixel, ``(P,)``, where independent pairs ``(S / 2, N)`` estimate D at y."""
    return np.asarray(np.add.reduce(product_of_halves(pairs).reshape(count, -1), axis=0) / np.float32(count))


def squared_mean(pairs: Array, count: int) -> Array:
    """Return E_y[D]^2 of each pixel, ``(P,)``, from products of different camera samples."""
    # sum over i != j of D_i D_j = (sum_i D_i)^2 - sum_i D_i^2
    at_y = np.add.reduce(pairs, axis=0).reshape(count, -1)
    products = np.add.reduce(at_y, axis=0)
    products *= products
    at_y *= at_y
    products -= np.add.reduce(at_y, axis=0)
    return np.asarray(products / np.float32(len(pairs) ** 2 * count * (count - 1)))


def product_of_halves(pairs: Array) -> Array:
    """Return the product of the means of two halves of independent estimates ``(S / 2, N)``: an unbiased square."""
    if len(pairs) == 2:
        return np.asarray(pairs[0] * pairs[1])
    return pairs[::2].mean(axis=0) * pairs[1::2].mean(axis=0)
