"""Exercise 11 (medium): an estimate from samples of both techniques.

Copy this file to mine_11.py, and check it:
``python docs/exercises/checks 11 mine_11.py``.
"""


def estimate(f_l, p_ll, p_bl, f_b, p_lb, p_bb):
    """Return N estimates of the integral of f by the balance heuristic, ``(N,)``.

    Parameters
    ----------
    f_l, p_ll, p_bl
        Integrand, density of light sampling and density of BRDF sampling at n_l light
        samples, ``(n_l, N)``.
    f_b, p_lb, p_bb
        The same at n_b BRDF samples, ``(n_b, N)``.
    """
    # the mean of two separate estimates: unbiased, but dominated by the noisier one
    return ((f_l / p_ll).mean(axis=0) + (f_b / p_bb).mean(axis=0)) / 2
