"""The combiner ``controlled``: a control variate whose coefficient the pilot has fixed beforehand.

Densities integrate to 1, so with ``p_w = w p_l + (1 - w) p_b`` the function ``g = (p_l - p_b) / p_w`` has the mean 0
over samples of which a share w is the light's: the estimate

    ``mean of f / p_w - beta g``

is unbiased for every beta that does not depend on these samples. It is the only control that two densities have: since
``w p_l / p_w + (1 - w) p_b / p_w = 1``, both terms of ``sum_j beta_j (p_j / p_w - 1)`` are multiples of g. Samples that
meet no light, or that the surface rejects, count: there the other density is 0, and g is ``1 / w`` or
``-1 / (1 - w)``. Sources: Owen and Zhou 2000; He and Owen 2014; Hua et al. 2023.

*The best beta.* At a point y let D be the difference between the means of ``f / p_w`` over light and over BRDF samples,
and G that of g; by the identity above ``D = E[f g / p_w]`` and ``G = E[g^2]``, E over the mixture. With fixed counts
the variance of a shading sample is ``E[(f / p_w - beta g)^2] - I^2 - w (1 - w) (D - beta G)^2``, least in the mean over
y at

    ``beta = E_y[D (1 - w (1 - w) G)] / E_y[G (1 - w (1 - w) G)]``,

D / G at a single point. Where the techniques never meet (``G = 1 / (w (1 - w))``) the counts do already what g could
do, and the point has no say.

*From the pilot*, at w = 1/2, for every w: in the notation of `dmis.variance.curves`, ``D = E_q[2 d X / m]`` and
``G = E_q[4 d^2 / m]``; products at y come from two halves of the shading samples there. All lights have one beta. Costs
as much again as the curves in the pilot, one multiplication per shading sample afterwards.

Known failures: at a weight near 0 or 1, where the best ones often are, there is little to gain; weights are learned as
if the control were not there; pixels that see little light may come out negative.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from dmis.base.patches import PATCH, patch_mean, patch_spread
from dmis.base.vectors import Array
from dmis.estimator.records import Record, Statistic
from dmis.fit.pooling import pool
from dmis.fit.rule import Pilot
from dmis.variance.curves import GRID, MIN_DENSITY_RATIO, samples_by_light

WEIGHTS = GRID[1:-1]
"""Weights at which the regression is known; at the ends one technique alone does not cover g."""
DEGENERATE = 1e-3
"""Least mean of ``G (1 - w (1 - w) G)``, which is at most ``1 / (4 w (1 - w))``, that a fit can rest on."""
SUM_NAMES = ("control_product", "control_square", "control_light")
"""Sums that `Controls` adds to a rule's own statistic."""


class Controls:
    """A rule's statistic, numerator and denominator of beta at `WEIGHTS`, and the light of each channel.

    Parameters
    ----------
    statistic
        The rule's own.
    pixels, shading_samples
        See `dmis.estimator.records.Statistic`; a multiple of 4.
    """

    def __init__(self, statistic: Callable[[int, int], Statistic], pixels: int, shading_samples: int) -> None:
        self._rule_statistic, self._shading_samples = statistic(pixels, shading_samples), shading_samples
        self._n = 0
        self._product, self._square = np.zeros((2, len(WEIGHTS), pixels))
        self._light = np.zeros((3, pixels))

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """See `dmis.estimator.records.Statistic.add`."""
        self._rule_statistic.add(records, radiance, count)
        self._n += count
        n, pixels = radiance.shape[1], self._light.shape[1]
        for record in records:
            at = np.arange(n)[slice(None) if record.sample is None else record.sample] % pixels
            for channel, value in zip(self._light, record.value, strict=True):
                channel += np.bincount(at, value, pixels) / self._shading_samples
        for x, d in samples_by_light(records, self._shading_samples, n):
            for k, w in enumerate(WEIGHTS.astype(float)):
                m = np.maximum(1 + np.float32(2 * w - 1) * d, MIN_DENSITY_RATIO)
                slope = d / m
                difference, mass = _halves((x * slope).sum(axis=1)), _halves(2 * (d * slope).sum(axis=1))
                # D (1 - w (1 - w) G) and G (1 - w (1 - w) G), products from two halves
                d_and_g = np.stack([difference, mass])
                terms = d_and_g.mean(axis=1) - w * (1 - w) * (d_and_g * mass[::-1]).mean(axis=1)
                product, square = terms.reshape(2, count, pixels).sum(axis=1)
                self._product[k] += product
                self._square[k] += square

    def sums(self) -> dict[str, Array]:
        """See `dmis.estimator.records.Statistic.sums`."""
        totals = zip(SUM_NAMES, (self._product, self._square, self._light), strict=True)
        return {**self._rule_statistic.sums(), **{name: a / max(self._n, 1) for name, a in totals}}


def statistic(
    pilot: Mapping[float, int], rule_statistic: Callable[[int, int], Statistic] | None
) -> Callable[[int, int], Statistic]:
    """Return `Controls` around the statistic of a rule, `rule_statistic`.

    Raises
    ------
    ValueError
        If the rule has no pilot at w = 1/2 that gathers statistics.
    """
    if rule_statistic is None or list(pilot) != [0.5]:
        raise ValueError(
            "combiner controlled needs a rule that learns from shading samples of a pilot at w = 1/2, such as "
            f"second-moment or auto; this one has pilots at w = {', '.join(map(str, pilot)) or 'none'}"
        )
    return partial(Controls, rule_statistic)


def without_control_sums(pilot: Pilot) -> Pilot:
    """Return the pilot with the sums of the rule's own statistic alone."""
    return replace(pilot, sums={name: a for name, a in pilot.sums.items() if name not in SUM_NAMES})


def coefficients(pilot: Pilot, shares: Array) -> Array:
    """Return beta of the pixels and channels, ``(H, W, 3)``, for a final pass at `shares` ``(2,)`` or
    ``(2, H, W)``.

    Sums are averaged over patches of `PATCH` pixels and their neighbours with a 5x5 Gaussian. beta is in proportion to
    the mean light of a channel there, and bounded by what combinations ``a_l p_l + a_b p_b`` with positive coefficients
    have, ``-w`` to ``1 - w`` times that. It is 0 where the pilot saw nothing, where the fit is degenerate
    (`DEGENERATE`), and in pixels with a weight outside `WEIGHTS`, where one technique may be left out.
    """
    shape = pilot.moments.mean.shape[:2]
    means, _ = pool({name: pilot.sums[name] for name in SUM_NAMES}, shape, PATCH, sigma=1.0)
    share = np.broadcast_to(shares[0].astype(np.float64), shape)
    w = patch_mean(share, PATCH)
    k = np.abs(WEIGHTS[:, None, None] - w).argmin(axis=0)[None]
    product, square = (np.take_along_axis(means[name], k, axis=0)[0] for name in SUM_NAMES[:2])
    colours = means["control_light"]
    light = colours.mean(axis=0)
    usable = (square > DEGENERATE) & (light > 0)
    relative = np.clip(np.where(usable, product, 0) / np.where(usable, square * light, 1), -w, 1 - w)
    beta = patch_spread(np.moveaxis(np.where(usable, relative, 0) * colours, 0, -1), PATCH, shape)
    beta *= ((share > WEIGHTS[0] - 1e-6) & (share < WEIGHTS[-1] + 1e-6))[..., None]
    return beta


def _halves(pairs: Array) -> Array:
    """Return the means over the first and over the second half of the pairs ``(S / 2, N)``, ``(2, N)``."""
    return np.stack([pairs[::2].mean(axis=0), pairs[1::2].mean(axis=0)])
