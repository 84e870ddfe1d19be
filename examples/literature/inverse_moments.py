"""Weights by inverse second moments, which the renderer RISE ships as "optimal MIS".

After its code (class ``OptimalMISAccumulator``, 2026). In tiles of 16x16 pixels training samples estimate the second
moments ``M_l = E[(f / p_l)^2]`` and ``M_b = E[(f / p_b)^2]``. With ``alpha = M_l / (M_l + M_b)``, clamped to
[.05, .95], BRDF samples have the weight ``alpha p_b / (alpha p_b + (1 - alpha) p_l)``. Where one technique brought no
light, alpha is the bound in favour of the other. The code cites Kondapaneni et al. 2019, whose optimal weights solve a
linear system and subtract control variates; that is the combiner `optimal`, and not this rule.

What differs: the number of training samples is chosen here, and f is the mean of the channels in place of the largest.
Meant for path tracing.

What it saves: docs/results.md, *Rules of the literature*.
"""

from dataclasses import replace

import numpy as np
from pilot_moments import SingleTechnique

import dmis
from dmis.base.patches import PATCH, patch_spread, patch_sum


class InverseMoments(dmis.Rule):
    weigh = "heuristic"

    def __init__(self, spp=4, tile=16, least=0.05):
        self.spp, self.tile, self.least = spp, tile, least

    def rounds(self, budget):
        film = yield replace(budget.pilot(0.5, self.spp), statistic=SingleTechnique)
        light, brdf = patch_sum(film.sums["m2"], self.tile // PATCH)
        tilt = np.divide(brdf, light + brdf, out=np.full(light.shape, 0.5), where=light + brdf > 0)
        # a technique without light has no evidence, not no variance
        tilt = np.where((light == 0) & (brdf > 0), self.least, tilt)
        tilt = np.where((brdf == 0) & (light > 0), 1 - self.least, tilt)
        tilt = tilt.clip(self.least, 1 - self.least)
        yield budget.final(dmis.Fit(patch_spread(tilt, self.tile, budget.shape)), self.spp)


dmis.register_rule("inverse-moments", InverseMoments)
