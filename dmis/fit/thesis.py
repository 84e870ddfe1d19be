"""Section 3 of Seo's thesis (2014) in its order: weights from a parabola through three pilot variances per patch.

1. Sec. 3.1, `ThesisRule.pilot`: a few camera samples per pixel at each of w = 0 (BRDF sampling), 1/2 and 1 (light
   sampling).
2. Sec. 3.2, `ThesisRule.fit`: the estimates are unbiased, so their error is their variance (Eq. 3.1): the sample
   variance of each pixel, averaged over square patches.
3. Sec. 3.3, `parabola_minimum`: ``a2 w^2 + a1 w + a0`` through the points (w_i, y_i) by least squares (Eqs. 3.2-3.4);
   its minimum is the weight of the patch (Eq. 3.5).
4. Sec. 3.4, `ThesisRule.smooth`: a 5x5 Gaussian over the weights of the patches.

Eqs. 3.2-3.4 call v_i the variance and y_i the value; by Eq. 3.5 v_i must be the weight, w_i here, and y_i the variance.
The thesis does not say what happens without a minimum in [0, 1] (here: `STATUS`), which variance of a colour is meant,
and what the sigma of the Gaussian is: `dmis.fit.registry` has the other answers. docs/thesis.md explains each.

If y_0, y_h, y_1 are exact values of a monotone V(w) at 0, 1/2 and 1, then V at the result is at most V(1/2). Let V
fall, with ``A = y_0 - y_h >= 0`` and ``B = y_h - y_1 >= 0``. For ``A > B`` the minimum is at
``3/4 + B / (2 (A - B)) >= 3/4``; for ``A <= B`` there is none, and the result is 1. If V is convex and V(1/2) is the
least of the three, the result is in [1/4, 3/4], and ``V(w) - V(1/2) <= (V(1) - V(1/2)) / 2`` where ``A > |B|``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dmis.base.color import LUMINANCE
from dmis.base.patches import patch_spread, patch_sum
from dmis.base.vectors import Array
from dmis.filter import gaussian
from dmis.fit.round import Fit
from dmis.fit.rule import Rule
from dmis.variance.moments import Film

STATUS = {0: "minimum", 1: "clipped", 2: "not convex", 3: "no signal"}
"""Case of a patch: the parabola's minimum was used; it lay outside [0, 1], and the nearer end was used; the parabola
has no minimum, and the best pilot weight was used; the variances were zero, equal or not finite, and w = 1/2 was used.
"""


@dataclass(frozen=True)
class ThesisRule(Rule):
    """The rule of the thesis, whose steps `dmis.fit.registry.Thesis` varies."""

    patch: int = 16  # pixels on a side; the thesis tries 4 to 32
    spp: int = 2  # pilot samples at each of the three weights; the thesis has 2 or 4
    size: int = 5  # taps on a side of the Gaussian
    sigma: float = 1.0  # its standard deviation in patches
    shares_only = True
    weigh = ""

    @property
    def pilot(self) -> Mapping[float, int]:
        """Camera samples per pixel at w = 0, 1/2, 1 (Sec. 3.1)."""
        return dict.fromkeys((0.0, 0.5, 1.0), self.spp)

    def fit(self, pilot: Mapping[float, Film]) -> Fit:
        """Return the weight of each pixel, from the pilot at each weight w_i."""
        s2 = np.stack([self.grey(p.variance()) for p in pilot.values()])
        return self.fit_variances(np.array(list(pilot)), s2, self.patch)

    def grey(self, variance: Array) -> Array:
        """Return s^2 of each pixel from that of its channels, ``s^2 = sum (x - mean x)^2 / (n - 1)``."""
        return variance @ LUMINANCE

    def fit_variances(self, w: Array, s2: Array, patch: int) -> Fit:
        """Return the weight of each pixel, from the sample variances of the pixels at each w_i, ``(n, H, W)``."""
        # y_i = mean over the patch's pixels of s^2   (Sec. 3.2)
        area = patch_sum(np.ones(s2.shape[1:]), patch)
        y = np.stack([patch_sum(variance, patch) / area for variance in s2])
        raw, status = parabola_minimum(w, y)
        weight = self.smooth(raw, status, area)
        maps = {"status": status, "raw": raw, "filtered": weight, "variances": y}
        return Fit(patch_spread(weight, patch, s2.shape[1:]), maps)

    def smooth(self, raw: Array, status: np.ndarray, area: Array) -> Array:
        """Return the weights of patches ``(rows, columns)`` after the filter (Sec. 3.4); `area` is in pixels."""
        # weight_p = sum_q g(p - q) c_q raw_q / sum_q g(p - q) c_q,  g(d) ~ exp(-|d|^2 / (2 sigma^2)) over 5x5 patches
        return gaussian(raw, self.sigma, self.size // 2, self.counts(status, area))

    def counts(self, status: np.ndarray, area: Array) -> Array | None:
        """Return how much each patch counts in the filter; None: all the same, as in the thesis."""
        return None


def parabola_minimum(w: Array, y: Array) -> tuple[Array, np.ndarray]:
    """Return the minimum over [0, 1] of the parabola through variances y ``(n, ...)`` at weights w, and its `STATUS`.

    Both have the shape ``y.shape[1:]``. A parabola needs n >= 3 distinct weights, and meets three points exactly.
    """
    signal, scaled = _without_scale(w, y)
    # min over a of sum_i (a2 w_i^2 + a1 w_i + a0 - y_i)^2   (Eqs. 3.2-3.4), in v = w - 1/2 for its rounding:
    # a2 w^2 + a1 w + a0 = a2 v^2 + b1 v + b0,  b1 = a1 + a2
    v = w - 0.5
    (a2, b1, _), *_ = np.linalg.lstsq(np.stack([v**2, v, np.ones_like(v)], axis=1), scaled, rcond=None)
    # w = -a1 / (2 a2) = 1/2 - b1 / (2 a2)   (Eq. 3.5), where a2 > 0
    convex = signal & (a2 > 1e-12)
    minimum = 0.5 - b1 / np.where(convex, 2 * a2, 1)
    # outside [0, 1] the nearer end; not convex: the w_i of the least y_i; no signal: 1/2
    best = w[scaled.argmin(axis=0)]
    weight = np.where(convex, np.clip(minimum, 0, 1), np.where(signal, best, 0.5))
    outside = convex & ((minimum < 0) | (minimum > 1))
    status = np.select([~signal, ~convex, outside], [3, 2, 1], 0).astype(np.int8)
    return weight.reshape(y.shape[1:]), status.reshape(y.shape[1:])


def _without_scale(w: Array, y: Array) -> tuple[Array, Array]:
    """Return which points (w_i, y_i) have a signal, ``(m,)``, and ``y_i / max |y_i|``, ``(n, m)``, or 0 without one."""
    if len(np.unique(w)) < 3:
        raise ValueError(f"a parabola needs at least three distinct weights; got {w.tolist()}")
    # no signal: y_i not finite, or max y_i - min y_i <= 1e-12 max |y_i|
    y = y.reshape(len(w), -1)
    signal = np.isfinite(y).all(axis=0)
    scale = np.where(signal, np.abs(y).max(axis=0), 0)
    with np.errstate(invalid="ignore"):  # infinite variances are no signal already; their range is NaN
        signal &= np.ptp(y, axis=0) > 1e-12 * scale
    return signal, np.where(signal, y / np.where(signal, scale, 1), 0)
