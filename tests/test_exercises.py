"""The exercises: each starter fails its check, each solution passes; solutions written anew pass, wrong ones fail."""

from __future__ import annotations

import importlib
import re
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
    """Return the names and messages of failed outcomes, a line each."""
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
    assert f"``python docs/exercises/checks {number} mine.py``" in text
    assert text.startswith(f'"""Exercise {number} ({("hard", "easy", "medium")[number % 3]}): ')


def test_starters_solutions_and_checks_have_the_same_numbers() -> None:
    names = [path.name for path in STARTERS]
    assert sorted(path.name for path in (FOLDER / "solutions").glob("*.py")) == names
    assert [int(name[:2]) for name in names] == sorted(EXERCISES) == list(range(1, 25))


VELVET = """
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from dmis.brdf.lobe import Lobe

@dataclass(frozen=True, eq=False)
class Velvet(Lobe):
    reflectance: float
    colours: ClassVar = ("reflectance",)
    def eval(self, d):
        return self.reflectance * ((1 - d.cos_o) * (1 - d.cos_i)) ** 2 / np.pi
    def pdf(self, d):
        return DENSITY
    def sample(self, surface, u):
        cos = COSINE
        sin, phi = np.sqrt(1 - cos * cos), 2 * np.pi * u[1]
        s, t = surface.tangents
        return sin * np.cos(phi) * s + sin * np.sin(phi) * t + cos * surface.n
"""
RULE = """
import dmis
import numpy as np
from dmis.filter import gaussian
class Mine(dmis.Rule):
    pilot = {0.0: 2, 1.0: 2}
    settings = {"reuse_pilot": False}
    def fit(self, pilot):
        brdf, light = (pilot[k].variance().mean(axis=2) for k in (0.0, 1.0))
        h, w = brdf.shape
        SHARE
"""
SECOND = """
import numpy as np
def second_moment(x, d, w):
    m = 1 + (2 * w - 1)[:, None] * d
    y = np.divide(x * x, m, where=m > 0, out=0 * m)
    return """
BOTH = """
import numpy as np
def estimate(f_l, p_ll, p_bl, f_b, p_lb, p_bb):
    f, p, q = (np.vstack(x) for x in ((f_l, f_b), (p_ll, p_lb), (p_bl, p_bb)))
    k = len(f_l) / len(f)
    return (f / (k * p + (1 - k) * q)).mean(axis=0)
"""
MIRROR = "def mirror(wo, n):\n    n = n * (2 * (wo * n).sum(axis=0))\n    n -= wo\n    return n"
SMOOTH = "6 * d.cos_i * (1 - d.cos_i) * d.above / (2 * np.pi)", "0.5 - np.sin(np.arcsin(1 - 2 * u[0]) / 3)"
UNIFORM = "d.above / (2 * np.pi)", "u[0]"


def velvet(density: str, cosine: str) -> str:
    """Return a solution of exercise 20 with the density and the cosine of a sampled direction."""
    return VELVET.replace("DENSITY", density).replace("COSINE", cosine)


RIGHT = {
    "mirror, a copy in place": (1, MIRROR),
    "both techniques as one": (11, BOTH),
    "second moment": (17, SECOND + "y.sum(axis=1) / len(x)"),
    "velvet by tangents": (20, velvet(*SMOOTH)),
}
WRONG = {
    "normals as they are": (1, "def mirror(wo, n): return n", "wi and wo have the same angle to n"),
    "an argument changed": (1, "def mirror(wo, n):\n    wo[:] = n\n    return n", "the caller's: change a copy"),
    "equal numbers": (11, BOTH.replace("k = len(f_l) / len(f)", "k = 1 / 2"), r"A sample counts f / \(n_l p_l"),
    "light samples alone": (11, BOTH.replace("return ", "return (f_l / p_ll).mean(axis=0) #"), "the variance is"),
    "self-normalised": (17, SECOND + "y.sum(axis=1) / m.sum(axis=1)", "A sample at w is worth"),
    "squares alone": (17, SECOND + "(y * m).mean(axis=1)", "A sample at w is worth"),
    "velvet, uniform": (20, velvet(*UNIFORM), r"relative variance of f cos / p is 0\.37"),
    "velvet, another density": (20, velvet(UNIFORM[0], SMOOTH[1]), "samples follow the density"),
    "share by the height": (21, RULE.replace("SHARE", "return dmis.Fit(1.0 if h > 36 else 0.1)"), "learn it from the"),
    "a shipped fit": (21, "import dmis\nMine = type(dmis.make_rule('second-moment'))", "Mine must define fit"),
}


@pytest.mark.parametrize(("number", "text"), RIGHT.values(), ids=RIGHT)
def test_right_solutions_pass(number: int, text: str) -> None:
    assert failures(number, text) == ""


@pytest.mark.parametrize(("number", "text", "message"), WRONG.values(), ids=WRONG)
def test_wrong_solutions_fail(number: int, text: str, message: str) -> None:
    assert re.search(message, failures(number, text))


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
    """A solution with a likely mistake."""
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
