"""Solution of exercise 15: weights that are fixed before any sample is drawn.

A pilot that missed a spike is too dark, and its sample variance is small. So weights by
inverse variance are largest where the pilot is too dark, and the image is too dark on
average.
"""


def combine(pilot, final):
    """Return an unbiased estimate of each pixel from both passes, ``(N,)``."""
    share = len(pilot) / (len(pilot) + len(final))
    return share * pilot.mean(axis=0) + (1 - share) * final.mean(axis=0)
