"""Lines of outcomes, as ``python -m dmis check`` shows them."""

from __future__ import annotations

from collections.abc import Sequence

from dmis.testing.outcome import Outcome


def line(outcome: Outcome) -> str:
    """Return the line of an outcome: ok or FAILED, its name and its message."""
    return f"{'ok' if outcome.passed else 'FAILED':6}  {outcome.name}: {outcome.message}"


def summary(outcomes: Sequence[Outcome], not_checked: Sequence[str] = ()) -> str:
    """Return the number of checks that failed, or that all passed, and the names of what was not checked."""
    failed, count = sum(not outcome.passed for outcome in outcomes), len(outcomes)
    text = f"{failed} of {count} checks failed" if failed else f"all {count} checks passed"
    return f"{text.removeprefix('all ')}; not checked: {', '.join(not_checked)}" if not_checked else text
