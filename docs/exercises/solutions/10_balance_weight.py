"""Solution of exercise 10: w p_l / (w p_l + (1 - w) p_b)."""

import numpy as np


def balance_weight(p_l, p_b, w):
    """Return the MIS weight of a light sample; 0 where both densities are 0."""
    p_w = w * p_l + (1 - w) * p_b
    return np.divide(w * p_l, p_w, out=np.zeros_like(p_w), where=p_w > 0)
