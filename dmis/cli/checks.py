"""Commands that judge: ``check`` code of one's own, ``doctor`` a table of shading samples, ``bench-rules`` rules."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from dmis.base.plugins import load_plugin, raised
from dmis.bench.data import SCENES, path_of, read_truth
from dmis.bench.judge import BASELINES, report, report_json, score
from dmis.cli.shared import check_page, say
from dmis.doctor.diagnosis import diagnose, page
from dmis.fit.registry import RULES
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


def bench_rules(options: argparse.Namespace) -> int:
    """Run ``bench-rules`` and return its exit code."""
    scenes = options.scenes.split(",") if options.scenes else SCENES
    scores = {}
    for scene in scenes:  # before the rules, whose errors name their file
        read_truth(path_of(scene))
    rules = [(text, *item) for text in options.rules for item in rules_of(text).items()]
    rules = rules or [("", *item) for item in BASELINES.items()]
    for text, name, rule in rules:
        try:
            scores[name] = score(rule, scenes, range(options.seeds))
        except Exception as error:
            if not text.endswith(".py"):
                raise
            raise ValueError(f"{text}: {raised(error)}") from error
    say(report_json(scores) if options.format == "json" else report(scores))
    return 0


def rules_of(text: str) -> dict[str, Any]:
    """Return by name the rule of a text; or of a Python file its ``rule``, or else what it registers."""
    if not text.endswith(".py"):
        return {text: text}
    before = set(RULES)
    rule = getattr(load_plugin(text), "rule", None)
    if rule is not None:
        return {Path(text).stem: rule}
    registered = [name for name in RULES if name not in before]
    if not registered:
        raise ValueError(
            f"{text} must define a function rule(tables) that returns shares (height, width), set rule to a dmis.Rule, "
            f"or call dmis.register_rule; it does none of these"
        )
    return dict(zip(registered, registered, strict=True))
