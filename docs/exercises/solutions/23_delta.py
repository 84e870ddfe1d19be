"""Solution of exercise 23: a ray from a mirror has the weight 1."""

import numpy as np


def contribution(f, p_l, p_b, by_brdf, mirrored):
    """Return what each sample adds, ``(N,)``."""
    # balance: (p / (p_l + p_b)) f / p, whichever technique drew the row
    total = p_l + p_b
    shared = np.where(total > 0, f / np.where(total > 0, total, 1), 0)
    return np.where(mirrored, f, shared)
