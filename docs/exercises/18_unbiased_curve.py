"""Exercise 18 (hard): an unbiased curve of variances.

With fixed numbers of samples the two techniques are two groups: exercise 12 has the
variance of a sample at the share w. Estimate it for every w from the n light and the n
BRDF samples of one pilot at w = 1/2, without bias. What do the samples of a group say
about f / p_w within their own technique?

Copy this file to mine.py, and check it: ``python docs/exercises/checks 18 mine.py``.
"""

import numpy as np


def variance_curve(x_l, d_l, x_b, d_b, w):
    """Return an unbiased estimate of the variance of a sample at each share, ``(G,)``.

    Parameters
    ----------
    x_l, d_l
        X and d of the light samples, as in exercise 17, ``(n,)``.
    x_b, d_b
        The same of the BRDF samples, ``(n,)``.
    w
        Shares between 0 and 1, ``(G,)``.
    """
    x, d = np.concatenate([x_l, x_b]), np.concatenate([d_l, d_b])
    y = x / (1 + (2 * w[:, None] - 1) * d)
    return y.var(axis=1)  # wrong: one group in place of two, and biased for few samples
