"""Every exercise: its starter fails its check, its solution passes; bad files get a clear message."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from dmis.fit.registry import RULES
from dmis.testing.exercises import EXERCISES, LAST, check_exercise
from dmis.testing.outcome import Outcome

FOLDER = Path(__file__).parents[2] / "docs" / "exercises"
STARTERS = sorted(FOLDER.glob("[0-9][0-9]_*.py"))


@pytest.fixture(autouse=True)
def forget_rules() -> Iterator[None]:
    """Starter and solution register the same name."""
    known = dict(RULES)
    yield
    RULES.clear()
    RULES.update(known)


def load(path: Path) -> ModuleType:
    """Return a file as a module, as the command ``check`` loads it."""
    spec = importlib.util.spec_from_file_location(f"exercise_{path.stem}_{path.parent.name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def outcomes(path: Path) -> list[Outcome]:
    """Return the outcomes of the exercise whose number begins the name of a file."""
    return EXERCISES[int(path.name[:2])](load(path))


def test_files_and_checks_have_the_same_numbers() -> None:
    """A starter, a solution and a check for each of 1 to 21."""
    assert [int(path.name[:2]) for path in STARTERS] == sorted(EXERCISES) == list(range(1, LAST + 1))
    assert [path.name for path in sorted((FOLDER / "solutions").glob("*.py"))] == [path.name for path in STARTERS]


@pytest.mark.parametrize("path", STARTERS, ids=lambda path: path.stem)
def test_starter_fails(path: Path) -> None:
    """It names what is wrong, and does not end in an exception of the check."""
    failed = [outcome for outcome in outcomes(path) if not outcome.passed]
    assert failed and all(len(outcome.message) > 20 for outcome in failed)


@pytest.mark.parametrize("path", STARTERS, ids=lambda path: path.stem)
def test_solution_passes(path: Path) -> None:
    """All of its outcomes, of which there are several."""
    results = outcomes(FOLDER / "solutions" / path.name)
    assert len(results) > 1
    assert [f"{outcome.name}: {outcome.message}" for outcome in results if not outcome.passed] == []


WRONG: dict[str, tuple[int, str, str, str]] = {
    "density per area": (
        2,
        "return np.where",
        "return np.full(p.shape[1], 1 / area) + 0 * np.where",
        "expected 0\\.4347\\d* on average, got 2 in each of 100000 estimates",
    ),
    "emits ignored": (3, "sample.emits", "sample.pdf > 0", "count 0 where sample.emits is False"),
    "no density": (3, "np.maximum(sample.pdf, 1e-12)", "1", "divide by sample.pdf"),
    "no cosine": (3, "radiance * cos", "radiance", "The cosine between n and sample.wi is missing"),
    "no horizon": (3, "cos = np.maximum(", "cos = np.add(", "below the surface counts 0"),
    "no pi": (3, "albedo / np.pi", "albedo", "albedo / pi"),
    "equal numbers": (
        11,
        "return light.sum(axis=0) + brdf.sum(axis=0)",
        "return (f_l / (p_ll + p_bl)).mean(axis=0) + (f_b / (p_lb + p_bb)).mean(axis=0)",
        r"A sample counts f / \(n_l p_l \+ n_b p_b\)",
    ),
    "a little too dark": (15, "return share", "return 0.999 * share", "weights of both passes must sum to 1"),
    "weights from the image": (
        15,
        "share = len(pilot) / (len(pilot) + len(final))",
        "a, b = (len(x) / (x.var() + 1e-9) for x in (pilot, final)); share = a / (a + b)",
        "Fix them before any sample is seen",
    ),
    "biased variances": (18, "ddof=1", "ddof=0", "need n - 1"),
    "swapped shares": (18, "w * v_l + (1 - w) * v_b", "(1 - w) * v_l + w * v_b", "The shares are swapped"),
    "a constant share": (
        21,
        "return dmis.Fit(",
        "return dmis.Fit(0.75) or dmis.Fit(",
        "No share is good on both scenes",
    ),
    "a shipped fit": (
        21,
        "\n\ndmis.register_rule",
        '\n\nclass Mine(type(dmis.make_rule("second-moment"))):\n    pass\n\n\ndmis.register_rule',
        r"Mine must define fit\(self, pilot\); it has that of dmis\.fit\.second_moment",
    ),
}


@pytest.mark.parametrize(("number", "right", "wrong", "message"), WRONG.values(), ids=WRONG)
def test_wrong_answer_fails(number: int, right: str, wrong: str, message: str) -> None:
    """A solution with a likely mistake; the message names it."""
    (path,) = (FOLDER / "solutions").glob(f"{number:02}_*.py")
    text = path.read_text("utf-8")
    assert right in text
    module = ModuleType("mine")
    exec(compile(text.replace(right, wrong), "mine.py", "exec", dont_inherit=True), module.__dict__)
    failed = [outcome.message for outcome in EXERCISES[number](module) if not outcome.passed]
    assert failed and re.search(message, " ".join(failed)), failed


def test_starter_of_a_variance_curve_gets_its_own_advice() -> None:
    """One group in place of two is another mistake than n in place of n - 1."""
    (first, *_) = [outcome for outcome in outcomes(FOLDER / "18_unbiased_curve.py") if not outcome.passed]
    assert "One variance over all samples" in first.message


@pytest.mark.parametrize("path", STARTERS, ids=lambda path: path.stem)
def test_starter_says_how_to_check_it(path: Path) -> None:
    """The command is in the docstring, and how hard the exercise is."""
    text = path.read_text("utf-8")
    assert f"python -m dmis check mine.py --exercise {int(path.name[:2])}``" in text
    grades = {1: "easy", 2: "medium", 0: "hard"}
    assert text.startswith(f'"""Exercise {int(path.name[:2])} ({grades[int(path.name[:2]) % 3]}): ')


@pytest.mark.parametrize(
    "source, message",
    [
        ("", "the file must define mirror"),
        ("mirror = 3", "the file must define mirror"),
        ("def mirror(wo, n): return wo[:2]", r"mirror must return shape \(3, 1000\); got \(2, 1000\)"),
        ("def mirror(wo, n): return wo / 0", "mirror must return finite numbers; 3000 of 3000 are not"),
        ("def mirror(wo, n): return 'up'", r"mirror must return numbers of shape \(3, 1000\)"),
        ("def mirror(wo, n): return wo @ n", "mirror raised ValueError: .* line 1"),
        ("def mirror(wo): return wo", "takes 1 positional argument but 2 were given"),
    ],
)
def test_bad_function_gets_a_clear_message(source: str, message: str) -> None:
    """Missing, of the wrong shape, not finite, or raising an exception."""
    module = ModuleType("mine")
    exec(compile(source, "mine.py", "exec"), module.__dict__)
    *_, last = EXERCISES[1](module)
    assert not last.passed
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(last.message)


@pytest.mark.parametrize("number", [0, LAST + 1])
def test_unknown_exercise(number: int) -> None:
    """The message has the numbers that there are."""
    with pytest.raises(ValueError, match=f"1, 2, .*, {LAST}; got {number}"):
        check_exercise(number, ModuleType("mine"))
