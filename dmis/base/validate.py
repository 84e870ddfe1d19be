"""Checks of arguments: numbers, pairs of numbers, vectors and directions; an error names the argument.

Numbers of NumPy are accepted and converted to Python's, so that dataclasses made of them hold plain data.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterable
from math import inf
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from dmis.base.vectors import Floats, dot

T = TypeVar("T")


def whole(name: str, value: Any, least: float = -inf, most: float = inf, more: str = "") -> int:
    """Return `value` as an int, if it is a whole number from `least` to `most`, such as 8, 8.0 or ``np.int64(8)``.

    Else a ValueError calls it `name`; its message has `more` after the range: the reason, or what else is allowed.
    """
    plain = _plain(value)
    if isinstance(plain, float) and plain.is_integer():
        plain = int(plain)
    if not isinstance(plain, int) or not least <= plain <= most:
        raise _refusal(name, "a whole number", least, most, more, value)
    return plain


def number(name: str, value: Any, least: float = -inf, most: float = inf, more: str = "") -> float:
    """Return `value` as a float, if it is a number from `least` to `most`; parameters and errors as of `whole`."""
    plain = _plain(value)
    if not isinstance(plain, int | float) or not least <= plain <= most:
        raise _refusal(name, "a number", least, most, more, value)
    return float(plain)


def one_of(name: str, value: Any, allowed: Iterable[Any]) -> Any:
    """Return the one of the `allowed` values that `value` equals; raise a ValueError that calls it `name` otherwise."""
    choices = tuple(allowed)
    if value not in choices:
        raise ValueError(f"{name} must be {' or '.join(map(str, choices))}; got {value!r}")
    return choices[choices.index(value)]


def pair(name: str, value: Any, check: Callable[[str, Any], T]) -> tuple[T, T]:
    """Return two values, each checked by `check`; raise a ValueError that calls them `name` otherwise."""
    values = tuple(value) if isinstance(value, Iterable) else ()
    if len(values) != 2:
        raise ValueError(f"{name} must be two numbers; got {value!r}")
    return check(name, values[0]), check(name, values[1])


def did_you_mean(name: str, names: Iterable[str], likeness: float = 0.6) -> str:
    """Return ``, did you mean 'thesis'?``, or nothing if `name` is like none of `names` (difflib; case is ignored)."""
    from difflib import get_close_matches

    known = {other.lower(): other for other in sorted(names)}
    similar = get_close_matches(name.lower(), known, 1, likeness)
    return f", did you mean {known[similar[0]]!r}?" if similar else ""


def _plain(value: Any) -> Any:
    """Return a NumPy number as a Python number; None for a bool, which is not a number although it is an int."""
    plain = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(plain, bool) else plain


def _refusal(name: str, kind: str, least: float, most: float, more: str, value: Any) -> ValueError:
    low, high = (f"{end:g}" if isinstance(end, float) else str(end) for end in (least, most))
    span = "" if least == -inf else f" of at least {low}" if most == inf else f" from {low} to {high}"
    return ValueError(f"{name} must be {kind}{span}{more and f', {more}'}; got {value!r}")


FARTHEST = 1e18
"""Largest coordinate: Embree squares coordinates in float32, and does not check them."""


def vector(name: str, value: npt.ArrayLike) -> Floats:
    """Return `value` as a float64 array ``(3,)``; raise a ValueError unless it is three finite numbers."""
    xyz = np.array(value, np.float64)
    if xyz.shape != (3,) or not np.isfinite(xyz).all():
        raise ValueError(f"{name} must be three finite numbers; got {xyz.tolist()}")
    return xyz


def direction(name: str, value: npt.ArrayLike) -> Floats:
    """Return `value` scaled to unit length, ``(3,)``; raise a ValueError if it is zero or not a finite vector."""
    xyz = vector(name, value)
    if not xyz.any():
        raise ValueError(f"{name} must not be zero, because it gives a direction; got {xyz.tolist()}")
    return xyz / np.linalg.norm(xyz)


def positive(name: str, value: float) -> float:
    """Return `value`; raise a ValueError unless it is a positive finite number."""
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be positive and finite; got {value}")
    return value


def check_form(call: str, values: Any, count: int, *shapes: str) -> None:
    """Raise a ValueError that names `call` unless `values` are floats of one of the `shapes`, in which N is `count`."""
    allowed = " or ".join(shapes)
    if not isinstance(values, np.ndarray) or values.dtype.kind != "f":
        kind = f"array of {values.dtype}" if isinstance(values, np.ndarray) else type(values).__name__
        raise ValueError(f"{call} must be an array of float of shape {allowed}; got {kind}")
    if str(values.shape) not in [shape.replace("N", str(count)) for shape in shapes]:
        raise ValueError(f"{call} must be of shape {allowed}; got shape {values.shape} for N = {count}")


def check_array(
    call: str, values: Any, count: int, *shapes: str, below: float = inf, where: Callable[[], Any] | None = None
) -> None:
    """Raise a ValueError as `check_form` does, or unless `values` are at least 0 and `below` a limit, and so finite.

    Parameters
    ----------
    call
        What messages call the values, such as ``Dust.eval``.
    count, shapes
        N, and the allowed shapes as text, such as ``(3, N)``.
    where
        Returns which values count, an array that broadcasts to them; called only if one is wrong. None: all.
    """
    check_form(call, values, count, *shapes)
    # bits of floats of at least 0 are in their order, those of other numbers above: one pass, not two
    bits = f"u{values.itemsize}"
    if values.size == 0 or values.view(bits).max() < np.array(below, values.dtype).view(bits):
        return
    wrong = ~((values >= 0) & (values < below))
    if where is not None:
        wrong = wrong & where()
    if wrong.any():
        must = f"in [0, {below:g})" if below < inf else "finite and not negative"
        bad = np.broadcast_to(values, wrong.shape)[wrong]
        raise ValueError(f"{call} must be {must}; got {bad[0]:g} ({bad.size:,} of {wrong.size:,} values)")


def check_directions(call: str, wi: Any, count: int, where: Callable[[], Any]) -> None:
    """Raise a ValueError naming `call` unless `wi` ``(3, count)`` are finite, of length 1 ± 1e-3 `where` it matters."""
    check_form(call, wi, count, "(3, N)")
    square = dot(wi, wi)
    if count == 0 or (square.min() > 0.998 and square.max() < 1.002):
        return
    finite = np.isfinite(square)
    wrong = ~finite | (np.abs(square - 1) > 2e-3) & where()
    if wrong.any():
        must = "unit directions" if finite.all() else "finite"
        length = np.sqrt(square[wrong if finite.all() else ~finite][0])
        raise ValueError(
            f"{call} must be {must}; got a length of {length:.5g} ({wrong.sum():,} of {count:,} directions)"
        )


def check_methods(value: object, protocol: type, names: Iterable[str]) -> None:
    """Raise a ValueError if the class of `value` only inherits one of the methods `names` from `protocol`.

    The message names the method with its arguments, and quotes what the protocol says that it returns.
    """
    for name in names:
        inherited = [vars(base)[name] for base in protocol.__mro__ if name in vars(base)]
        if getattr(type(value), name) in inherited:
            arguments = ", ".join(list(inspect.signature(inherited[0]).parameters)[1:])
            purpose = inspect.getdoc(inherited[0]).splitlines()[0]  # type: ignore[union-attr]
            raise ValueError(
                f"{type(value).__name__} must define the method {name}({arguments}), for which {protocol.__name__} has "
                f"no default. {purpose}"
            )


def check_package(module: str, purpose: str, install: str) -> None:
    """Check that the package that writes a result can be imported, before the result is computed.

    A ValueError if it cannot; its message ends with `install`, the command that installs it.
    """
    try:
        importlib.import_module(module)
    except ImportError as error:
        raise ValueError(f"{purpose} needs {module}, which cannot be imported ({error}): {install}") from error
