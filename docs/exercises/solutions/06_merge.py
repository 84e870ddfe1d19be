"""Solution of exercise 6: the formula of Chan, Golub and LeVeque (1983).

Only differences of means are squared, so large means do not cancel.
"""


def merge(a, b):
    """Return (n, mean, m2) of the samples of both blocks."""
    n = a[0] + b[0]
    delta = b[1] - a[1]
    mean = a[1] + delta * b[0] / n
    return n, mean, a[2] + b[2] + delta**2 * a[0] * b[0] / n
