"""Exercise 18 (hard): an unbiased curve of variances.

Exercise 12 derives the variance of a sample at the share w, for fixed numbers of
samples of both techniques. Estimate this variance for every w, without bias, from the n
light and the n BRDF samples of one pilot at w = 1/2. Hint: what is the mean of f / p_w
for the samples of one technique?

Copy this file to mine_18.py, and check it:
``python docs/exercises/checks 18 mine_18.py``.
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
    return y.var(axis=1)  # wrong: mixes both techniques, and is biased for few samples
