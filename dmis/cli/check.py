"""The command ``check``: a user's own lobes, lights, techniques, rules and samplers."""

from __future__ import annotations

import argparse
from pathlib import Path

from dmis.base.plugins import load_plugin
from dmis.cli.shared import say
from dmis.testing.find import RECOGNISED, find
from dmis.testing.outcome import Outcome, line, summary


def check(options: argparse.Namespace) -> int:
    """Run ``check`` and return its exit code: 1 if a check failed."""
    file = Path(options.file)
    if not file.is_file():
        raise FileNotFoundError(f"no such file: {file}; check needs a Python file with the code to check")
    subjects = find(load_plugin(file))
    if not subjects:
        raise ValueError(f"{file} must define something to check; it defines none of: {RECOGNISED}")
    if options.albedo and all(subject.kind != "lobe" for subject in subjects):
        raise ValueError(f"--albedo applies to lobes, but {file} defines none")
    outcomes: list[Outcome] = []
    for subject in subjects:
        say(f"{subject.kind} {subject.name}")
        results = subject.check(options.albedo)
        say(*map(line, results))
        outcomes += results
    say(summary(outcomes))
    return int(not all(outcome.passed for outcome in outcomes))
