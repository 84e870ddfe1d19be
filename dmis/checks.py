"""Checks of numbers that are given: what is refused, by name, and what is kept.

NumPy's numbers are as good as Python's, and become these, so that whatever is made of them is plain data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import inf
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


def whole(name: str, value: Any, least: float = -inf, most: float = inf, more: str = "") -> int:
    """`value` as an int, if it is a whole number from `least` to `most`, such as 8, 8.0 or ``np.int64(8)``.

    Parameters
    ----------
    more
        What the message says after the range: the reason, or what else may be given.

    Raises
    ------
    ValueError
        If it is none, or out of range; the message calls it `name`.
    """
    found = _plain(value)
    if isinstance(found, float) and found.is_integer():
        found = int(found)
    if not isinstance(found, int) or not least <= found <= most:
        raise _refusal(name, "a whole number", least, most, more, value)
    return found


def number(name: str, value: Any, least: float = -inf, most: float = inf, more: str = "") -> float:
    """`value` as a float, if it is a number from `least` to `most`; parameters and errors as of `whole`."""
    found = _plain(value)
    if not isinstance(found, int | float) or not least <= found <= most:
        raise _refusal(name, "a number", least, most, more, value)
    return float(found)


def pair(name: str, value: Any, check: Callable[[str, Any], T]) -> tuple[T, T]:
    """Two values that pass `check`; a ValueError that calls them `name` otherwise."""
    found = tuple(value) if isinstance(value, Iterable) else ()
    if len(found) != 2:
        raise ValueError(f"{name} must be two numbers; got {value!r}")
    return check(name, found[0]), check(name, found[1])


def _plain(value: Any) -> Any:
    """A number of NumPy's as Python's; None in place of a bool, which is no number although it is an int."""
    found = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(found, bool) else found


def _refusal(name: str, kind: str, least: float, most: float, more: str, value: Any) -> ValueError:
    low, high = (f"{end:g}" if isinstance(end, float) else str(end) for end in (least, most))
    span = "" if least == -inf else f" of at least {low}" if most == inf else f" from {low} to {high}"
    return ValueError(f"{name} must be {kind}{span}{more and f', {more}'}; got {value!r}")
