"""Sizes that a reader feels: `make check` fails above them, and raising one needs a reason in the commit."""

from __future__ import annotations

import ast
import re
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

import dmis
from dmis.estimator.batch import Batch
from dmis.fit.round import Round
from dmis.fit.rule import Rule

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))
import count_lines  # noqa: E402

LINES = {"dmis": 31_585, "tests": 31_315}
"""Lines of Python files: ceilings with room, not goals. Code that is written out is better than code that fits."""
WORDS = 44_000
"""Words of the pages that a person writes: blocks that a script makes, and docs/published.md, aside."""
LEAST_DOCSTRINGS = 0.23
"""Share of docstrings in the lines of the package."""
LONGEST_FUNCTION = 60
"""Lines of a function of the package."""
LONGEST_MODULE = 430
"""Lines of a module of the package."""
LONGEST_MODULES = {"pipeline/render.py": 106, "pipeline/job.py": 220, "scene/scene.py": 285, "fit/auto.py": 235}
"""Lines of the modules that tell how a render goes."""
RENDERS = {"thesis": (37, 2260), "auto": (48, 3040)}
"""Files, and lines with docstrings, that a small render with a rule calls."""
TOKENS, JOINED = 12.13, 20.0
"""Tokens of a line of code, and assignments such as ``a, b = 1, 2`` in 1,000 lines, of the package."""
FIELDS = {Batch: 8, Round: 13, Rule: 8}
"""Fields of the objects that go through a render; of a rule the attributes that a class of one's own may have."""


def python_files(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def lines_of(path: Path) -> int:
    return path.read_text("utf-8").count("\n")


@pytest.mark.parametrize("folder", LINES)
def test_lines(folder: str) -> None:
    assert sum(map(lines_of, python_files(folder))) <= LINES[folder]


def test_code_is_written_out() -> None:
    _, tokens, joined = count_lines.style(python_files("dmis"))
    assert tokens <= TOKENS and joined <= JOINED


@pytest.mark.parametrize("of", FIELDS)
def test_fields(of: type) -> None:
    own = [name for name, value in vars(of).items() if not (name.startswith("_") or callable(value))]
    assert len(fields(of) if is_dataclass(of) else own) <= FIELDS[of]


def test_words_of_pages() -> None:
    pages = (ROOT / "docs").rglob("*.md")
    written = [page for page in pages if not {"_build", "generated", "published.md"} & set(page.parts)]
    texts = [
        re.sub(r"<!-- ([^\n]+): begin -->.*?<!-- \1: end -->", "", p.read_text("utf-8"), flags=re.S) for p in written
    ]
    assert sum(len(text.split()) for text in texts) <= WORDS


def test_docstrings_and_functions() -> None:
    described, longest = 0, {}
    for path in python_files("dmis"):
        tree = ast.parse(path.read_text("utf-8"))
        described += sum(map(len, count_lines.docstrings(tree)))
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                longest[f"{path.name}: {node.name}"] = (node.end_lineno or 0) - node.lineno + 1
    assert described / sum(map(lines_of, python_files("dmis"))) >= LEAST_DOCSTRINGS
    assert {name: n for name, n in longest.items() if n > LONGEST_FUNCTION} == {}


def test_modules() -> None:
    assert max(map(lines_of, python_files("dmis"))) <= LONGEST_MODULE
    for name, most in LONGEST_MODULES.items():
        assert lines_of(ROOT / "dmis" / name) <= most, name


@pytest.mark.parametrize("rule", RENDERS)
def test_what_a_render_calls(rule: str) -> None:
    scene = count_lines.small_scene()
    dmis.render(scene, rule, 16, parallel=1)  # plan, tables and Embree scene are kept with the scene
    lines = count_lines.lines_called(scene, rule, 16)
    files, most = RENDERS[rule]
    assert len(lines) <= files and sum(described for _, described in lines.values()) <= most
