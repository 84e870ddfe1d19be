"""The commands ``figure``, a figure or a table of a comparison for a paper, and ``play``, a page to paint shares on."""

from __future__ import annotations

import argparse

from dmis.base.atomic_files import check_package, check_writable, replacing
from dmis.base.validate import one_of
from dmis.cli.shared import check_page, load, progress_bar, say
from dmis.experiment.table import read_comparison
from dmis.report.compare import split_rules
from dmis.report.tables import STYLES, paper_table
from dmis.report.templates import write_page

FORMATS = (".pdf", ".png", ".svg", ".html", *STYLES)
"""Extensions of pictures, of a page, and of tables."""


def figure(options: argparse.Namespace) -> int:
    """Run ``figure`` and return its exit code."""
    style = one_of("extension of a figure", options.output.suffix.lower(), FORMATS)
    check_writable(options.output)
    rules = split_rules(options.rules) if options.rules else []
    if style in STYLES:
        comparison = read_comparison(options.folder)
        text = paper_table(comparison, rules).text(style)
        with replacing(options.output) as partial:
            partial.write_text(text, "utf-8")
        say(options.output, *filter(None, [comparison.few_pixels()]))
        return 0
    for package in ("matplotlib", "jinja2"):
        check_package(package, "a figure", "pip install 'dmis[plot]'")
    from dmis.report.figure import write_figure  # imported where used: it brings matplotlib

    windows = write_figure(
        read_comparison(options.folder), options.output, rules, options.crops, options.metric,
        exposure=options.exposure, width=options.width, errors=options.errors,
    )  # fmt: skip
    crops = " ".join(",".join(map(str, window)) for window in windows)
    say(f"{options.output}: --crops {crops}")
    return 0


def play(options: argparse.Namespace) -> int:
    """Run ``play`` and return its exit code."""
    from dmis.report.play import play_page

    check_page(options.output)
    check_package("jinja2", "a page", "pip install 'dmis[plot]'")
    scene = load(options, options.scene)
    with progress_bar(options.quiet) as progress:
        page = play_page(
            scene, options.spp, options.patch, options.settings, parallel=options.threads, progress=progress
        )
    write_page(options.output, page)
    if not options.quiet:
        say(f"{options.output}: open it in a browser")
    return 0
