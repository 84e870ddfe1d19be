"""Grittmann, Yazici, Georgiev and Slusallek 2022: the share of least second moment times cost.

*Efficiency-aware multiple importance sampling for bidirectional rendering algorithms* (doi 10.1145/3528223.3530126),
after the authors' code (class ``VcmOptimizer``). The samples of one proxy combination, here equal shares, give the
second moment ``M(w) = E_q[(f / q)^2 / m(w)]``, ``m = p_w / q``, of every candidate; moments are filtered over pixels,
and each pixel takes the candidate of least ``M(w) C(w)``, with the cost C of a camera sample.

What differs: candidates are shares of light samples from .03 to .97, in place of numbers of connections and of merging;
costs are counted from the pilot's rays; moments are sums over patches of 4x4 pixels and filtered with a Gaussian. The
squared mean is left out, as the authors' default does: `second-moment` minimises the variance. The paper is meant for
vertex connection and merging.

What it saves: docs/results.md, *Rules of the literature*.
"""

from functools import partial

import numpy as np

import dmis
from dmis.base.patches import PATCH, patch_spread
from dmis.estimator.cost import camera_sample_cost
from dmis.filter import gaussian
from dmis.variance.curves import GRID

SHARES = GRID[1:-1]


def second_moments(x, d):
    """Return ``(f / q)^2 / m(w)``, m(w) = 1 + (2 w - 1) d, over both samples at each share, ``(C, N)``."""
    return np.stack([(x * x / (1 + (2 * w - 1) * d)).sum(axis=0) for w in SHARES])


class Grittmann2022(dmis.Rule):
    shares_only = True
    statistic = partial(dmis.Gather, second_moments)

    def __init__(self, spp=6, sigma=1.0):
        self.pilot = {0.5: spp}
        self.sigma = sigma

    def fit(self, pilot):
        film = pilot[0.5]
        smooth = partial(gaussian, sigma=self.sigma, radius=int(np.ceil(3 * self.sigma)))
        moments = np.stack([*map(smooth, film.sums["values"])])
        s = film.shading_samples
        cost = camera_sample_cost(film.rays, np.stack([SHARES, 1 - SHARES]), s, s // 2)
        best = (moments * cost[:, None, None]).argmin(axis=0)
        # where nothing is lit, equal shares
        share = np.where((moments > 0).any(axis=0), SHARES[best], 0.5)
        return dmis.Fit(patch_spread(share, PATCH, film.mean.shape[:2]))


dmis.register_rule("grittmann2022", Grittmann2022)
