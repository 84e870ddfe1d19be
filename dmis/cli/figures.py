"""The commands ``figure``, ``table`` and ``diff``: what a paper shows of a comparison, and of two images."""

from __future__ import annotations

import argparse

from dmis.base.atomic_files import check_package, check_writable, replacing
from dmis.cli.shared import say
from dmis.experiment.metrics import flip, mse, relmse
from dmis.experiment.reference import load_reference
from dmis.experiment.table import read_comparison
from dmis.report.compare import split_rules
from dmis.report.tables import paper_table


def figure(options: argparse.Namespace) -> int:
    """Run ``figure`` and return its exit code."""
    for package in ("matplotlib", "jinja2"):
        check_package(package, "a figure", "pip install 'dmis[plot]'")
    check_writable(options.output)
    from dmis.report.figure import write_figure  # imported where used: it brings matplotlib

    rules = split_rules(options.rules) if options.rules else []
    windows = write_figure(
        read_comparison(options.folder), options.output, rules, options.crops, options.metric,
        exposure=options.exposure, width=options.width, errors=options.errors,
    )  # fmt: skip
    crops = " ".join(",".join(map(str, window)) for window in windows)
    say(f"{options.output}: --crops {crops}")
    return 0


def table(options: argparse.Namespace) -> int:
    """Run ``table`` and return its exit code."""
    check_writable(options.output)
    comparison = read_comparison(options.folder)
    text = paper_table(comparison).text(options.output.suffix.lower())
    with replacing(options.output) as partial:
        partial.write_text(text, "utf-8")
    say(options.output, *filter(None, [comparison.few_pixels()]))
    return 0


def diff(options: argparse.Namespace) -> int:
    """Run ``diff`` and return its exit code."""
    if options.output is not None:
        check_package("matplotlib", "a map", "pip install 'dmis[plot]'")
        check_writable(options.output)
    reference = load_reference(options.reference)
    image = load_reference(options.image).mean.astype("f")
    if image.shape != reference.first.shape:
        sizes = " and ".join(f"{of.shape[1]}x{of.shape[0]}" for of in (image, reference.first))
        raise ValueError(f"images must have one size; got {sizes}")
    say(f"MSE     {mse(image, reference):.6g}", f"relMSE  {relmse(image, reference):.6g}")
    try:
        say(f"FLIP    {flip(image, reference).mean():.6g}")
    except ImportError as missing:
        if options.metric == "flip":
            raise ValueError(str(missing)) from missing
        say(f"FLIP    not measured: {missing}")
    if options.output is not None:
        from dmis.report.figure import write_error_map

        write_error_map(image, reference, options.metric, options.output)
        say(options.output)
    return 0
