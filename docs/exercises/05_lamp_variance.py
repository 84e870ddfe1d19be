"""Exercise 5 (medium): the variance of the lamp's integral, by formula.

Tutorial 1 estimates the light of a round lamp from uniform directions. One sample is
X = 2 pi u if u > cos T, else 0, with u uniform in [0, 1). T is the lamp's half angle.
The variance of X is E[X^2] - E[X]^2. Solve both expectations as integrals over u.

Copy this file to mine_05.py, and check it:
``python docs/exercises/checks 5 mine_05.py``.
"""


def lamp_variance(half_angle):
    """Return the variance of one sample, for the lamp's half angle T in radians."""
    raise NotImplementedError
