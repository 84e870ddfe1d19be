"""Tools of the exercises' checks: calls of a student's functions, and comparisons that return an `Outcome`.

A check is a generator of outcomes; the decorator `exercise` makes it a function that returns their list. Where the
student's code is missing, raises an exception or returns the wrong shape, the list ends with an outcome that says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import deepcopy
from functools import wraps
from types import ModuleType
from typing import Any

import numpy as np

from dmis.base.plugins import raised
from dmis.base.vectors import Array
from dmis.testing.density import DensityView
from dmis.testing.outcome import Outcome
from dmis.testing.statistics import chi2_p

Z_LIMIT = 4.0
"""Largest z of a right solution; a normal deviate is beyond it once in 16,000 tests. All seeds are fixed."""
LEAST_P = 1e-4
"""Least p-value of a chi-square test of a right solution."""
Check = Callable[[ModuleType], list[Outcome]]
EXERCISES: dict[int, Check] = {}
"""Check of each exercise: takes the module of a student's file, returns its outcomes."""


SEED = 0
"""0: the published numbers; another one: other inputs, and another exponent of the exercises of `EXPONENTS`."""
EXPONENTS = {5: (1, (2, 3, 4)), 7: (1, (2, 3, 4)), 20: (2, (5, 6))}
"""Exponents of the tasks that have one: the published one, and those of seeds, which published solutions fail."""


def seeded(number: int) -> int:
    """Return the seed of a check's random numbers: `number`, or another one with `SEED`."""
    return number + 1000 * SEED


def between(published: float, low: float, high: float) -> float:
    """Return a parameter of a check: the published one, or another one from `low` to `high` with `SEED`."""
    if not SEED:
        return published
    return float(np.random.default_rng([SEED, int(1000 * published)]).uniform(low, high))


def exponent(number: int) -> int:
    """Return the exponent of the task of an exercise of `EXPONENTS`."""
    published, others = EXPONENTS[number]
    return others[SEED % len(others)] if SEED else published


class Failed(Exception):
    """Ends a check; `outcome` says why."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.outcome = Outcome(name, False, message)


def exercise(number: int) -> Callable[[Callable[[ModuleType], Iterator[Outcome]]], Check]:
    """Return a decorator that lists the outcomes of a check up to what ends it, and enters it in `EXERCISES`."""

    def decorator(check: Callable[[ModuleType], Iterator[Outcome]]) -> Check:
        @wraps(check)
        def outcomes(module: ModuleType) -> list[Outcome]:
            results: list[Outcome] = []
            try:
                results.extend(check(module))
            except Failed as failed:
                return [*results, failed.outcome]
            except Exception as error:
                return [*results, Outcome(f"exercise {number}", False, raised(error))]
            return results

        EXERCISES[number] = outcomes
        return outcomes

    return decorator


def call(module: ModuleType, name: str, *arguments: Any, shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    """Call a student's function with copies of the arguments; return its arrays, float64 copies.

    Parameters
    ----------
    name
        Name of the function in `module`.
    shapes
        Shape of each array; one shape stands for a single array that is not in a tuple.

    Raises
    ------
    Failed
        If there is no such function, it raises an exception, or it returns something else or values that are not
        finite.
    """
    returned = call_object(name, getattr(module, name, None), *arguments)
    values = (returned,) if len(shapes) == 1 else returned
    if not isinstance(values, tuple | list) or len(values) != len(shapes):
        got = type(returned).__name__
        raise Failed(f"{name} runs", f"{name} must return {len(shapes)} arrays as a tuple; got {got}")
    return [check_array(name, value, shape) for value, shape in zip(values, shapes, strict=True)]


def check_array(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return a copy of what the function `name` returned, float64; raise Failed unless it is finite and of `shape`."""
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise Failed(f"{name} runs", f"{name} must return numbers of shape {shape}; got {value!r:.80}") from None
    if array.shape != shape:
        raise Failed(f"{name} has the right shape", f"{name} must return shape {shape}; got {array.shape}")
    if bad := np.count_nonzero(~np.isfinite(array)):
        raise Failed(f"{name} is finite", f"{name} must return finite numbers; {bad} of {array.size} are not")
    return array


def call_object(name: str, function: Any, *arguments: Any) -> Any:
    """Return what a student's `function` returns for copies of the arguments, whose arrays cannot be changed.

    Raises
    ------
    Failed
        If it is no function, or raises an exception; the message has the line.
    """
    if not callable(function):
        raise Failed(f"{name} exists", f"the file must define {name}; it has none. Keep the starter's name")
    try:
        with np.errstate(all="ignore"):  # a function may divide by 0 where its result is masked
            return function(*(_read_only(argument) for argument in deepcopy(arguments)))
    except NotImplementedError:
        raise Failed(f"{name} is written", f"{name} raises NotImplementedError: replace its body") from None
    except (Exception, SystemExit) as error:
        advice = ". Its arguments are the caller's: change a copy" if "read-only" in str(error) else ""
        raise Failed(f"{name} runs", raised(error) + advice) from None


def _read_only(argument: Any) -> Any:
    """Return an argument whose arrays raise a ValueError if they are written to."""
    if isinstance(argument, tuple):
        return tuple(map(_read_only, argument))
    if isinstance(argument, np.ndarray):
        argument.flags.writeable = False
    return argument


def compare(name: str, values: Array | float, expected: Array | float, tolerance: float, advice: str = "") -> Outcome:
    """Return whether values are the expected ones within a tolerance.

    The tolerance is relative to the largest expected value; where all expected values are 0 it is absolute.

    Parameters
    ----------
    values, expected
        Arrays of shapes that broadcast.
    advice
        Sentence for the message of a failure.
    """
    values, expected = np.broadcast_arrays(np.asarray(values, np.float64), np.asarray(expected, np.float64))
    difference = np.abs(values - expected)
    worst = np.unravel_index(difference.argmax(), difference.shape)
    passed = bool(difference[worst] <= tolerance * (np.abs(expected).max() or 1.0))
    where = f" at {tuple(int(i) for i in worst)}" if difference.size > 1 else ""
    message = f"expected {expected[worst]:.6g}{where}, got {values[worst]:.6g}"
    return Outcome(name, passed, message if passed or not advice else f"{message}. {advice}")


def z_test(name: str, estimates: Array, exact: float, advice: str = "") -> Outcome:
    """Return whether the mean of independent estimates ``(K,)`` agrees with the exact value."""
    estimates = np.asarray(estimates, np.float64)
    error = float(estimates.std(ddof=1) / np.sqrt(len(estimates)))
    # rounding is not noise: an estimate without variance may be off by it
    z = float((estimates.mean() - exact) / max(error, 1e-6 * abs(exact), 1e-30))
    passed = abs(z) <= Z_LIMIT
    if passed or error > 1e-6 * abs(estimates.mean()):
        message = f"mean {estimates.mean():.6g} ± {error:.2g}, exact {exact:.6g}, z = {z:.1f}"
    else:
        message = f"expected {exact:.6g} on average, got {estimates.mean():.6g} in each of {len(estimates)} estimates"
    return Outcome(name, passed, message if passed or not advice else f"{message}. {advice}")


def likely_mistake(values: Array, mistakes: Iterable[tuple[str, Array]], otherwise: str = "") -> str:
    """Return the advice whose mistake gives the values of a student; `otherwise` if none does.

    Parameters
    ----------
    values
        What the student's function returned.
    mistakes
        Advice, and the values that the mistake gives, of the same shape.
    """
    alike = (advice for advice, wrong in mistakes if np.allclose(values, wrong, rtol=1e-4, atol=1e-7))
    return next(alike, otherwise)


def at_most(name: str, value: float, limit: float, what: str, advice: str = "") -> Outcome:
    """Return whether a number `what`, such as a variance, is at most `limit`."""
    message = f"{what} is {value:.4g}, at most {limit:.4g} is allowed"
    passed = bool(value <= limit)
    return Outcome(name, passed, message if passed or not advice else f"{message}. {advice}")


def chi_square(name: str, counts: Array, expected: Array) -> Outcome:
    """Return whether counts agree with expected counts by Pearson's test; cells that expect 0 must be empty."""
    counts, expected = np.ravel(counts), np.ravel(expected)
    stray = counts[expected <= 0].sum()
    if stray > 0:
        return Outcome(name, False, f"{stray:.0f} samples lie where the density is 0")
    p = chi2_p(counts[expected > 0], expected[expected > 0])
    return Outcome(name, p >= LEAST_P, f"p = {p:.2g} by the chi-square test, at least {LEAST_P:g} is needed")


def check_directions(name: str, wi: Array, density: Callable[[Array], Array]) -> Iterator[Outcome]:
    """Yield whether a density over directions integrates to 1, and whether directions `wi` ``(3, N)`` follow it."""
    view = DensityView(wi.astype(np.float32), density, np.ones(wi.shape[1], bool), name)
    yield compare(f"{name}: the density integrates to 1", view.mass, 1.0, 0.01, "Which factor is missing?")
    title = f"{name}: samples follow the density"
    yield Outcome(title, view.p >= LEAST_P, f"{view.describe()}; p must be at least {LEAST_P:g}")
