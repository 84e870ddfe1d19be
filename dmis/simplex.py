"""Weights of K techniques, points of the simplex, from one pilot: what `dmis.curves` and `dmis.learned` do for two.

Techniques k = 1..K with shares w_k of sum 1 and densities p_k are mixed by the balance heuristic: a sample of k counts
``Y_k = f F_k / p_w``, ``p_w = sum_j w_j p_j``. F_k is 1, but for techniques whose density is not known
(`dmis.resampling`): there p_k is what stands in for it, and F_k makes up for that. With

    m_k(w) = E_k[Y_k],  M2(w) = sum_k w_k E_k[Y_k^2],  sum_k w_k m_k = I

a shading sample has the variance ``M2 - sum_k w_k m_k^2`` at a point y, numbers being fixed: the variance within each
technique, which is ``M2 - I^2 - w (1 - w) D^2`` for two. A camera sample takes the mean of S of them, n_k of technique
k, where n_k is rounded up or down (`dmis.mis.rounding`), so that

    V(w) = Var_y(I) + E_y[M2 - sum_k w_k m_k^2] / S + sum_kl cov(n_k, n_l) / S^2 Cov_y(m_k, m_l).

A pilot at equal shares tells all of that for every w. Where the density is known, E_k may be taken over the samples of
all such techniques, weighed by p_k over their mixture: so a technique that fails is known by what others see. One whose
density is not known is known by its own samples alone: ``E_k[Y_k]`` is their mean.

If all densities are known M2 is ``integral of f^2 / p_w``, convex in w, with one minimum. V and a stand-in's M2 need
not be, so the least value on a grid is taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from dmis import mis, technique
from dmis.batch import Record
from dmis.cost import camera_sample
from dmis.curves import LEAST, ROUNDING, TOGETHER, of_pixels, power_near, product, variation
from dmis.fit import Fit, Pilot, Weight, of_final
from dmis.pooled import Pooled, least
from dmis.sharing import check_sharing, pool
from dmis.shrinkage import shrink
from dmis.tile import BASE, Statistic
from dmis.variance import patch_mean, patch_spread, patch_sum, row_blocks
from dmis.vec import TINY, Array

STEPS = 6
"""At most so many steps of the grid from one technique alone to another; a multiple of K, to have equal shares."""
FLOOR = 0.03
"""Share of a technique in those points of the grid that only just do not leave it out."""
PRICES = 2.0 ** -np.arange(6)
"""Of cost in variance, times that at `home`."""


@cache
def grid(techniques: int) -> tuple[Array, np.ndarray]:
    """Shares at which V is known, ``(K, G)``: even steps over the simplex; and points that leave techniques out once
    more, with the share `FLOOR` for these.

    Returns with them where the latter are for each point, ``(G,)``; itself for those that leave out none.
    """
    steps = techniques * (STEPS // techniques)
    parts = itertools.product(range(steps + 1), repeat=techniques)
    even = np.array([p for p in parts if sum(p) == steps]).T / steps
    out = (even == 0).sum(axis=0)
    twins = np.where(even == 0, FLOOR, even * (1 - FLOOR * out))[:, out > 0]
    inside = np.arange(even.shape[1])
    inside[out > 0] = even.shape[1] + np.arange(twins.shape[1])
    every = np.concatenate([even, twins], axis=1)
    return every, np.concatenate([inside, np.arange(even.shape[1], every.shape[1])])


def home(exact: Sequence[bool]) -> int:
    """The point of the grid that is left only for a sure gain: equal shares of the techniques of known density, which
    are the cheap ones; of all techniques if fewer than two are `exact`.
    """
    shares = np.array(exact if sum(exact) > 1 else [True] * len(exact), float)
    return int(np.abs(grid(len(exact))[0] - (shares / shares.sum())[:, None]).sum(axis=0).argmin())


def allowed(curve: Array, inside: np.ndarray) -> np.ndarray:
    """Which points of the grid may be used, ``(G,)`` bool, by the curve of the whole image ``(G,)``: those that leave
    techniques out only if they are as good for the image as those that just do not, see `dmis.pooled.allowed`.
    """
    return curve <= curve[inside]


def cheapest(curves: Pooled, cost: Array, guard: float, may: np.ndarray, area: Array) -> np.ndarray:
    """Points of the grid, ``(rows, columns)``, for which the image's error times its time is least, ``sum V sum C``
    over patches of the `area` ``(rows, columns)`` in pixels.

    Patches minimise ``V + price C`` (`dmis.pooled.weighed`). At the minimum the price is ``sum V / sum C`` there, which
    may be far from that at `home`: a technique that costs twice as much may have a quarter of the variance.
    So prices from that at home downwards are tried.
    """
    variance = np.maximum(curves.variance, 0)
    home_price = (variance[curves.half] * area).sum() / area.sum() / cost[curves.half]
    found = []
    for price in home_price * PRICES:
        index = np.concatenate([least(curves.rows(rows), cost, guard, may, price) for rows in row_blocks(len(area))])
        error = (np.take_along_axis(variance, index[None], axis=0)[0] * area).sum()
        found.append((error * (cost[index] * area).sum(), index))
    return min(found, key=lambda one: one[0])[1]


class Shares:
    """Sums over pixels of V at the shares of `grid`, from pilot samples at equal shares: see `dmis.curves.Curves`.

    Parameters
    ----------
    pixels
        Number of pixels of the tile.
    shading_samples
        Of each camera sample of the pilot, K S, S of each technique, an even number; final ones have S in all.
    exact
        Of which techniques the densities are known, ``(K,)``.
    """

    def __init__(self, pixels: int, shading_samples: int, exact: tuple[bool, ...] = (True, True)) -> None:
        self._exact, self._s = exact, shading_samples // len(exact)
        self._shares, _ = grid(len(exact))
        self._uneven = [_projections(mis.rounding(shares, self._s)) for shares in self._shares.T]
        self._n = 0
        self._curve, self._pattern, self._second = np.zeros((3, self._shares.shape[1], pixels), np.float64)
        self._total = np.zeros(pixels, np.float64)

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """See `dmis.tile.Statistic.add`."""
        if count < 2:
            raise ValueError(f"shares need at least two camera samples, because variances do; got {count}")
        self._n += count
        grey = radiance.mean(axis=0).reshape(count, -1)
        self._total += count * grey.var(axis=0, ddof=1)
        lights = list(spread(records, self._s, len(self._exact), radiance.shape[1]))
        unit = max((power_near(x) for x, _ in lights), default=np.float32(1))
        pixels = max(1, TOGETHER // (len(self._exact) * self._s * count))
        for begin in range(0, len(self._total) if lights else 0, pixels):
            part = slice(begin, begin + pixels)
            some = [Seen(of_pixels(x, part, count) / unit, of_pixels(q, part, count), self._exact) for x, q in lights]
            self._add(some, part, count, float(unit) ** 2)

    def _add(self, lights: Sequence[Seen], part: slice, count: int, scale: float) -> None:
        """Add what some pixels have seen, in units whose square is `scale`."""
        for g, (shares, uneven) in enumerate(zip(self._shares.T.astype(np.float32), self._uneven, strict=True)):
            means: Array | float = 0
            for light in lights:
                second, mean = light.at(shares)
                at_y = np.einsum("k,k...->...", shares, [product(m) for m in mean])
                self._second[g, part] += scale / self._s * second.reshape(count, -1).sum(axis=0)
                self._curve[g, part] += scale / self._s * (second - at_y).reshape(count, -1).sum(axis=0)
                means = mean + means
            for difference in np.einsum("ek,ktn->etn", uneven, means):
                self._pattern[g, part] += scale * count * variation(difference, count)

    def sums(self) -> dict[str, Array]:
        """Per pixel, to be added up over patches: ``curve`` ``(G, P)``, its square and its product with itself at
        `home`, and Var_y(I) as ``position`` ``(P,)``.
        """
        n, techniques = max(self._n, 1), len(self._exact)
        equal, at = home((True,) * techniques), home(self._exact)
        curve = (self._curve + self._pattern) / n
        rounding = ROUNDING * self._second / n  # see `dmis.curves`
        square, cross = curve * curve + rounding * rounding, curve * curve[at]
        cross[at] = square[at]
        # the pilot's own variance is V at equal shares with K S shading samples in place of S, divided evenly
        position = (self._total - self._curve[equal] / techniques) / n
        return {"curve": curve, "square": square, "cross": cross, "position": position}


def spread(records: Sequence[Record], s: int, techniques: int, n: int) -> Iterator[tuple[Array, Array]]:
    """``X = f F / q``, as the mean of the channels, and ``p_k / q`` of the pilot's shading samples, towards one light
    after the other; q is the mean of the p_k.

    ``(S, K, N)`` and ``(S, K, K, N)``: S samples of each technique of N camera samples, densities of each technique.
    Samples that are not recorded met no light: X is 0.
    """
    found: dict[tuple[int, ...], tuple[Array, Array]] = {}
    for record in records:
        if record.key not in found:
            x, q = np.zeros((s, techniques, n), np.float32), np.zeros((s, techniques, techniques, n), np.float32)
            q[:] = np.eye(techniques, dtype=np.float32)[..., None] * techniques
            found[record.key] = x, q
        x, q = found[record.key]
        where = slice(None) if record.sample is None else record.sample
        x[record.turn, record.side, where] += record.value.mean(axis=0)
        of_light = record.pdf / np.maximum(record.pdf.mean(axis=0), TINY)
        for k, p in enumerate(of_light):
            q[record.turn, record.side, k, where] = p
    yield from found.values()


class Seen:
    """Shading samples of all techniques towards one light, as `spread` yields them: what they say of any shares."""

    def __init__(self, x: Array, q: Array, exact: Sequence[bool]) -> None:
        self._known, self._own = np.flatnonzero(exact), np.flatnonzero(~np.asarray(exact))
        self._x = x.swapaxes(0, 1)
        self._q = np.ascontiguousarray(q.transpose(2, 1, 0, 3))  # of each technique, in the samples of each
        known = self._q[np.ix_(self._known, self._known)]
        mixture = np.maximum(known.sum(axis=0) / max(len(known), 1), LEAST)  # the one that drew samples of these
        self._relative = known / mixture

    def at(self, shares: Array) -> tuple[Array, Array]:
        """Second moment and means of shading samples at the `shares` ``(K,)``.

        Returns
        -------
        second
            Estimates of M2, ``(N,)``.
        means
            Estimates of m_k, ``(K, S, N)``; those of different S are independent.
        """
        techniques, rows, n = self._x.shape
        m = shares[0] * self._q[0]
        for share, q in zip(shares[1:], self._q[1:], strict=True):
            m += share * q
        y = self._x / np.maximum(m, LEAST, out=m)
        means, second = np.zeros((techniques, rows, n), np.float32), np.zeros(n, np.float32)
        for relative, k in zip(self._relative, self._known, strict=True):
            for each, own in zip(relative, self._known, strict=True):
                part = each * y[own]
                means[k] += part
                part *= y[own]
                second += shares[k] * part.sum(axis=0)
        means /= max(len(self._known), 1)
        second /= max(len(self._known), 1)
        for k in self._own:
            means[k] = y[k]
            second += shares[k] * (y[k] * y[k]).sum(axis=0)
        return second / rows, means


def _projections(covariance: Array) -> Array:
    """Rows v, ``(E, K)``, such that the covariance is the sum of ``v v^T``."""
    values, vectors = np.linalg.eigh(covariance)
    some = values > 1e-9
    return (vectors[:, some] * np.sqrt(values[some])).T.astype(np.float32)


@dataclass(frozen=True)
class Simplex:
    """Shares of several techniques that minimise variance and cost per patch, as `dmis.learned.Learned` does for two.

    Parameters
    ----------
    mix
        Names of the techniques, joined by ``+``.
    spp
        Samples of the pilot, at equal shares: an even multiple of K of at least 2 K, which become camera samples with
        K times the shading samples, K times fewer.
    patch, filter, size, sigma, shrink, cost, guard, reuse, combiner, sampler
        See `dmis.learned.Learned`; `filter` is ``joint``, ``gaussian`` or ``none``. What the `guard` keeps is `home`.

    Notes
    -----
    The maps of its `Fit` are ``patch``, shares of all techniques ``(K, rows, columns)``, ``variance``, and
    ``variances`` ``(G, rows, columns)``.
    """

    mix: str = "light+brdf+resampled"
    patch: int = 4
    spp: int = 6
    filter: str = "joint"
    size: int = 5
    sigma: float = 1.0
    shrink: bool = True
    cost: bool = True
    guard: float = 1.5
    reuse: bool | None = None
    combiner: str = "balance"
    sampler: str = ""

    def __post_init__(self) -> None:
        names = self.techniques
        for name in names:
            technique.find(name)
        if len(names) < 2 or len(set(names)) < len(names):
            raise ValueError(f"mix must be two or more different techniques joined by +; got {self.mix!r}")
        check_sharing(self.patch, self.size, self.sigma, self.guard)
        if self.spp < 2 * len(names) or self.spp % 2 or self.spp % len(names):
            raise ValueError(
                f"spp of the pilot must be an even multiple of {len(names)}, the number of techniques, and at least "
                f"{2 * len(names)}; got {self.spp}"
            )
        if self.filter not in ("gaussian", "none", "joint"):
            raise ValueError(f"filter must be gaussian, none or joint; got {self.filter!r}")

    @property
    def techniques(self) -> tuple[str, ...]:
        """Their names, in the order of the shares."""
        return tuple(self.mix.split("+"))

    @property
    def several(self) -> bool:
        """Whether weights are shares of all techniques."""
        return True

    @property
    def pilot(self) -> Mapping[Weight, int]:
        k = len(self.techniques)
        return {0.5 if k == 2 else (1 / k,) * k: self.spp}

    @property
    def settings(self) -> Mapping[str, Any]:
        return {"combiner": self.combiner, "techniques": self.techniques} | of_final(self.sampler, self.reuse)

    @property
    def guided(self) -> bool:
        """Whether the pilot should bring guides."""
        return self.filter == "joint"

    @property
    def statistic(self) -> Callable[[int, int], Statistic]:
        """What is gathered in the pilot."""
        return partial(Shares, exact=self._exact)

    @property
    def _exact(self) -> tuple[bool, ...]:
        return tuple(technique.find(name).exact for name in self.techniques)

    def fit(self, pilot: Mapping[Weight, Pilot]) -> Fit:
        (found,) = pilot.values()
        shape = found.moments.mean.shape[:2]
        guides = found.guides if self.guided else None
        means, pixels = pool(
            found.sums, shape, self.patch, None if self.filter == "none" else self.sigma, self.size // 2, guides
        )
        shares, inside = grid(len(self.techniques))
        at = home(self._exact)
        curves = Pooled(**means, pattern=np.zeros(()), pixels=pixels, half=at)
        if self.shrink:
            material = found.guides.get("material") if self.guided else None
            kinds = None if material is None else patch_mean(material, self.patch // BASE)
            curves = shrink(curves, kinds, in_place=True)
        cost = np.ones(shares.shape[1])
        if self.cost:
            s = found.shading_samples
            cost = camera_sample(found.rays, shares, s, s // len(self.techniques), self.techniques)
        area = patch_sum(np.ones(shape), self.patch)
        may = allowed((curves.curve * area).sum(axis=(1, 2)), inside)
        index = cheapest(curves, cost, self.guard, may, area)
        patches = shares[:, index]
        weight = np.stack([patch_spread(share, self.patch, shape) for share in patches])
        maps = {
            "patch": patches,
            "variance": np.maximum(np.take_along_axis(curves.variance, index[None], axis=0)[0], 0),
            "variances": curves.variance,
        }
        return Fit(weight[0] if len(weight) == 2 else weight, maps)
