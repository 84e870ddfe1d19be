"""Variance against the weight: one pilot tells it for every w at once.

A pilot at w = 1/2 draws from ``q = (p_l + p_b) / 2``. With ``X = f / q`` of a shading sample and
``d = (p_l - p_b) / (p_l + p_b)`` in its direction, the mixture of any weight is ``p_w = m q`` with
``m(w) = 1 + (2 w - 1) d``, so every pilot sample says what it would have contributed at any w. Both techniques'
samples tell of both, which is what makes it work: a technique that fails is known by what the other one sees.

At a point y, where a camera sample meets the scene, let ``I(y)`` be the radiance reflected there,
``M2(y, w) = E_q[X^2 / m]`` the second moment, and ``D(y, w) = E_q[2 d X / m]`` the difference between the means of
``f / p_w`` over light samples and over BRDF samples (over both together the mean is I). With fixed shares, a shading
sample has the variance ``M2 - I^2 - w (1 - w) D^2`` at y. A camera sample takes the mean of S of them, n of which are
light samples, where n changes from one camera sample to the next so that it is ``w S`` on average. Its variance is

    V(w) = Var_y(I) + E_y[M2 - I^2 - w (1 - w) D^2] / S + var(n / S) Var_y(D).

Edges and textures are in the first term, which does not depend on w; the rest is the *curve*. Along a path I and D are
sums over its surfaces, and y stands for all of these: given them, shading samples at one do not depend on those at
another, so that curves add up, ``M2 - I^2 - w (1 - w) D^2`` of each light and surface with the path's throughput in f.
What is seen of later surfaces and what noise the path itself has is in the first term. If the surface that the camera
sees (class 0) and those behind it (class 1) have weights of their own, so has V a curve for each: nothing of one
depends on the other's, whose rounding has its own offset. Squares come from
products of independent estimates, those at y of two halves of the same camera sample's shading samples, so all of it
is unbiased. (Taking y for one more dimension of a shading sample would let the shading samples of a camera sample look
independent, which flatters the weights that use one technique alone.)

All this is of the balance heuristic. Another one (`dmis.mis`) makes ``c_i = f h_i`` of a sample of technique i, and the
same pilot tells its curve: with ``r_l = p_l / q = 1 + d``, ``r_b = p_b / q = 1 - d`` and shares w_i,

    M2(y, w) = E_q[X^2 sum w_i r_i (q h_i)^2],  D(y, w) = E_q[X q (r_l h_l - r_b h_b)],

where ``q h_i`` is what the heuristic makes of the effective densities ``w_l r_l`` and ``w_b r_b``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from dmis import mis
from dmis.batch import Record
from dmis.vec import TINY, Array, Index, Selection, compose, indices, size, take

GRID = np.array([0, 0.03, 0.08, 0.16, 0.27, 0.38, 0.5, 0.62, 0.73, 0.84, 0.92, 0.97, 1], np.float32)
"""Weights at which curves are known: dense at the ends, where they are steep."""
APART = (GRID * (1 - GRID))[:, None].astype(np.float64)
"""w (1 - w) at these weights."""
HALF = int(np.flatnonzero(GRID == 0.5)[0])
LEAST = np.float32(1e-9)
TOGETHER = 2**16
"""Shading samples, about, whose values at all weights are worked out together: they stay in the cache."""
GATHERED = 0.75
"""Share of lit pixels from which on no time is saved by leaving out the others."""
ROUNDING = 3e-5
"""Of a pixel's curve, as a share of its second moment. A curve is the difference of float32 sums, each of which is off
by 1e-6 or less; that may be the same in all pixels, so it is taken to be more, and something is left of it in means.
"""


class Curves:
    """Sums over pixels of variances at the weights of `GRID`, from pilot samples at w = 1/2.

    Parameters
    ----------
    pixels
        Number of pixels of the tile.
    shading_samples
        Of each camera sample of the pilot, a multiple of 4; final camera samples have S, half as many.
    classes
        How many curves: of the first surfaces of paths one by one, and in the last of all others together.
    combiners
        Heuristics of the final samples that there should be curves of, see `dmis.mis.find`; the pilot's is balance.
    """

    def __init__(
        self, pixels: int, shading_samples: int, classes: int = 1, combiners: Sequence[str] = ("balance",)
    ) -> None:
        self._s = shading_samples // 2
        self._n = 0
        self._combiners = tuple(combiners)
        self._curve, self._pattern, self._second = np.zeros((3, len(combiners), classes, len(GRID), pixels), np.float64)
        self._total, self._own = np.zeros((2, pixels), np.float64)

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block: `count` camera samples of every pixel, sample-major, and their radiance ``(3, N)``."""
        if count < 2:
            raise ValueError(f"curves need at least two camera samples, because they are variances; got {count}")
        self._n += count
        grey = radiance.mean(axis=0).reshape(count, -1)
        self._total += count * grey.var(axis=0, ddof=1)
        last = self._curve.shape[1] - 1
        for k in range(last + 1):
            mine = [record for record in records if min(record.depth, last) == k]
            lights = list(spread(mine, 2 * self._s, radiance.shape[1]))
            if not lights:
                continue
            unit = max(power_near(x) for x, _ in lights)
            lit = _lit([x for x, _ in lights], count)
            pixels = size(lit, len(self._total))
            if not pixels:
                continue
            blocks = max(1, round(pixels * 2 * self._s * count / TOGETHER))
            for begin, end in itertools.pairwise(np.linspace(0, pixels, blocks + 1, dtype=int)):
                part = compose(lit, slice(begin, end))
                assert part is not None
                some = [(of_pixels(x, part, count) / unit, of_pixels(d, part, count)) for x, d in lights]
                self._add(some, k, part, count, float(unit) ** 2)

    def _add(self, lights: Sequence[tuple[Array, Array]], k: int, part: Selection, count: int, unit_2: float) -> None:
        """Add what some pixels have seen at surfaces of class k, in units whose square is `unit_2`."""
        scale, seen = count * unit_2, [_Seen(x, d, count) for x, d in lights]
        radiance_2 = sum(light.radiance_2 for light in seen)
        second, squared, pattern = np.zeros((3, len(GRID), size(part, len(self._total))))
        for end in (0, -1):  # of one technique alone, all heuristics are this
            second[end] = sum(light.alone(GRID[end]) for light in seen)
        for h, combiner in enumerate(self._combiners):
            moments = [light.moments(combiner) for light in seen]
            for g, w in enumerate(GRID[1:-1].astype(float), 1):
                found, differences = zip(*(at(w) for at in moments), strict=True)
                second[g] = sum(found)
                squared[g] = sum(_squared(d, count) for d in differences)
                whole = sum(differences[1:], differences[0])  # all lights together
                pattern[g] = squared[g] if len(seen) == 1 else _squared(whole, count)
                pattern[g] -= _across(whole, count)
            self._second[h, k][:, part] += scale / self._s * second
            self._curve[h, k][:, part] += scale / self._s * (second - radiance_2 - APART * squared)
            self._pattern[h, k][:, part] += scale * pattern
        # of the pilot itself: the balance heuristic at w = 1/2
        self._own[part] += scale / self._s * sum(light.of_pilot() for light in seen)

    def sums(self) -> dict[str, Array]:
        """Per pixel, to be added up over patches: what `dmis.pooled.Pooled` is made of.

        ``curve`` ``(G, P)``, its square and its product with itself at w = 1/2, Var_y(D) as ``pattern`` ``(G, P)``,
        and Var_y(I) as ``position`` ``(P,)``. If there are several combiners, all but ``position`` have one more axis
        in front, and behind that another if there are several classes.
        """
        n = max(self._n, 1)
        pattern, seen = self._pattern / n, self._total / n
        curve = self._curve / n + share_variance(self._s)[:, None] * pattern
        half = curve[..., HALF : HALF + 1, :]
        # where all samples are alike curves are rounding, which must not pass for a gain
        rounding = ROUNDING * self._second / n
        square, cross = curve * curve + rounding * rounding, curve * half
        cross[..., HALF, :] = square[..., HALF, :]
        one = tuple(axis for axis in (0, 1) if curve.shape[axis] == 1)
        found = {"curve": curve, "square": square, "cross": cross, "pattern": pattern}
        sums = {name: a.squeeze(one) for name, a in found.items()}
        # the pilot's own variance is V(1/2) of balance with 2 S shading samples in place of S
        return {**sums, "position": seen - self._own / n / 2}


def spread(records: Sequence[Record], shading_samples: int, n: int) -> Iterator[tuple[Array, Array]]:
    """X, as the mean of the channels, and d of all shading samples towards one light after the other.

    Both are ``(S / 2, 2, N)``: pairs of a light and a BRDF sample of N camera samples, see `nothing`.
    """
    found: dict[tuple[int, ...], tuple[Array, Array]] = {}
    for record in records:
        if record.key not in found:
            found[record.key] = nothing(shading_samples, n)
        x, d = found[record.key]
        where = slice(None) if record.sample is None else record.sample
        at = record.turn, record.side, where
        x[at] += record.value.mean(axis=0)
        d[at] = (record.pdf[0] - record.pdf[1]) / np.maximum(record.pdf[0] + record.pdf[1], TINY)
    yield from found.values()


def nothing(shading_samples: int, n: int) -> tuple[Array, Array]:
    """X and d of shading samples whose directions meet no light that the surface could reflect, which are not recorded.

    X is 0. d is 1 for light samples (they point below the surface: p_b = 0) and -1 for BRDF samples (p_l = 0).
    """
    x, d = np.zeros((2, shading_samples // 2, 2, n), np.float32)
    d[:, 0], d[:, 1] = 1, -1
    return x, d


def _lit(values: Sequence[Array], count: int) -> Index | None:
    """Pixels of which some sample ``(S / 2, 2, count * P)`` is not 0; the curves of all others are 0. None: not worth
    to be gathered.
    """
    some = np.any([x.any(axis=(0, 1)).reshape(count, -1).any(axis=0) for x in values], axis=0)
    return indices(some) if np.count_nonzero(some) < GATHERED * len(some) else None


def of_pixels(a: Array, pixels: Selection, count: int) -> Array:
    """What is of some pixels, of samples ``(..., count * P)``."""
    return take(a.reshape(*a.shape[:-1], count, -1), pixels).reshape(*a.shape[:-1], -1)


def share_variance(s: float) -> Array:
    """var(n / S) at the weights of the grid, ``(G,)``: n is w S, rounded down or up."""
    part = GRID.astype(np.float64) * s % 1
    return part * (1 - part) / s**2


def power_near(x: Array) -> np.float32:
    """A power of two near the largest of them: in units of it squares of small numbers are not 0 in float32."""
    return np.float32(2.0 ** np.floor(np.log2(max(float(x.max()), float(-x.min()), 1e-37))))


class _Seen:
    """Shading samples towards one light, as `spread` yields them: what they say of any weight.

    Second moments M2 are ``(P,)``, of P pixels; differences D are those of pairs, ``(S / 2, N)``.
    """

    def __init__(self, x: Array, d: Array, count: int) -> None:
        self._x, self._d, self._count = x, d, count
        self._square, self._first = x * x, x * d
        self.radiance_2 = _squared(x.mean(axis=1), count)

    def moments(self, combiner: str) -> Callable[[float], tuple[Array, Array]]:
        """M2 and D of a heuristic, at any w between 0 and 1."""
        return self._balance if mis.find(combiner) is mis.balance else self._heuristic(combiner)

    def alone(self, w: float) -> Array:
        """M2 of one technique alone: at w = 0 or 1."""
        m = np.maximum(1 + self._d * np.float32(2 * w - 1), LEAST)
        return _mean(self._square / m, self._count)

    def of_pilot(self) -> Array:
        """Variance of a shading sample of the pilot, balance at w = 1/2, at y: ``(P,)``."""
        second, difference = self._balance(0.5)
        return np.asarray(second - self.radiance_2 - _squared(difference, self._count) / 4, np.float64)

    def _balance(self, w: float) -> tuple[Array, Array]:
        m = self._d * np.float32(2 * w - 1)
        m += 1
        over_m = np.reciprocal(m, out=m)
        second = _mean(self._square * over_m, self._count)
        over_m *= self._first
        return second, over_m[:, 0] + over_m[:, 1]

    def _heuristic(self, combiner: str) -> Callable[[float], tuple[Array, Array]]:
        light_weight = _light_weight(self._d, combiner)
        over_l, over_b = (self._x / np.sqrt(np.maximum(r, LEAST)) for r in (1 + self._d, 1 - self._d))
        pairs = self._x[:, 0] + self._x[:, 1]

        def at(w: float) -> tuple[Array, Array]:
            light = light_weight(w)
            counted = self._x * light
            # D of a pair is the sum of X (light / w - brdf / (1 - w)) / 2
            difference = counted[:, 0] + counted[:, 1]
            difference *= np.float32(1 / w)
            difference -= pairs
            difference *= np.float32(0.5 / (1 - w))
            brdf = np.subtract(1, light, out=counted)  # the weight of BRDF samples
            for weight, over in ((light, over_l), (brdf, over_b)):
                weight *= over
                weight *= weight
            return _mean(light, self._count) / np.float32(w) + _mean(brdf, self._count) / np.float32(1 - w), difference

        return at


def _light_weight(d: Array, combiner: str) -> Callable[[float], Array]:
    """The MIS weight of light samples in the directions of which d is known, at any w: it depends on nothing but the
    ratio of the effective densities. BRDF samples have the rest.
    """
    ratio = (1 - d) / np.maximum(1 + d, LEAST)
    heuristic, beta = mis.find(combiner), mis.exponent(combiner)
    if beta is None or beta > 3:  # whose powers of ratios may be beyond float32
        return lambda w: heuristic([np.ones_like(ratio), ratio * np.float32((1 - w) / w)], 0)
    raised = ratio * ratio if beta == 2 else ratio ** np.float32(beta)
    return lambda w: 1 / (1 + raised * np.float32(((1 - w) / w) ** beta))


def _mean(values: Array, count: int) -> Array:
    """Mean over the shading samples of each pixel, of values ``(S / 2, 2, N)``."""
    rows = values.reshape(-1, values.shape[2] // count)
    return np.asarray(np.add.reduce(rows, axis=0) / np.float32(len(rows)))


def variation(difference: Array, count: int) -> Array:
    """Variance of D over y, ``(P,)``, from that of pairs ``(S / 2, N)``."""
    return _squared(difference, count) - _across(difference, count)


def _squared(pairs: Array, count: int) -> Array:
    """Mean square over the camera samples of each pixel, of what independent pairs ``(S / 2, N)`` estimate at y."""
    return np.asarray(np.add.reduce(product(pairs).reshape(count, -1), axis=0) / np.float32(count))


def _across(pairs: Array, count: int) -> Array:
    """Square of its mean, from products of different camera samples."""
    at_y = np.add.reduce(pairs, axis=0).reshape(count, -1)
    everywhere = np.add.reduce(at_y, axis=0)
    everywhere *= everywhere
    at_y *= at_y
    everywhere -= np.add.reduce(at_y, axis=0)
    return np.asarray(everywhere / np.float32(len(pairs) ** 2 * count * (count - 1)))


def product(pairs: Array) -> Array:
    """Product of the means of two halves of independent estimates ``(S / 2, N)``."""
    if len(pairs) == 2:
        return np.asarray(pairs[0] * pairs[1])
    return pairs[::2].mean(axis=0) * pairs[1::2].mean(axis=0)
