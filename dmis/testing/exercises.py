"""Checks of the solutions of the exercises, by number."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

from dmis.testing.outcome import Outcome, attempt

LAST = 21
"""Number of the last exercise."""
EXERCISES: dict[int, Callable[[ModuleType], list[Outcome]]] = {}
"""Functions that check a module with a solution, by the exercise's number."""


def check_exercise(number: int, module: ModuleType) -> list[Outcome]:
    """Check the solution of an exercise.

    Raises
    ------
    ValueError
        If there is no check for an exercise of this number.
    """
    if number not in EXERCISES:
        known = ", ".join(map(str, sorted(EXERCISES))) or "none yet"
        raise ValueError(f"exercise must be one that has a check: {known}; got {number}")
    return attempt(f"exercise {number}", lambda: EXERCISES[number](module))
