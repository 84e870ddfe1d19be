"""Outcomes of checks: what was checked, whether it holds, and a message that names the function at fault."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import matplotlib.figure

_PACKAGE = Path(__file__).parents[1]


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
    figure
        Makes a picture of a failure, with matplotlib; None: there is none.
    """

    name: str
    passed: bool
    message: str
    figure: Callable[[], matplotlib.figure.Figure] | None = None


def require(outcomes: Iterable[Outcome]) -> None:
    """Raise an AssertionError with the messages of all failed outcomes, in a test: ``require(check_lobe(lobe))``."""
    outcomes = list(outcomes)
    failures = [f"{outcome.name}: {outcome.message}" for outcome in outcomes if not outcome.passed]
    if failures:
        raise AssertionError("\n".join([f"{len(failures)} of {len(outcomes)} checks failed:", *failures]))
    if not outcomes:
        raise AssertionError("there are no outcomes: nothing was checked")


def run_checks(name: str, checks: Iterable[tuple[str, Callable[[], Outcome | str]]]) -> list[Outcome]:
    """Run checks in order and return their outcomes.

    Parameters
    ----------
    name
        Of what is checked; it begins the name of each outcome.
    checks
        Titles and functions. A function returns an outcome, or the message of success; it raises a `Fault`. Any other
        exception is a failure that names the function and line that raised it.
    """
    outcomes = []
    for title, check in checks:
        full = f"{name}: {title}"
        try:
            with np.errstate(all="ignore"):  # a function may divide by 0 where its result is masked
                result = check()
        except Fault as fault:
            outcomes.append(Outcome(full, False, str(fault), fault.figure))
        except Exception as error:
            outcomes.append(Outcome(full, False, raised(error)))
        else:
            outcomes.append(Outcome(full, True, result) if isinstance(result, str) else result)
    return outcomes


class Fault(Exception):
    """A check that fails: the message of its outcome, and its picture."""

    def __init__(self, message: str, figure: Callable[[], matplotlib.figure.Figure] | None = None) -> None:
        super().__init__(message)
        self.figure = figure


def raised(error: BaseException) -> str:
    """Return the message of an exception with the function, file and line of the user's code that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not Path(frame.filename).is_relative_to(_PACKAGE)]
    site = [frame for frame in own if "site-packages" not in frame.filename] or frames
    frame = site[-1]
    return f"{frame.name} raised {type(error).__name__}: {error} ({Path(frame.filename).name}, line {frame.lineno})"
