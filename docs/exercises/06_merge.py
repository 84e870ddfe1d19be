"""Exercise 6 (hard): merge the moments of two blocks of samples.

A renderer processes its samples in blocks and stores only (n, mean, m2): the number of
samples, their mean, and the sum of their squared deviations from the mean.

Copy this file to mine_06.py, and check it:
``python docs/exercises/checks 6 mine_06.py``.
"""


def merge(a, b):
    """Return (n, mean, m2) of the samples of both blocks.

    The result must be exact up to rounding, even if the mean is far larger than the
    deviations.

    Parameters
    ----------
    a, b
        Moments (n, mean, m2) of the blocks; n is a number, mean and m2 are arrays.
    """
    n = a[0] + b[0]
    mean = (a[0] * a[1] + b[0] * b[1]) / n
    squares = (a[2] + a[0] * a[1] ** 2) + (b[2] + b[0] * b[1] ** 2)
    return n, mean, squares - n * mean**2  # right on paper only
