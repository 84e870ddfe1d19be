"""Exercise 1 (easy): reflect the directions of a batch.

Copy this file to mine_01.py, and check it:
``python docs/exercises/checks 1 mine_01.py``.
"""


def mirror(wo, n):
    """Return the directions `wo` reflected about the normals `n`, ``(3, N)``.

    Parameters
    ----------
    wo, n
        Unit vectors, ``(3, N)``; `wo` may point to either side of the surface.
    """
    raise NotImplementedError
