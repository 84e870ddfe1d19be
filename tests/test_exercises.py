"""The exercises: each starter fails its check, each solution passes; likely mistakes get advice."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from dmis.testing.outcome import Outcome

pytestmark = pytest.mark.examples
FOLDER = Path(__file__).parents[1] / "docs" / "exercises"
STARTERS = sorted(FOLDER.glob("[0-9][0-9]_*.py"))
sys.path.append(str(FOLDER / "checks"))
EXERCISES = importlib.import_module("exercises").EXERCISES
marks = importlib.import_module("marks")


def check(number: int, text: str) -> list[Outcome]:
    """Return the outcomes of an exercise for the text of a file."""
    module = ModuleType("mine")
    sys.modules["mine"] = module  # where dataclasses look up their annotations
    exec(compile(text, "mine.py", "exec", dont_inherit=True), module.__dict__)
    return EXERCISES[number](module)


def failures(number: int, text: str) -> str:
    return "\n".join(f"{o.name}: {o.message}" for o in check(number, text) if not o.passed)


@pytest.mark.parametrize("path", STARTERS, ids=lambda path: path.stem)
def test_starter_fails_and_solution_passes(path: Path) -> None:
    """The starter gets no marks, and is told why; the solution gets all of several. The docstring has the command."""
    number, text = int(path.name[:2]), path.read_text("utf-8")
    outcomes = check(number, text)
    assert marks.points(number, outcomes) == 0
    failed = [outcome for outcome in outcomes if not outcome.passed]
    assert failed and all(len(outcome.message) > 20 for outcome in failed)
    results = check(number, (FOLDER / "solutions" / path.name).read_text("utf-8"))
    assert len(results) > 1 and marks.points(number, results) == marks.marks_of(number) >= 1
    assert [f"{o.name}: {o.message}" for o in results if not o.passed] == []
    assert f"``python docs/exercises/checks {number} mine_{int(number):02}.py``" in text
    assert text.startswith(f'"""Exercise {number} ({("hard", "easy", "medium")[number % 3]}): ')


def test_starters_solutions_and_checks_have_the_same_numbers() -> None:
    names = [path.name for path in STARTERS]
    assert sorted(path.name for path in (FOLDER / "solutions").glob("*.py")) == names
    assert [int(name[:2]) for name in names] == sorted(EXERCISES) == list(range(1, 25))


MISTAKES: list[tuple[int, str, str, str]] = [
    (2, "return np.where", "return np.full(p.shape[1], 1 / area) + 0 * np.where", "got 2 in each of 100000"),
    (3, "sample.emits", "sample.pdf > 0", "count 0 where sample.emits is False"),
    (3, "np.maximum(sample.pdf, 1e-12)", "1", "divide by sample.pdf"),
    (3, "radiance * cos", "radiance", "The cosine between n and sample.wi is missing"),
    (3, "cos = np.maximum(", "cos = np.add(", "below the surface counts 0"),
    (3, "albedo / np.pi", "albedo", "albedo / pi"),
    (15, "return share", "return 0.999 * share", "weights of both passes must sum to 1"),
    (
        15,
        "share = len(pilot) / (len(pilot) + len(final))",
        "a, b = (len(x) / (x.var() + 1e-9) for x in (pilot, final)); share = a / (a + b)",
        "Fix them before any sample is seen",
    ),
    (18, "ddof=1", "ddof=0", "need n - 1"),
    (18, "w * v_l + (1 - w) * v_b", "(1 - w) * v_l + w * v_b", "The shares are swapped"),
    (22, "q[met] * distance", "distance", "the probability q of the lamp is missing"),
    (22, "(met >= 0) & (cos_l > 0)", "cos_l != 0", "cos_l is not positive"),
    (23, "mirrored, f, shared", "mirrored, f / (p_l + 1), shared", "its weight is 1"),
    (23, "f / np.where(total > 0, total, 1)", "f / np.where(by_brdf, p_b, p_l).clip(1e-9)", "whichever drew the row"),
    (24, "counts = mirrored[k]", "counts[:] = True", "is there twice"),
    (24, "counts = mirrored[k]", "counts[:] = False", "what its ray meets must count"),
    (24, "counts, emitted[k]", "mirrored[k], emitted[k]", "What the camera sees counts"),
    (
        24,
        "total = total + throughput",
        "throughput = throughput * factor[k]; total = total + throughput",
        "steps before",
    ),
]


@pytest.mark.parametrize(("number", "right", "wrong", "message"), MISTAKES, ids=[m for *_, m in MISTAKES])
def test_advice_names_the_mistake(number: int, right: str, wrong: str, message: str) -> None:
    (path,) = (FOLDER / "solutions").glob(f"{number:02}_*.py")
    text = path.read_text("utf-8")
    assert right in text and message in failures(number, text.replace(right, wrong))


@pytest.mark.parametrize(
    "text, message",
    [
        ("mirror = 3", "the file must define mirror"),
        ("def mirror(wo, n): return wo[:2]", "mirror must return shape (3, 1000); got (2, 1000)"),
        ("def mirror(wo, n): return wo / 0", "mirror must return finite numbers; 3000 of 3000 are not"),
        ("def mirror(wo, n): return 'up'", "mirror must return numbers of shape (3, 1000)"),
        ("def mirror(wo, n): return wo @ n", "mirror raised ValueError: "),
        ("def mirror(wo, n): exit(0)", "mirror raised SystemExit: 0 (mine.py, line 1)"),
    ],
)
def test_bad_function_gets_a_clear_message(text: str, message: str) -> None:
    assert message in failures(1, text)


@pytest.mark.parametrize(
    ("text", "code", "printed"),
    [
        ("def mirror(wo, n): return 2 * n * (n * wo).sum(axis=0) - wo", 0, "all 4 checks passed"),
        ("import os\ndef mirror(wo, n): os._exit(0)", 1, "ended the process before its check was complete"),
        ("1 / 0", 2, "raised ZeroDivisionError: division by zero (my_answer.py, line 1)"),
    ],
)
def test_the_command(tmp_path: Path, text: str, code: int, printed: str) -> None:
    """It needs the folder of the checks and dmis, and says pass, fail or neither by its exit code."""
    file = tmp_path / "my_answer.py"
    file.write_text(text, "utf-8")
    command = [sys.executable, str(FOLDER / "checks"), "1", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert (done.returncode, printed in done.stdout + done.stderr) == (code, True), done
