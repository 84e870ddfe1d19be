"""``check FILE.py``: what it finds in a file, what it prints, and exit codes."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import pytest

import dmis
from dmis.cli.commands import main
from dmis.testing.outcome import Outcome

DUST = """
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

import dmis
from dmis.brdf.lobe import CosineLobe, Lambert
from dmis.brdf.lobe import Lobe
from dmis.estimator.mis import BRDF


@dataclass(frozen=True, eq=False)
class Dust(CosineLobe):
    tint: Any = 0.5
    colours: ClassVar = ("tint",)

    def eval(self, directions):
        return self.tint * (0.3 * (1 - directions.cos_o) * (1 - directions.cos_i))
"""
MORE = """
class Tinted(Dust):
    def __init__(self, tint, gloss):
        raise TypeError


class Broken(Dust):
    def __init__(self):
        raise RuntimeError("not today")


class Other(dmis.Rule):
    def fit(self, pilot):
        return dmis.Fit(0.5)


class Third(dmis.Rule):
    def fit(self, pilot):
        return dmis.Fit(0.25)


lamp = dmis.PointLight((0, 0, 2), (1, 1, 1))
paint = dmis.Material((Lambert(0.5), Dust(0.2)))
again = replace(BRDF, name="again", rays="again")
dmis.register_technique(again)
dmis.register_technique(replace(again, name="hidden", rays="hidden", pdf=lambda s, d, p: BRDF.pdf(s, d, p)))
dmis.register_rule("third", Third)
dmis.register_sampler("mine", lambda block: None)
dmis.register_heuristic("own", lambda a, k: 1 / np.maximum(sum(a), 1e-30))
_private = Lambert(0.5)
"""


def write(folder: Path, text: str, name: str = "my_lobe.py") -> str:
    path = folder / name
    path.write_text(text, "utf-8")
    return str(path)


def test_a_right_lobe(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 0, a line for each check, and no file."""
    assert main(["check", write(tmp_path, DUST)]) == 0
    out, error = capsys.readouterr()
    lines = out.splitlines()
    assert lines[0] == "lobe Dust" and lines[-1] == "all 6 checks passed" and error == ""
    assert len(lines) == 8 and all(line.startswith("ok      Dust: ") for line in lines[1:-1])
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ""] == ["my_lobe.py"]


def test_the_page_shows_what_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The lobe of docs/extending.md and its messages, but for the digits."""
    page = (Path(dmis.__file__).parents[1] / "docs" / "extending.md").read_text("utf-8")
    blocks = [textwrap.dedent(block) for block in re.findall(r"(?:^(?: {4}.*)?\n)+", page, re.M)]
    (code,) = [block for block in blocks if "class Velvet(Lobe)" in block]
    head = DUST[: DUST.index("@dataclass")] + "from dmis.base.vectors import normalise\n"
    head += "from dmis.samplers.warp import INV_PI, square_to_sphere\n"
    assert main(["check", write(tmp_path, head + code)]) == 1
    out = capsys.readouterr().out
    assert out.endswith("3 of 6 checks failed\n")
    printed = re.sub(r"[\d.]+", "0", out)
    (shown,) = [block for block in blocks if "FAILED" in block]
    for line in shown.strip().split("FAILED")[1:]:
        assert re.sub(r"[\d.]+", "0", f"FAILED  {' '.join(line.split())}") in printed


def test_what_is_recognised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Objects, classes with defaults, registered names; others fail with the reason, and the exit code is 1."""
    for name in ("lobe", "light", "technique", "rule", "sampler"):
        monkeypatch.setattr(
            f"dmis.testing.find.check_{name}", lambda item, label="", *_: [Outcome(str(label), True, "")]
        )
    assert main(["check", write(tmp_path, DUST + MORE)]) == 1
    *lines, last = capsys.readouterr().out.splitlines()
    assert last == "2 of 11 checks failed"
    assert [line for line in lines if not line.startswith(("ok", "FAILED"))] == [
        "light lamp", "lobe paint.lobes[0]", "lobe paint.lobes[1]", "technique again", "lobe Tinted", "lobe Broken",
        "rule Other", "rule third", "technique hidden", "sampler mine", "heuristic own",
    ]  # fmt: skip
    assert [line for line in lines if line.startswith("FAILED")] == [
        "FAILED  Tinted: an object of the class: TypeError: Tinted.__init__() missing 2 required positional arguments: "
        "'tint' and 'gloss'. Give it defaults, or add an object: my_tinted = Tinted(...)",
        "FAILED  Broken: an object of the class: Broken.__init__ raised RuntimeError: not today (my_lobe.py, line 28). "
        "Give it defaults, or add an object: my_broken = Broken(...)",
    ]


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("a = 1", [], r"my_lobe\.py must define something to check; it defines none of: classes that derive from Lobe"),
        ("1 / 0", [], r"plugin .* raised ZeroDivisionError: .* \(my_lobe\.py, line 1\)"),
        (None, [], r"no such plugin: .*my_lobe\.py; a plugin must be a Python file"),
        (DUST, ["--albedo", "1,2"], "must be one number from 0 to 1, or four .*; got '1,2'"),
        (DUST, ["--albedo", "nan"], "must be one number from 0 to 1"),
        ("import dmis\nlamp = dmis.PointLight((0, 0, 2), (1, 1, 1))", ["--albedo", "1"], "defines none"),
    ],
)
def test_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused, text: str | None, options: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    if text is not None:
        write(tmp_path, text)
    assert re.search(message, refused(["check", "my_lobe.py", *options]))
