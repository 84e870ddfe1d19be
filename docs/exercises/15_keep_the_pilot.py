"""Exercise 15 (hard): keep the samples of the pilot in the image.

The pilot's samples are unbiased, so they may improve the image. The starter weights
the means of both passes by their estimated inverse variances. This seems right, but the
image becomes biased.

Copy this file to mine_15.py, and check it:
``python docs/exercises/checks 15 mine_15.py``.
"""

import numpy as np


def combine(pilot, final):
    """Return an unbiased estimate of each pixel from both passes, ``(N,)``.

    Parameters
    ----------
    pilot, final
        Samples of the two passes, ``(n_pilot, N)`` and ``(n_final, N)``. Samples of
        both passes have the same mean, and about the same variance.
    """
    a, b = (1 / (x.var(axis=0, ddof=1) / len(x) + 1e-9) for x in (pilot, final))
    return np.asarray(a * pilot.mean(axis=0) + b * final.mean(axis=0)) / (a + b)
