"""Solution of exercise 15: shares that were fixed before any sample was seen.

A pilot that missed a spike is dark and looks quiet. Weighed by its own variance it
counts more just where it is too dark, so the image is too dark on average.
"""


def combine(pilot, final):
    """Return an unbiased estimate of each pixel from both passes, ``(N,)``."""
    share = len(pilot) / (len(pilot) + len(final))
    return share * pilot.mean(axis=0) + (1 - share) * final.mean(axis=0)
