"""Hua, Grittmann and Slusallek 2025: the factor on the BRDF density of least relative second moment.

*Correct your balance heuristic* (doi 10.1145/3730819), after the authors' code for direct light (class ``Ours``). From
one sample per pixel, the pilot estimates for each candidate c the mean m1 and second moment m2 of the pixel's value
with the weights ``p_l / (p_l + c p_b)`` and ``c p_b / (p_l + c p_b)``. Moments are filtered with a radius of 32 pixels,
means with 16; each pixel takes the c of least ``m2 / m1^2``; the map of c is filtered with 16 pixels, and used.

What differs: radii are shares of the image's height (32 pixels of an assumed 480), filters are Gaussians on patches of
4x4 pixels. In the paper light samples come from a reservoir, so that p_l is not their density. It is meant for these,
and for bidirectional methods. With two known densities, VEACH MIS is a case that the authors call weak.
With the paper's factors for skies (``hua2025:sky=yes``) the score on small TT rises to 6.0, because a pilot of one
sample per pixel misses bright spots.

What it saves: docs/results.md, *Rules of the literature*.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from pilot_moments import PilotMoments

import dmis
from dmis.base.patches import PATCH, patch_spread
from dmis.base.vectors import TINY
from dmis.filter import gaussian


class Candidates(PilotMoments):
    def __init__(self, factors, pixels, shading_samples):
        self.factors, self.size = factors[:, None], len(factors)
        super().__init__(pixels, shading_samples)

    def values(self, k, x, r_l, r_b):
        # W f / (p_k / 2),  W = c_k p_k / (p_l + c p_b)
        return x * (self.factors if k else 1) / np.maximum(r_l + self.factors * r_b, TINY)


class Hua2025(dmis.Rule):
    weigh = "heuristic"

    def __init__(self, spp=1, radius=32 / 480, sky=False):
        self.spp, self.radius = spp, radius
        self.factors = np.array([0.01, 0.1, 0.5, 1, *([2, 10, 100] if sky else [])])

    def rounds(self, budget):
        statistic = partial(Candidates, self.factors)
        film = yield replace(budget.pilot(0.5, self.spp), statistic=statistic)
        sigma = self.radius * budget.shape[0] / PATCH
        wide = partial(gaussian, sigma=sigma, radius=int(np.ceil(3 * sigma)))
        narrow = partial(gaussian, sigma=sigma / 2, radius=int(np.ceil(1.5 * sigma)))
        m1, m2 = np.stack([*map(narrow, film.sums["m1"])]), np.stack([*map(wide, film.sums["m2"])])
        relative = np.where(m2 > 0, m2 / np.maximum(m1**2, TINY), np.inf)
        # where nothing is lit, the balance heuristic
        factor = np.where((m2 > 0).any(axis=0), self.factors[relative.argmin(axis=0)], 1)
        tilt = 1 / (1 + narrow(factor))
        yield budget.final(dmis.Fit(patch_spread(tilt, PATCH, budget.shape)), self.spp)


dmis.register_rule("hua2025", Hua2025)
