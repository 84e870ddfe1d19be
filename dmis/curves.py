"""Variance against the weight: one pilot tells it for every w at once.

A pilot at w = 1/2 draws from ``q = (p_l + p_b) / 2``. With ``X = f / q`` of a shading sample and
``r = p_l / (p_l + p_b)`` in its direction, the mixture of any weight is ``p_w = m q`` with
``m(w) = 2 (w r + (1 - w) (1 - r))``, so every pilot sample says what it would have contributed at any w:

* second moment ``M2(w) = integral of f^2 / p_w = E_q[X^2 / m]``;
* technique means ``m_l(w) = E_{p_l}[f / p_w] = E_q[2 r X / m]``, and m_b alike with ``1 - r``.

With fixed shares of w and 1 - w, a shading sample has the variance ``M2 - w m_l^2 - (1 - w) m_b^2``. Both techniques'
samples tell of both, which is what makes it work: a technique that fails is known by what the other one sees.
Squares of means come from products of different camera samples, so all of it is unbiased.

Camera samples carry two shading samples, whose mean has half the variance of one; what the camera sample itself adds
(edges, textures, lights of a single direction) hardly depends on w: it is the difference to the variance that was
seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dmis.estimator import Record
from dmis.vec import Array

GRID = np.array([0, 0.03, 0.08, 0.16, 0.27, 0.38, 0.5, 0.62, 0.73, 0.84, 0.92, 0.97, 1], np.float32)
"""Weights at which curves are known: dense at the ends, where they are steep."""
HALF = int(np.flatnonzero(GRID == 0.5)[0])
LEAST = np.float32(1e-9)


class Curves:
    """Sums over pixels of variances at the weights of `GRID`, from pilot samples at w = 1/2.

    Parameters
    ----------
    pixels
        Number of pixels of the tile.
    shading_samples
        Of each camera sample.
    """

    def __init__(self, pixels: int, shading_samples: int) -> None:
        self._pairs = pairs_of(shading_samples)
        self._n = 0
        self._curve = np.zeros((len(GRID), pixels), np.float64)
        self._total = np.zeros(pixels, np.float64)

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block: `count` camera samples of every pixel, sample-major, and their radiance ``(3, N)``."""
        if count < 2:
            raise ValueError(f"curves need at least two camera samples, because they are variances; got {count}")
        self._n += count
        grey = radiance.mean(axis=0).reshape(count, -1)
        self._total += count * grey.var(axis=0, ddof=1)
        for x, r in spread(records, radiance.shape[1]):
            # the mean over the pairs, and half of it: a pair has two shading samples
            self._curve += count * _curve(x, r, count) / (2 * self._pairs**2)

    def sums(self) -> dict[str, Array]:
        """Per pixel, to be added up over patches: what `Pooled` is made of.

        ``curve`` ``(G, P)``, its square and its product with itself at w = 1/2, and the variance of a camera sample
        that was ``seen`` ``(P,)``.
        """
        curve, seen = self._curve / max(self._n, 1), self._total / max(self._n, 1)
        return {"curve": curve, "square": curve * curve, "cross": curve * curve[HALF], "seen": seen}


def pairs_of(shading_samples: int) -> int:
    """How many pairs of one light and one BRDF sample a camera sample has at w = 1/2.

    Raises
    ------
    ValueError
        If the number of shading samples is odd.
    """
    if shading_samples % 2:
        raise ValueError(
            f"shading_samples must be even for rules that learn from pairs of a light and a BRDF sample; "
            f"got {shading_samples}"
        )
    return shading_samples // 2


def spread(records: Sequence[Record], n: int) -> Iterator[tuple[Array, Array]]:
    """X, as the mean of the channels, and r of both techniques for all camera samples, ``(2, N)`` each.

    One pair of a light and a BRDF sample after the other, light by light. X is 0 where nothing came.
    """
    pairs: dict[tuple[tuple[int, ...], int], tuple[Array, Array]] = {}
    for record in records:
        if (record.key, record.turn) not in pairs:
            pairs[record.key, record.turn] = np.zeros((2, n), np.float32), np.full((2, n), 0.5, np.float32)
        x, r = pairs[record.key, record.turn]
        where = slice(None) if record.sample is None else record.sample
        x[record.side, where] += record.value.mean(axis=0)
        r[record.side, where] = record.pdf[0] / np.maximum(record.pdf[0] + record.pdf[1], LEAST)
    yield from pairs.values()


def _curve(x: Array, r: Array, count: int) -> Array:
    """Variance of a shading sample at each weight, per pixel ``(G, P)``."""
    out = np.empty((len(GRID), x.shape[1] // count), np.float64)
    pairs = count * (count - 1)
    for g, w in enumerate(GRID):
        m = r * (4 * w - 2)
        m += 2 - 2 * w
        t = x / np.maximum(m, LEAST, out=m)
        second = (x * t).reshape(2, count, -1).sum(axis=(0, 1)) * (0.5 / count)
        both = t[0] + t[1]
        t *= r
        light = (t[0] + t[1]).reshape(count, -1)
        brdf = both.reshape(count, -1) - light
        light_2, brdf_2 = ((e.sum(axis=0) ** 2 - (e * e).sum(axis=0)) / pairs for e in (light, brdf))
        out[g] = second - w * light_2 - (1 - w) * brdf_2
    return out


@dataclass(frozen=True, eq=False)
class Pooled:
    """Curves averaged over patches, in any shape ``(...)``.

    Attributes
    ----------
    curve
        Variance that the shading samples of one camera sample bring, at the weights of `GRID`, ``(G, ...)``.
    square, cross
        Means over pixels of its square and of its product with itself at w = 1/2, for standard errors.
    seen
        Variance of a camera sample at w = 1/2, all causes.
    pixels
        How many pixels were averaged.
    """

    curve: Array
    square: Array
    cross: Array
    seen: Array
    pixels: Array

    @property
    def variance(self) -> Array:
        """Variance of a camera sample at each weight, ``(G, ...)``: the curve, and what does not depend on w.

        An estimate: where the pilot is small it may be negative.
        """
        return self.curve + np.maximum(self.seen - self.curve[HALF], 0)

    def gain_error(self, cost: Array) -> Array:
        """Standard error of ``curve cost - curve(1/2) cost(1/2)``, ``(G, ...)``, for costs ``(G,)``."""
        c = np.reshape(cost, (-1,) + (1,) * self.seen.ndim)
        half = c[HALF]
        second = c * c * self.square - 2 * c * half * self.cross + half * half * self.square[HALF]
        mean = c * self.curve - half * self.curve[HALF]
        return np.sqrt(np.maximum(second - mean * mean, 0) / np.maximum(self.pixels - 1, 1))
