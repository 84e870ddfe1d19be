"""The commands ``compare``, ``figure`` and ``play``, which write what `dmis.report` makes of renders."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from dmis.base.atomic_files import check_writable, replacing
from dmis.base.validate import check_package, one_of
from dmis.base.window import window_area
from dmis.cli.shared import check_page, describe, load, progress_bar, say, settings_of
from dmis.experiment.reference import load_reference, make_reference
from dmis.experiment.table import Comparison, read_comparison
from dmis.fit.registry import make_rule
from dmis.pipeline.job import DEFAULT_SPP
from dmis.report.compare import can_draw, check_output, check_reference, parse_rules, split_rules
from dmis.report.compare import compare as compare_rules
from dmis.report.tables import PAPER, STYLES, overview, paper_table, paper_titles, summary
from dmis.report.templates import write_page
from dmis.scene.scene import Scene

FORMATS = (".pdf", ".png", ".svg", ".html", *STYLES)
"""Extensions of pictures, of a page, and of tables."""


def compare(options: argparse.Namespace) -> int:
    """Run ``compare`` and return its exit code."""
    parse_rules(options.rules)
    names = [Path(scene).stem for scene in options.scene]
    if len(set(names)) < len(names):
        raise ValueError(f"scenes must have different names, which are those of their folders; got {', '.join(names)}")
    if len(names) > 1 and options.reference is not None:
        raise ValueError(f"--reference needs one scene; got {len(names)}. Without --reference dmis renders references")
    folders = [options.output / name for name in names] if len(names) > 1 else [options.output]
    for folder in folders:
        check_output(folder)  # before a reference is rendered
    scenes = [load(options, scene) for scene in options.scene]
    comparisons = [_compare_scene(options, *each) for each in zip(scenes, folders, strict=True)]
    if len(names) == 1:
        return 0
    if not options.quiet:
        say(overview(comparisons).text())
    if can_draw():
        from dmis.report.page import write_report  # imported where used: it brings matplotlib

        page = options.output / "report.html"
        write_report(comparisons, page)
        if not options.quiet:
            say(page)
    return 0


def _print_run(rule: str, done: int, total: int) -> None:
    """Print a line about a finished render."""
    say(f"{time.strftime('%H:%M:%S')} [{done}/{total}] {rule}")


def _compare_scene(options: argparse.Namespace, whole: Scene, output: Path) -> Comparison:
    """Compare the rules on a scene, write the results into the folder `output`, and return the comparison."""
    rules = parse_rules(options.rules)
    scene = whole if options.crop is None else whole.crop(options.crop)
    spp = options.spp or [(scene.suggested.spp if options.as_in_file else None) or DEFAULT_SPP]
    if options.verbose:
        say(describe(scene))
    with progress_bar(options.quiet) as progress:
        settings = settings_of(options, scene)
        of_renders: dict[str, Any] = {"settings": settings, "parallel": options.threads, "progress": progress}
        if options.reference is not None:
            reference = load_reference(options.reference, whole, settings)
            check_reference(reference, whole)
            reference = reference.cropped(window_area(options.crop, whole.camera.resolution))
        else:
            reference = make_reference(scene, options.reference_spp, **of_renders)
        if options.verbose:
            of_renders["progress"] = _print_run
        seeds = range(options.seed, options.seed + options.seeds)
        comparison = compare_rules(scene, rules, spp, seeds, reference, output, **of_renders)
    for rule, n in [(rule, n) for n in spp for rule in rules if (rule, n) not in comparison.runs]:
        pilot = sum(make_rule(rule).pilot.values())
        why = f"because its pilot takes {pilot}: use --spp {pilot + 1} or more"
        say(f"dmis: {rule} is skipped at {n} samples per pixel, {why}", error=True)
    if not options.quiet:
        say(summary(comparison))
        say(*filter(Path.exists, (output / name for name in ("results.csv", "report.html"))))
    return comparison


def figure(options: argparse.Namespace) -> int:
    """Run ``figure`` and return its exit code."""
    style = one_of("extension of a figure", options.output.suffix.lower(), FORMATS)
    check_writable(options.output)
    rules = split_rules(options.rules) if options.rules else []
    if style in STYLES:
        comparison = read_comparison(options.folder)
        titles = paper_titles(options.metric) if options.metric else PAPER
        text = paper_table(comparison, rules, titles).text(style)
        with replacing(options.output) as partial:
            partial.write_text(text, "utf-8")
        say(options.output, *filter(None, [comparison.few_pixels()]))
        return 0
    for package in ("matplotlib", "jinja2"):
        check_package(package, "a figure", "pip install 'dmis[plot]'")
    from dmis.report.figure import write_figure  # imported where used: it brings matplotlib

    windows = write_figure(
        read_comparison(options.folder), options.output, rules, options.crops, options.metric or "relmse",
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
