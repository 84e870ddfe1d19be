"""Exercise 9 (hard): points of a table in proportion to its values.

A sky is a table of luminance. Bright texels need most samples: pick a row in proportion
to its sum, a texel of this row in proportion to its value, and a uniform point in this
texel. Two uniform numbers are enough.

Copy this file to mine_09.py, and check it:
``python docs/exercises/checks 9 mine_09.py``.
"""

import numpy as np


def sample_table(table, u):
    """Return points (x, y) in [0, 1)^2, ``(2, N)``, and their density, ``(N,)``.

    Parameters
    ----------
    table
        Values that are not negative, ``(H, W)``. Row i covers y from i / H to
        (i + 1) / H, column j covers x from j / W to (j + 1) / W.
    u
        Uniform numbers in [0, 1), ``(2, N)``.
    """
    return u, np.ones(u.shape[1])  # uniform: a valid density, but not in proportion
