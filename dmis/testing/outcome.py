"""Outcomes of checks: what was checked, whether it holds, a message that names the function at fault."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dmis.base.plugins import raised

Check = tuple[str, Callable[[], str]]
"""Title of a check, and function that returns the message of success or raises a `Fault`."""


@dataclass(frozen=True)
class Outcome:
    """The result of one check.

    Attributes
    ----------
    name
        What was checked, such as ``Velvet: pdf is the density of sample``.
    passed
        Whether it holds.
    message
        The measured numbers; of a failure also the function at fault.
    """

    name: str
    passed: bool
    message: str


def require(outcomes: Iterable[Outcome]) -> None:
    """Raise an AssertionError with the messages of all failed outcomes, in a test: ``require(check_lobe(lobe))``."""
    outcomes = list(outcomes)
    failures = [f"{outcome.name}: {outcome.message}" for outcome in outcomes if not outcome.passed]
    if failures:
        raise AssertionError("\n".join([f"{len(failures)} of {len(outcomes)} checks failed:", *failures]))
    if not outcomes:
        raise AssertionError("there are no outcomes: nothing was checked")


def run_checks(name: str, form: str, prepare: Callable[[], Iterable[Check]]) -> list[Outcome]:
    """Return the outcomes of the check `form`, which is `prepare`, and of the checks that it returns.

    Names of outcomes begin with the `name` of what is checked. Any exception but a `Fault` is a failure that names the
    function and line that raised it. If `prepare` fails, that is the only outcome.
    """
    checks: list[Check] = []

    def check_form() -> str:
        checks.extend(prepare())
        return "as promised"

    outcomes = [_outcome(f"{name}: {form}", check_form)]
    return outcomes + [_outcome(f"{name}: {title}", check) for title, check in checks]


def _outcome(name: str, check: Callable[[], str]) -> Outcome:
    """Return the outcome of one check."""
    try:
        with np.errstate(all="ignore"):  # a function may divide by 0 where its result is masked
            return Outcome(name, True, check())
    except Fault as fault:
        return Outcome(name, False, str(fault))
    except Exception as error:
        return Outcome(name, False, raised(error))


class Fault(Exception):
    """A check that fails, with the message of its outcome."""


def line(outcome: Outcome) -> str:
    """Return the line of an outcome: ok or FAILED, its name and its message."""
    return f"{'ok' if outcome.passed else 'FAILED':6}  {outcome.name}: {outcome.message}"


def summary(outcomes: Sequence[Outcome]) -> str:
    """Return the number of checks that failed, or that all passed."""
    failed, count = sum(not outcome.passed for outcome in outcomes), len(outcomes)
    return f"{failed} of {count} checks failed" if failed else f"all {count} checks passed"
