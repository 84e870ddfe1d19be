"""Checks of the exercises that the tutorials end with, by their numbers.

Tutorial t has the exercises 3t + 1 to 3t + 3. A starter file of each is in ``docs/exercises``, and a solution in
``docs/exercises/solutions``.
"""

from types import ModuleType

from dmis.testing.graded import (
    check_mis,
    check_monte_carlo,
    check_one_batch,
    check_own,
    check_parabola,
    check_pilot,
    check_sampling,
)
from dmis.testing.graded.grading import Check
from dmis.testing.outcome import Outcome, attempt

LAST = 21
"""Number of the last exercise."""
EXERCISES: dict[int, Check] = {
    **check_one_batch.CHECKS,
    **check_monte_carlo.CHECKS,
    **check_sampling.CHECKS,
    **check_mis.CHECKS,
    **check_parabola.CHECKS,
    **check_pilot.CHECKS,
    **check_own.CHECKS,
}
"""Check of each exercise: takes the module of a reader's file, returns its outcomes."""


def check_exercise(number: int, module: ModuleType) -> list[Outcome]:
    """Return the outcomes of the check of an exercise, for a module with a solution.

    Raises
    ------
    ValueError
        If there is no exercise of this number.
    """
    if number not in EXERCISES:
        known = ", ".join(map(str, sorted(EXERCISES)))
        raise ValueError(f"exercise must be one that has a check: {known}; got {number}")
    return attempt(f"exercise {number}", lambda: EXERCISES[number](module))
