"""Exercise 13 (easy): the minimum of a parabola through three variances.

Equation (14) of the page "The thesis" gives the minimum. There are three special cases:

* If the minimum is outside [0, 1], take the nearer end.
* If the parabola has no minimum, take the best of the three shares.
* If all three variances are equal, take 1/2.

Copy this file to mine_13.py, and check it:
``python docs/exercises/checks 13 mine_13.py``.
"""


def best_share(y_0, y_h, y_1):
    """Return the share of light samples of each patch, in [0, 1].

    Parameters
    ----------
    y_0, y_h, y_1
        Variances at the shares 0, 1/2 and 1, arrays of any one shape.
    """
    return (3 * y_0 - 4 * y_h + y_1) / (4 * (y_0 + y_1 - 2 * y_h))
