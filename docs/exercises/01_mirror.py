"""Exercise 1 (easy): reflect the directions of a batch.

Copy this file to mine.py, and check it: ``python docs/exercises/checks 1 mine.py``.
"""


def mirror(wo, n):
    """Return the directions `wo` reflected about the normals `n`, ``(3, N)``.

    Parameters
    ----------
    wo, n
        Unit vectors that point away from the surface, ``(3, N)``.
    """
    raise NotImplementedError
