"""Checks of the exercises that the tutorials end with, by their numbers.

Tutorial t has the exercises 3t + 1 to 3t + 3. A starter file of each is in ``docs/exercises``.
"""

from dmis.testing.exercises import (
    check_mis,
    check_monte_carlo,
    check_one_batch,
    check_own,
    check_parabola,
    check_pilot,
    check_sampling,
)
from dmis.testing.exercises.grading import Check

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
