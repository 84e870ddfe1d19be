"""The commands ``check``, for a user's own classes, and ``doctor``, for a table of any renderer's shading samples."""

from __future__ import annotations

import argparse

from dmis.base.plugins import load_plugin
from dmis.cli.shared import check_page, say
from dmis.doctor.diagnosis import diagnose, page
from dmis.report.templates import write_page
from dmis.testing.find import RECOGNISED, find
from dmis.testing.outcome import Outcome, line, summary


def check(options: argparse.Namespace) -> int:
    """Run ``check`` and return its exit code: 1 if a check failed."""
    subjects = find(load_plugin(options.file))
    if not subjects:
        raise ValueError(f"{options.file} must define something to check; it defines none of: {RECOGNISED}")
    if options.albedo and all(subject.kind != "lobe" for subject in subjects):
        raise ValueError(f"--albedo applies to lobes, but {options.file} defines none")
    outcomes: list[Outcome] = []
    for subject in subjects:
        say(f"{subject.kind} {subject.name}")
        results = subject.check(options.albedo)
        say(*map(line, results))
        outcomes += results
    say(summary(outcomes))
    return int(not all(outcome.passed for outcome in outcomes))


def doctor(options: argparse.Namespace) -> int:
    """Run ``doctor`` and return its exit code: 1 if something is wrong."""
    if options.report is not None:
        check_page(options.report)
    diagnosis = diagnose(options.table)
    say(diagnosis.text())
    if options.report is not None:
        write_page(options.report, page(diagnosis, str(options.table)))
        say(options.report)
    return int(not diagnosis.healthy)
