"""Exercise 10 (easy): the balance heuristic.

Copy this file to mine_10.py, and check it:
``python docs/exercises/checks 10 mine_10.py``.
"""


def balance_weight(p_l, p_b, w):
    """Return the MIS weight of a light sample, ``(N,)``; 0 where both densities are 0.

    Parameters
    ----------
    p_l, p_b
        Densities of light and BRDF sampling in the sample's direction, ``(N,)``.
    w
        Share of the samples that are light samples, between 0 and 1.
    """
    return p_l / (p_l + p_b)  # wrong: this is for w = 1/2, and it divides by zero
