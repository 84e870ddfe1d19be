"""Section 3 of the thesis (Seo 2014), the rule ``thesis``: weights from a parabola through three pilot variances.

1. Pilot: a few camera samples per pixel at each of w = 0 (BRDF sampling), 1/2 and 1 (light sampling).
2. Variance: the sample variances of the pixels, averaged over square patches.
3. Parabola: ``a2 w^2 + a1 w + a0`` through the points (w_i, y_i), by least squares, Eqs. 3.2-3.4.
4. Minimum: ``w = -a1 / (2 a2)``, Eq. 3.5, clipped to [0, 1].
5. Filter: a 5x5 Gaussian over the weights of the patches, Sec. 3.4.

`Thesis.fit` has these steps in this order. Letters are those of docs/theory.md, "The thesis's rule".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread, patch_sum
from dmis.base.validate import one_of, positive, whole
from dmis.base.vectors import Array
from dmis.filter import check_taps, gaussian
from dmis.fit.patch_size import SIZES, choose_patch
from dmis.fit.round import Fit, Pilot
from dmis.fit.rule import OptionRule

STATUS = {0: "minimum", 1: "clipped", 2: "not convex", 3: "no signal"}
"""Case of a patch: the parabola's minimum was used; it lay outside [0, 1], and the nearer end was used; the parabola
has no minimum, and the best pilot weight was used; the variances were zero, equal or not finite, and w = 1/2 was used.
"""


@dataclass(frozen=True)
class Thesis(OptionRule):
    """Choose weights by a parabola through three pilot variances per patch: Seo's thesis (2014), Sec. 3.

    Parameters
    ----------
    patch
        Side of a patch in pixels (the thesis tries 4 to 32); ``auto``: the one of 4, 8, 16 and 32 for which the pilot
        predicts the least variance, see `dmis.fit.patch_size`.
    spp
        Pilot samples at each of the three weights, at least 2 (the thesis: 2 or 4).
    channels
        Variance that is fitted: of ``luminance``, or ``rgb``, the mean of the three.
    filter, size, sigma
        ``gaussian`` or ``none``; taps on a side, odd, and standard deviation of the Gaussian, in patches.
    no_signal, ragged
        What the Gaussian does with patches without a signal: ``half``, they enter it as w = 1/2, or ``skip``, it leaves
        them out; and with patches that the border cuts: ``equal``, they count as the others do, or ``area``, by their
        pixels. By the defaults all patches count the same, as in the thesis.
    reuse
        Whether the pilot's samples are part of the image. None: as the settings say, and no by default.
    combiner, sampler
        Of the final samples. None: as the settings say.
    weigh
        What w is: the share that the ``heuristic`` uses, with as many light as BRDF samples at every vertex
        (docs/theory.md, Eq. 8a), or the share of light ``samples``. Empty: the first, unless the preset is
        ``thesis-shares`` or the combiner is not ``balance``.

    Notes
    -----
    The maps of its `Fit` are ``status`` (see `STATUS`), ``raw`` and ``filtered``, the weights before and after the
    filter, and ``variances``, those of the pilot, ``(3, rows, columns)``; with ``patch=auto`` also ``sizes``, the
    sizes and their predicted variances, ``(2, 4)``.

    Eqs. 3.2-3.4 call v_i the variance and y_i the value; by Eq. 3.5 v_i must be the weight and y_i the variance. The
    thesis does not say what happens without a minimum in [0, 1] (here: `STATUS`), which variance of a colour is meant,
    what the sigma of the Gaussian is, what w weighs, or whether the pilot's samples enter the image: hence the options.
    With their defaults, in direct lighting with independent points and one light and one BRDF sample, the rule wins on
    two scenes at equal samples and loses on two, the same as in the thesis's Table 4.1. Shares of samples have less
    error there: ``docs/reproduction.md``.
    """

    patch: int | Literal["auto"] = 16
    spp: int = 2
    channels: str = "luminance"
    filter: str = "gaussian"
    size: int = 5
    sigma: float = 1.0
    no_signal: str = "half"
    ragged: str = "equal"
    reuse: bool | None = None
    combiner: str | None = None
    sampler: str | None = None
    weigh: str = ""
    shares_only = True

    def __post_init__(self) -> None:
        if self.patch != "auto" and not (isinstance(self.patch, int | np.integer) and 1 <= self.patch <= 65535):
            raise ValueError(f"patch must be 1 to 65535 pixels, or auto; got {self.patch!r}")
        whole("spp of the pilot", self.spp, 2, more="because a variance needs two samples")
        one_of("channels", self.channels, ("luminance", "rgb"))
        one_of("filter", self.filter, ("gaussian", "none"))
        one_of("no_signal", self.no_signal, ("half", "skip"))
        one_of("ragged", self.ragged, ("equal", "area"))
        check_taps(self.size)
        positive("sigma", self.sigma)

    @property
    def pilot(self) -> Mapping[float, int]:
        """Camera samples per pixel at w = 0, 1/2, 1."""
        return dict.fromkeys((0.0, 0.5, 1.0), self.spp)

    def fit(self, pilot: Mapping[float, Pilot]) -> Fit:
        """Return the weight of each pixel, from the pilot at each weight w_i."""
        w = np.array(list(pilot))
        # s^2 = sum (x - mean x)^2 / (n - 1) of each pixel
        grey = luminance if self.channels == "luminance" else partial(np.mean, axis=-1)
        s2 = np.stack([grey(p.moments.variance()) for p in pilot.values()])
        patch = self.patch
        maps = {}
        if patch == "auto":
            patch, scores = choose_patch(w, s2, lambda y, area: self._weights(w, y, area)[0])
            maps["sizes"] = np.stack([SIZES, scores])
        # y_i = mean over the patch's pixels of s^2
        y = np.stack([patch_mean(variance, patch) for variance in s2])
        weight, raw, status = self._weights(w, y, patch_sum(np.ones(s2.shape[1:]), patch))
        maps |= {"status": status, "raw": raw, "filtered": weight, "variances": y}
        return Fit(patch_spread(weight, patch, s2.shape[1:]), maps)

    def _weights(self, w: Array, y: Array, area: Array) -> tuple[Array, Array, np.ndarray]:
        """Return the weights of patches after and before the filter, and their status; `area` is in pixels."""
        # a2 w^2 + a1 w + a0 through (w_i, y_i), minimum -a1 / (2 a2)
        raw, status = parabola_minimum(w, y)
        if self.filter == "none":
            return raw, raw, status
        # weight_p = sum_q g(p - q) c_q raw_q / sum_q g(p - q) c_q,  g(d) ~ exp(-|d|^2 / (2 sigma^2)) over size x size
        # patches;  c_q = 1, or 0 without a signal, or the share of the patch that is inside of the image
        count = np.ones_like(raw) if self.ragged == "equal" else area / area.max()
        if self.no_signal == "skip":
            count = count * (status != 3)
        return gaussian(raw, self.sigma, self.size // 2, count), raw, status


def parabola_minimum(w: Array, variance: Array) -> tuple[Array, np.ndarray]:
    """Return the minimum over [0, 1] of the least-squares parabola through (w, variance): thesis Eqs. 3.2-3.5.

    Parameters
    ----------
    w
        At least three distinct weights, ``(n,)``; the parabola meets three points exactly.
    variance
        ``(n, ...)``.

    Returns
    -------
    weight
        In [0, 1], shape ``variance.shape[1:]``.
    status
        int8, see `STATUS`.
    """
    if len(np.unique(w)) < 3:
        raise ValueError(f"a parabola needs at least three distinct weights; got {w.tolist()}")

    # y_i / max |y_i|, of scale 1; 0 without a signal: y_i not finite, or max y_i - min y_i <= 1e-12 max |y_i|
    y = variance.reshape(len(w), -1)
    signal = np.isfinite(y).all(axis=0)
    scale = np.where(signal, np.abs(y).max(axis=0), 0)
    with np.errstate(invalid="ignore"):  # infinite variances are no signal already; their range is NaN
        signal &= np.ptp(y, axis=0) > 1e-12 * scale
    y = np.where(signal, y / np.where(signal, scale, 1), 0)

    # min over a of sum_i (a2 w_i^2 + a1 w_i + a0 - y_i)^2   (Eqs. 3.2-3.4), in v = w - 1/2 for its rounding:
    # a2 w^2 + a1 w + a0 = a2 v^2 + b1 v + b0,  b1 = a1 + a2
    # of three points at w = 0, 1/2, 1:  a2 = 2 (y_0 + y_1 - 2 y_h),  a1 = -3 y_0 + 4 y_h - y_1
    v = w - 0.5
    (a2, b1, _), *_ = np.linalg.lstsq(np.stack([v**2, v, np.ones_like(v)], axis=1), y, rcond=None)

    # w = -a1 / (2 a2) = 1/2 - b1 / (2 a2)   (Eq. 3.5), where a2 > 0
    convex = signal & (a2 > 1e-12)
    minimum = 0.5 - b1 / np.where(convex, 2 * a2, 1)

    # outside [0, 1] the nearer end; not convex: the w_i of the least y_i; no signal: 1/2
    best = w[y.argmin(axis=0)]
    weight = np.where(convex, np.clip(minimum, 0, 1), np.where(signal, best, 0.5))
    outside = convex & ((minimum < 0) | (minimum > 1))
    status = np.select([~signal, ~convex, outside], [3, 2, 1], 0).astype(np.int8)
    return weight.reshape(variance.shape[1:]), status.reshape(variance.shape[1:])
