"""Grittmann, Georgiev, Slusallek and Krivanek 2019: weights times second moment over variance of each technique.

*Variance-aware multiple importance sampling* (doi 10.1145/3355089.3356515), after the code of Hua et al. 2025 for
direct light (class ``VarAware``; the first authors are the same group). A technique's density is multiplied by
``m2 / v``, second moment over variance of what it estimates alone, so that one whose variance is small gets more
weight than the balance heuristic gives: W_l = v_l' p_l / (v_l' p_l + v_b' p_b) with v_k' = m2_k / v_k. The pilot has
one sample per pixel; a variance is the squared difference of pixels from the local mean, filtered, and the ratios are
filtered again.

What differs: local means are those of patches of 4x4 pixels, and filters Gaussians over patches. The authors bound
factors from below by 1 in bidirectional methods, which a ratio ``m2 / v`` meets by itself; here it is at most 100,
because a patch may have no variance at all. The paper is meant for bidirectional methods with stratified light paths;
direct light is one of its tests.

What it saves: docs/results.md, *Rules of the literature*.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from pilot_moments import SingleTechnique

import dmis
from dmis.base.patches import PATCH, patch_spread, patch_sum
from dmis.filter import gaussian


class Grittmann2019(dmis.Rule):
    weigh = "heuristic"

    def __init__(self, spp=1, sigma=1.0, most=100.0):
        self.spp, self.sigma, self.most = spp, sigma, most

    def rounds(self, budget):
        film = yield replace(budget.pilot(0.5, self.spp), statistic=SingleTechnique)
        # sums over the pixels of patches, to means
        pixels = patch_sum(np.ones(budget.shape), PATCH)
        smooth = partial(gaussian, sigma=self.sigma, radius=int(np.ceil(3 * self.sigma)), weight=pixels)
        factors = []
        for m1, m2 in zip(film.sums["m1"] / pixels, film.sums["m2"] / pixels):
            variance, moment = smooth(np.maximum(m2 - m1**2, 0)), smooth(m2)
            ratio = np.where(moment > 0, moment / np.maximum(variance, moment / self.most + 1e-30), 1)
            factors.append(smooth(ratio))
        light, brdf = factors
        yield budget.final(dmis.Fit(patch_spread(light / (light + brdf), PATCH, budget.shape)), self.spp)


dmis.register_rule("grittmann2019", Grittmann2019)
