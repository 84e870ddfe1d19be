"""Solution of exercise 11: every sample counts f / (n_l p_l + n_b p_b)."""


def estimate(f_l, p_ll, p_bl, f_b, p_lb, p_bb):
    """Return N estimates of the integral of f by the balance heuristic, ``(N,)``."""
    n_l, n_b = len(f_l), len(f_b)
    light = f_l / (n_l * p_ll + n_b * p_bl)
    brdf = f_b / (n_l * p_lb + n_b * p_bb)
    return light.sum(axis=0) + brdf.sum(axis=0)
