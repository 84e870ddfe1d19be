"""Outcomes of checks: what was checked, whether it holds, a message that names the function at fault."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dmis.base.plugins import raised

Check = tuple[str, Callable[[], str]]
"""Title of a check, and function that returns the measured numbers or raises a `Fault`."""


@dataclass(frozen=True)
class Outcome:
    """The result of one check.

    Attributes
    ----------
    name
        What was checked, such as ``Velvet: sample follows pdf``.
    passed
        Whether it holds.
    message
        The measured numbers; of a failure also the function at fault.
    """

    name: str
    passed: bool
    message: str


class Fault(Exception):
    """A check that fails, with the message of its outcome."""


def run_checks(name: str, checks: Iterable[Check]) -> list[Outcome]:
    """Return the outcomes of checks, whose names begin with the `name` of what is checked.

    Any exception but a `Fault` is a failure that names the function and line that raised it. One that is raised while
    the `checks` are made is the only outcome: the renderer refuses what is checked.
    """
    made: list[Check] = []

    def make() -> str:
        made.extend(checks)
        return ""

    refused = _outcome(f"{name}: the renderer accepts it", make)
    return [_outcome(f"{name}: {title}", check) for title, check in made] if refused.passed else [refused]


def _outcome(name: str, check: Callable[[], str]) -> Outcome:
    """Return the outcome of one check."""
    try:
        with np.errstate(all="ignore"):  # a function may divide by 0 where its result is masked
            return Outcome(name, True, check())
    except Fault as fault:
        return Outcome(name, False, str(fault))
    except Exception as error:
        return Outcome(name, False, raised(error))


def require(outcomes: Iterable[Outcome]) -> None:
    """Raise an AssertionError with the messages of all failed outcomes, in a test: ``require(check_lobe(lobe))``."""
    outcomes = list(outcomes)
    failures = [f"{outcome.name}: {outcome.message}" for outcome in outcomes if not outcome.passed]
    if failures:
        raise AssertionError("\n".join([summary(outcomes), *failures]))
    if not outcomes:
        raise AssertionError("there are no outcomes: nothing was checked")


def line(outcome: Outcome) -> str:
    """Return the line of an outcome: ok or FAILED, its name and its message."""
    return f"{'ok' if outcome.passed else 'FAILED':6}  {outcome.name}: {outcome.message}"


def summary(outcomes: Sequence[Outcome]) -> str:
    """Return the number of checks that failed, or that all passed."""
    failed = sum(not outcome.passed for outcome in outcomes)
    return f"{failed} of {len(outcomes)} checks failed" if failed else f"all {len(outcomes)} checks passed"
