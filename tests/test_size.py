"""Sizes that a reader feels, which `make check` holds."""

from __future__ import annotations

import ast
import re
import subprocess
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

STEP = 50
ROOMS: dict[str, int] = {
    "base": 1_150,
    "bench": 850,
    "brdf": 2_450,
    "cli": 900,
    "dmis": 850,
    "doctor": 950,
    "estimator": 2_250,
    "experiment": 1_600,
    "fit": 2_350,
    "formats": 4_800,
    "geometry": 750,
    "light": 1_950,
    "pipeline": 1_950,
    "report": 1_150,
    "samplers": 900,
    "scene": 2_050,
    "testing": 1_350,
    "variance": 800,
    "benchmarks": 5_600,
    "tests": 25_000,
}
"""Lines of each room of the package, of its single modules, and of the other folders, rounded up to `STEP`."""
WORDS = 29_960
"""Words of the pages that a person writes: blocks that a script makes aside."""
LEAST_DOCSTRINGS = 0.23
"""Share of docstrings in the lines of the package."""
LONGEST_FUNCTION = 60
"""Lines of a function of the package."""
LONGEST_MODULE = 430
"""Lines of a module of the package."""
LONGEST_MODULES = {"pipeline/render.py": 104, "pipeline/job.py": 200, "scene/scene.py": 259, "fit/auto.py": 220}
"""Lines of the modules that tell how a render goes."""
RENDERS = {"thesis": (32, 1906), "auto": (40, 2832)}
"""Files, and lines with docstrings, that a small render with a rule calls."""
TOKENS, JOINED = 12.09, 16.3
"""Tokens of a line of code, and assignments such as ``a, b = 1, 2`` in 1,000 lines, of the package."""
MODULES, CLASSES = 94, 23
"""Modules of dmis that a render with equal shares imports, and classes whose methods it calls."""
FIELDS = {Batch: 8, Round: 13, Rule: 8}
"""Fields of the objects that go through a render; of a rule the attributes that a class of one's own may have."""


def python_files(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def lines_of(path: Path) -> int:
    return path.read_text("utf-8").count("\n")


def lines_of_rooms() -> dict[str, int]:
    """Return the lines of Python files by room."""
    lines: dict[str, int] = {}
    for folder in ("dmis", "tests", "benchmarks"):
        for path in python_files(folder):
            inside = folder == "dmis" and path.parent.name != "dmis"
            room = path.relative_to(ROOT / "dmis").parts[0] if inside else folder
            lines[room] = lines.get(room, 0) + lines_of(path)
    return lines


def ceilings_of(commit: str) -> dict[str, int]:
    """Return `ROOMS` of a commit; empty if there is none."""
    command = ["git", "-C", str(ROOT), "show", f"{commit}:tests/test_size.py"]
    text = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    found = re.search(r"^ROOMS[^=]*= (\{.*?^\})", text, re.S | re.M)
    return ast.literal_eval(found[1]) if found else {}


def test_rooms_have_the_lines_that_are_written_here() -> None:
    assert {room: -(-lines // STEP) * STEP for room, lines in lines_of_rooms().items()} == ROOMS


def test_a_ceiling_that_rises_lowers_another() -> None:
    """The sum is not above that of the commit before."""
    before = next((c for c in map(ceilings_of, ("HEAD", "HEAD~1")) if c and c != ROOMS), ROOMS)
    assert sum(ROOMS.values()) <= sum(before.values())


def test_code_is_written_out() -> None:
    _, tokens, joined = count_lines.style(python_files("dmis"))
    assert tokens <= TOKENS and joined <= JOINED


@pytest.mark.parametrize("of", FIELDS)
def test_fields(of: type) -> None:
    own = [name for name, value in vars(of).items() if not (name.startswith("_") or callable(value))]
    assert len(fields(of) if is_dataclass(of) else own) <= FIELDS[of]


def test_words_of_pages() -> None:
    pages = (ROOT / "docs").rglob("*.md")
    written = [page for page in pages if not {"_build", "generated"} & set(page.parts)]
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
    lines = count_lines.lines_called(count_lines.called_functions(scene, rule, 16))
    files, most = RENDERS[rule]
    assert len(lines) <= files and sum(described for _, described in lines.values()) <= most


def test_what_a_reader_meets() -> None:
    scene = count_lines.small_scene()
    dmis.render(scene, "balance", 16, parallel=1)
    assert len(count_lines.classes_called(count_lines.called_functions(scene, "balance", 16))) <= CLASSES
    assert len(count_lines.modules_imported()) <= MODULES
