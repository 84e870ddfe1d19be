"""Exercise 16 (easy): how many samples does it take to see a spike?

Copy this file to mine_16.py, and check it:
``python docs/exercises/checks 16 mine_16.py``.
"""


def chance_of_no_hit(p, samples):
    """Return the probability that none of n samples hits a spike, ``(K,)``.

    Parameters
    ----------
    p
        Probability that a sample hits the spike, ``(K,)``; it may be as small as 1e-12.
    samples
        Number of samples n, ``(K,)``.
    """
    raise NotImplementedError


def samples_needed(p, chance):
    """Return the least n for which the probability of no hit is at most `chance`."""
    raise NotImplementedError
