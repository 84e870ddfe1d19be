"""Solution of exercise 18: the sample variance of each technique, with n - 1.

The density of a technique's samples does not depend on w, so no reweighting is needed:
only their values f / p_w = X / m change with w.
"""


def variance_curve(x_l, d_l, x_b, d_b, w):
    """Return an unbiased estimate of w V_l + (1 - w) V_b at each share, ``(G,)``."""
    v_l, v_b = (
        (x / (1 + (2 * w[:, None] - 1) * d)).var(axis=1, ddof=1)
        for x, d in ((x_l, d_l), (x_b, d_b))
    )
    return w * v_l + (1 - w) * v_b
