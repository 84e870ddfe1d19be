"""The command ``doctor``: faults of multiple importance sampling in a table of shading samples."""

from __future__ import annotations

import argparse

from dmis.base.atomic_files import check_writable, replacing
from dmis.cli.shared import say
from dmis.doctor.diagnosis import diagnose, page


def doctor(options: argparse.Namespace) -> int:
    """Run ``doctor`` and return its exit code: 1 if something is wrong."""
    if options.report is not None:
        if options.report.suffix.lower() not in (".html", ".htm"):
            raise ValueError(f"--report must end in .html, the page that it writes; got {str(options.report)!r}")
        check_writable(options.report)
    diagnosis = diagnose(options.table)
    say(diagnosis.text())
    if options.report is not None:
        with replacing(options.report) as partial:
            partial.write_text(page(diagnosis, str(options.table)), "utf-8")
        say(options.report)
    return int(not diagnosis.healthy)
