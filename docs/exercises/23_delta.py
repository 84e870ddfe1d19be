"""Exercise 23 (medium): weights if some samples come from mirrors.

Each element of the arrays is one shading sample, on a material that may include a
mirror. Each point takes one sample of each technique. Return the contribution of each
sample with the balance heuristic.

Copy this file to mine_23.py, and check it:
``python docs/exercises/checks 23 mine_23.py``.
"""

import numpy as np


def contribution(f, p_l, p_b, by_brdf, mirrored):
    """Return what each sample adds, ``(N,)``.

    Parameters
    ----------
    f
        For rays from a mirror: reflectance times radiance. For all others: BRDF times
        radiance times cosine, not divided by a density.
    p_l, p_b
        Densities of both techniques in the sample's direction. For rays from a mirror
        p_b is 0, and p_l is above 0 if the ray hits a lamp. If nothing was drawn, both
        densities are 0.
    by_brdf, mirrored
        Whether BRDF sampling drew the direction, and whether the mirror did; bool.
    """
    weight = np.where(by_brdf, p_b, p_l) / np.maximum(p_l + p_b, 1e-12)
    p = np.where(by_brdf, p_b, p_l)
    p = np.where(mirrored, 1, p)
    return weight * f / np.maximum(p, 1e-12)  # wrong: it weighs the mirror's rays, too
