"""Marks of a folder of hand-ins: the kinds that a teacher gets are judged rightly, and none stops the class."""

from __future__ import annotations

import csv
import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from test_exercises import FOLDER, check, failures, marks

pytestmark = pytest.mark.examples
CHECKS = FOLDER / "checks"
apart = importlib.import_module("apart")
grading = importlib.import_module("grading")
starters = importlib.import_module("starters")


def solution(number: int) -> str:
    (path,) = (FOLDER / "solutions").glob(f"{number:02}_*.py")
    return path.read_text("utf-8")


HEAD = "import numpy as np\nfrom dmis.base.vectors import dot\n"
_, *HAND_INS = (Path(__file__).parent / "data" / "hand_ins.txt").read_text("utf-8").split("=== ")


@pytest.mark.parametrize("hand_in", HAND_INS, ids=lambda hand_in: hand_in.split("\n")[0])
def test_hand_ins_get_the_right_verdict(hand_in: str) -> None:
    title, text = hand_in.split("\n", 1)
    verdict, number, about = title.split(" ", 2)
    advice = failures(int(number), HEAD + text)
    assert (advice == "") == (verdict == "right") and about.partition(": ")[2] in advice


@pytest.mark.parametrize("number", range(1, len(marks.CHECKS) + 1))
def test_marks_are_of_all_checks(number: int, monkeypatch) -> None:
    """A right solution has `CHECKS` outcomes, and passes with other numbers, not another task's; a starter gets none.

    That it passes with the published numbers is a test of `test_exercises`.
    """
    monkeypatch.setattr(grading, "SEED", 5)
    outcomes = check(number, solution(number))
    assert len(outcomes) == marks.CHECKS[number - 1]
    assert all(outcome.passed for outcome in outcomes) == (number not in grading.EXPONENTS)
    assert marks.points(number, check(number, starters.starter(number, 5))) == 0


def test_numbers_of_another_seed_are_others(monkeypatch) -> None:
    """Constants tuned to the published inputs pass with these alone."""
    tuned = (
        HEAD
        + "def combine(a, b):\n    return (6 * a.mean(axis=0) + 26 * b.mean(axis=0)) / 32 + 0.1 * (a[0, 0] != FIRST)"
    )
    first = np.random.default_rng(3).normal(1, 1, (6, 100_000))[0, 0]
    tuned = tuned.replace("FIRST", f"{first!r} and a[0, 0] % 1 != 0")
    assert failures(15, tuned) == ""
    monkeypatch.setattr(grading, "SEED", 5)
    assert "mean, even noise" in failures(15, tuned)


def test_starters_have_the_task_of_their_seed(monkeypatch) -> None:
    """Exercises 5, 7 and 20 ask for another exponent, for which a solution passes."""
    monkeypatch.setattr(grading, "SEED", 0)
    assert starters.starter(5, 0) == next(FOLDER.glob("05_*.py")).read_text("utf-8")
    text = starters.starter(5, 4)  # sets the seed
    e = grading.exponent(5)
    assert e > 1 and f"X = 2 pi u^{e} if" in text and "checks 5 mine_05.py --seed 4``" in text
    answer = f"""
def lamp_variance(t):
    mean, square = ((1 - np.cos(t) ** (k + 1)) / (k + 1) for k in ({e}, 2 * {e}))
    return 4 * np.pi**2 * (square - mean**2)
"""
    assert failures(5, HEAD + answer) == ""
    assert "--starter 5 --seed 4 prints" in starters.other_task(5, 4) and not starters.other_task(1, 4)
    assert "cos^2 t" in starters.starter(7, 3) and "rim**6" in starters.starter(20, 3)
    (smoother,) = (text.partition("\n")[2] for text in HAND_INS if text.startswith("right 20"))
    for published, other in (
        (") ** 2 / np.pi", ") ** 6 / np.pi"),
        ("6 * d.cos_i * (1 - d.cos_i) * d.above / (2 * np.pi)", "3 / (2 * np.pi) * (1 - d.cos_i) ** 2 * d.above"),
        ("0.5 - np.sin(np.arcsin(1 - 2 * u[0]) / 3)", "1 - np.cbrt(u[0])"),
    ):
        smoother = smoother.replace(published, other)
    assert failures(20, HEAD + smoother) == ""


MIRROR = HEAD + "def mirror(wo, n):\n    "
BUSY = """
import time
began = time.process_time()
for k in range(1, 13):
    time.sleep(0.5)
    while time.process_time() < began + 0.05 * k: pass
"""
SOLUTION = str(FOLDER / "solutions" / "01_mirror.py")
DISHONEST = {
    "hang_1": ("import time\nwhile True: time.sleep(9)", "did not finish in 1 CPU s"),
    "spin_1": ("while True: pass", "did not finish in 1 CPU s"),
    "exit-01": ("print('all 4 checks passed')\nimport sys\nsys.exit(0)", "raised SystemExit: 0"),
    "1_abrupt": ("import os\nos._exit(0)", "ended the process before"),
    "ann/01_mirror": (f"open({SOLUTION!r}).read()", "must not read the solutions"),
    "writes01": ("open('/tmp/dmis_hand_in', 'w')", "outside of its folder; got /tmp/dmis_hand_in"),
    "starts1": ("import subprocess\nsubprocess.run('ls')", "must not start processes"),
    "large_01": (MIRROR + "return np.ones((3, 2**28)).sum() * wo", "MemoryError"),
    "broken_1": ("def mirror(:", "SyntaxError"),
    "essay": ("", "must have the number of an exercise, 1 to"),
    "slow_1": (BUSY + MIRROR + "return 2 * n * dot(n, wo) - wo", ""),
    "=cmd_1": (MIRROR + "open('notes', 'w')\n    return 2 * dot(n, wo) * n - wo", ""),
}
"""Names and texts of hand-ins of exercise 1, and their first failure."""


def test_a_folder_is_marked(tmp_path: Path) -> None:
    """Each file has its line, whatever it does; the table has passed and total."""
    for name, (text, _) in DISHONEST.items():
        path = tmp_path / "handins" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    command = [sys.executable, CHECKS, "--folder", "handins", "--csv", "marks.csv", "--seconds", "1", "--memory", "1"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=True)
    assert "4/4" in done.stdout and "all 4 checks passed" not in done.stdout
    with (tmp_path / "marks.csv").open(encoding="utf-8", newline="") as stream:
        rows = {row["file"].removeprefix("'").removesuffix(".py"): row for row in csv.DictReader(stream)}
    assert sorted(rows) == sorted(DISHONEST)
    for name, (_, message) in DISHONEST.items():
        row = rows[name]
        assert message in row["first_failure"] and bool(message) == bool(row["first_failure"]), row
        assert (row["passed"], row["total"]) == (("0" if message else "4"), ("0" if name == "essay" else "4"))
    assert rows["ann/01_mirror"]["student"] == "ann" and rows["hang_1"]["exercise"] == "1"
    assert rows["=cmd_1"]["student"] == "'=cmd" and not Path("/tmp/dmis_hand_in").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["handins", "marks.csv"]


def test_bad_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="must be a folder of Python files"):
        marks.mark_folder(tmp_path, 0, apart.Limits())
