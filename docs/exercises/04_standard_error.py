"""Exercise 4 (easy): a mean and its standard error.

Copy this file to mine_04.py, and check it:
``python docs/exercises/checks 4 mine_04.py``.
"""


def mean_and_error(samples):
    """Return the mean of the samples and its standard error, two arrays ``(...)``.

    The square of the standard error must be unbiased, even for n = 2.

    Parameters
    ----------
    samples
        n independent samples along the first axis, ``(n, ...)``.
    """
    return samples.mean(axis=0), samples.std(axis=0)  # wrong: the spread of one sample
