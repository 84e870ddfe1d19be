"""Lines and pictures of outcomes, as ``python -m dmis check`` shows them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from dmis.base.atomic_files import replacing
from dmis.testing.outcome import Outcome


def line(outcome: Outcome) -> str:
    """Return the line of an outcome: ok or FAILED, its name and its message."""
    return f"{'ok' if outcome.passed else 'FAILED':6}  {outcome.name}: {outcome.message}"


def summary(outcomes: Sequence[Outcome], not_checked: Sequence[str] = ()) -> str:
    """Return the number of checks that failed, or that all passed, and the names of what was not checked."""
    failed, count = sum(not outcome.passed for outcome in outcomes), len(outcomes)
    text = f"{failed} of {count} checks failed" if failed else f"all {count} checks passed"
    return f"{text.removeprefix('all ')}; not checked: {', '.join(not_checked)}" if not_checked else text


def write_figures(outcomes: Sequence[Outcome], folder: Path, stem: str) -> list[Path]:
    """Write the pictures of failed outcomes as PNG files into a folder, which is made, and return their paths.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    OSError
        If a file cannot be written.
    """
    paths: list[Path] = []
    for outcome in outcomes:
        if outcome.passed or outcome.figure is None:
            continue
        words = re.sub(r"\W+", "-", outcome.name.split(" (")[0]).strip("-").lower()
        path = folder / f"{stem}-{words}.png"
        figure = outcome.figure()
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial:
            figure.savefig(partial, format="png", dpi=100)
        paths.append(path)
    return paths
