"""The thesis's rule with a patch size from the pilot itself, by cross-validation between pixels: ``thesis-by-pilot``.

Small patches follow the image, large ones average away the noise of the pilot's variances; the best size differs from
scene to scene. With the pilot's variances ``s_i^2(p)`` at the shares ``w_i``, each an unbiased estimate from the
samples of the pixel p alone, the expected variance of the image with the shares w(p) is the sum over pixels of
``V_p(w(p))``. The rule takes V for a parabola; the parabola through the points ``(w_i, s_i^2(p))`` is linear in them,

    V^_p(w) = sum_i l_i(w) s_i^2(p),    sum_i l_i(w) = 1,

so that ``V^_p`` is unbiased for the parabola through the true variances, for every w that does not depend on the
samples of p. Hence pixels are divided into four folds, by whether their row and their column are even. The map
``w_k^-f`` of the patches of k pixels is fitted, and filtered, without the pixels of the fold f, and

    score(k) = sum over folds f, pixels p of f:  V^_p(w_k^-f(p)),

has the mean ``sum_p E[V_p(w_k^-f(p))]``, because pixels of a pilot are independent: the variance that patches of this
size lead to, up to a fit from three quarters of the pixels, which favours large patches a little. The size with the
least score is taken, the larger one of equal scores. It decides which map is used and nothing else, so that the image,
whose final samples are drawn afterwards, stays unbiased.

Known failures: the score is a sum of heavy-tailed estimates, in which a few bright pixels may outweigh all others; so
they do in the error of the image. Where all pixels of a pilot missed a spike, so does the score. Where one technique
alone is very bad, the parabola dips below V between the pilot's shares, even below 0; the score then says how well
patches follow a dip that the rule believes in, too, and its value is no variance.
"""

from dataclasses import dataclass

import numpy as np

import dmis
from dmis.base.patches import patch_spread, patch_sum
from dmis.fit.registry import Thesis
from dmis.fit.thesis import parabola_minimum

SIZES = (4, 8, 16, 32)
"""Sides of the patches that are compared, in pixels; multiples of the first."""


def choose_patch(w, variance, fit):
    """Return the patch size of the least held-out variance, and the score of each size.

    Parameters
    ----------
    w
        Shares w_i of the pilot, ``(n,)``.
    variance
        Variances ``s_i^2(p)`` of the pixels, ``(n, H, W)``; those that are not finite count as 0.
    fit
        ``fit(y, area)`` returns the shares of patches, ``(rows, columns)``, from their mean variances y ``(n, rows,
        columns)`` and their numbers of pixels.

    Returns
    -------
    size
        One of `SIZES`.
    scores
        Estimates of the mean variance of a camera sample with patches of each size, ``(4,)``.
    """
    base = SIZES[0]
    folds = [_in_patches(variance, (row, column), base) for row in (0, 1) for column in (0, 1)]
    total, area = (np.sum([fold[k] for fold in folds], axis=0) for k in (0, 1))
    scores = np.zeros(len(SIZES))
    for k, size in enumerate(SIZES):
        for held_out, pixels in folds:
            # y_i of the patches without the fold, and w of the base patches from it
            sums, number = (patch_sum(a, size // base) for a in (total - held_out, area - pixels))
            y = sums / np.maximum(number, 1)
            share = patch_spread(fit(y, number), size // base, area.shape)
            # sum_p sum_i l_i(w) s_i^2(p) over the fold
            scores[k] += (_parabola_basis(w, share) * held_out).sum()
    best = len(SIZES) - 1 - int(scores[::-1].argmin())  # of equal scores the last
    return SIZES[best], scores / variance[0].size


def _in_patches(variance, corner, size):
    """Return sums over patches of the variances of one fold of pixels, ``(n, rows, columns)``, and numbers of pixels.

    The fold is every second row and column from `corner` on.
    """
    inside = np.zeros(variance.shape[1:])
    inside[corner[0] :: 2, corner[1] :: 2] = 1
    return patch_sum(np.where(np.isfinite(variance), variance, 0) * inside, size), patch_sum(inside, size)


def _parabola_basis(w, share):
    """Return ``l_i`` at `share` ``(rows, columns)``, ``(n, rows, columns)``: of the least-squares parabola in the y_i.

    Of three shares it is the parabola through the points, and l_i is Lagrange's polynomial.
    """
    # coefficients = pinv(w_i^j) y,  V^(w) = sum_j w^j coefficients_j
    coefficients = np.linalg.pinv(np.vander(w, 3))
    return np.tensordot(coefficients, np.stack([share**2, share, np.ones_like(share)]), axes=(0, 0))


@dataclass(frozen=True)
class ThesisByPilot(Thesis):
    """Choose weights by the thesis's parabolas, with patches of the side among `SIZES` that the pilot predicts best.

    Options are those of `dmis.fit.registry.Thesis`, but that `patch` does not count. Its map ``sizes`` has the
    sizes and their predicted variances, ``(2, 4)``.
    """

    def fit_variances(self, w, s2, patch):
        size, scores = choose_patch(w, s2, lambda y, area: self.smooth(*parabola_minimum(w, y), area))
        fit = super().fit_variances(w, s2, size)
        return dmis.Fit(fit.weight, {**fit.maps, "sizes": np.stack([SIZES, scores])})


dmis.register_rule("thesis-by-pilot", ThesisByPilot)
