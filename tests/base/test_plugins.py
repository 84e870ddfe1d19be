"""``--plugin FILE.py``: names of a user's own on the command line, and what is said where the file is wrong."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

import dmis
from dmis.base import plugins
from dmis.cli.commands import main
from dmis.image import read_exr

PLUGIN = """
from dataclasses import dataclass
import dmis

@dataclass(frozen=True)
class Third(dmis.Rule):
    w: float = 0.25

    def fit(self, pilot):
        return dmis.Fit(self.w)

dmis.register_rule("third", Third)
"""
SMALL = ("--resolution", "16x12", "--plugin")


def write(folder: Path, text: str = PLUGIN, name: str = "my_rules.py") -> str:
    path = folder / name
    path.write_text(text, "utf-8")
    return str(path)


def test_render_knows_a_rule_of_a_plugin(tmp_path: Path) -> None:
    """By its name, with its options; threads and processes render the same image."""
    files = [tmp_path / "threads.exr", tmp_path / "workers.exr"]
    words = ("render", "teapot-area-light", "--rule", "third:w=0.5", "--spp", "4", *SMALL, write(tmp_path))
    assert main([*words, "--threads", "2", "-o", str(files[0])]) == 0
    assert main([*words, "--workers", "2", "-o", str(files[1])]) == 0
    balance = dmis.render(dmis.load_scene("teapot-area-light", resolution=(16, 12)), "balance", 4)
    for layers in (read_exr(file)[0] for file in files):
        assert (layers["RGB"] == balance.image).all() and (layers["weight"] == 0.5).all()


TECHNIQUE = """
from dataclasses import replace
import dmis
from dmis.estimator.mis import LIGHT
dmis.register_technique(replace(LIGHT, name="again", rays="again"))
"""


def test_a_cluster_knows_what_a_plugin_registers(tmp_path: Path) -> None:
    """A technique is looked up by its name in each process."""
    out, plugin = str(tmp_path / "a.exr"), write(tmp_path, TECHNIQUE, "my_technique.py")
    rule = ("--rule", "fixed:again=0.5,brdf=0.5", "--spp", "4", *SMALL, plugin)
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=50) as local:
        assert main(["render", "teapot-area-light", "-o", out, "--cluster", local.scheduler_address, *rule]) == 0


@pytest.mark.usefixtures("drawn")
def test_every_command_has_plugins(tmp_path: Path, capsys) -> None:
    """`compare` measures the rule; `info` takes the option, which may be repeated."""
    plugin, other = write(tmp_path), write(tmp_path, "import my_rules\nprint('second')", "my_second.py")
    options = ("--rules", "third", "--spp", "4", *SMALL, plugin)
    compared = ("compare", "teapot-area-light", "--seeds", "2", "--reference-spp", "4", "-o", str(tmp_path / "out"))
    assert main([*compared, *options]) == 0
    assert "| 4 | third |" in capsys.readouterr().out
    assert main(["info", "--plugin", plugin, "--plugin", other]) == 0
    assert capsys.readouterr().out.startswith("second\ndmis ")


def test_a_plugin_without_a_rule_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It may define one and forget `register_rule`; a plugin with a rule is not blamed for a misspelt name."""
    silent = write(tmp_path, PLUGIN.replace("dmis.register_rule", "print"))
    options = ("render", "teapot-area-light", "--rule", "thrid", "-o", str(tmp_path / "a.exr"), *SMALL)
    assert main([*options, silent]) == 2
    advice = "my_rules.py registered no rule: end it with dmis.register_rule('thrid', ...), and the rule's class"
    assert advice in capsys.readouterr().err
    assert main([*options, write(tmp_path, name="my_other.py")]) == 2
    error = capsys.readouterr().err
    assert "registered no rule" not in error and "dmis.register_rule adds one" in error


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("absent.py", None, r"no such plugin: .*absent\.py; a plugin must be a Python file, or one of dmis: .*"),
        ("my_rules.txt", "", r"a plugin must be a Python file with a name such as my_rule\.py; got .*my_rules\.txt"),
        ("numpy.py", "", r"plugin .*numpy\.py must have another name, because numpy is a Python module already: .*"),
        (
            "my_rules.py",
            "\n\n1 / 0\n",
            r"plugin .*: <module> raised ZeroDivisionError: division by zero \(my_rules\.py, line 3\)",
        ),
        (
            "my_rules.py",
            "import dmis\ndmis.make_rule('nix')\n",
            r"plugin .*: <module> raised ValueError: rule must be one of .* \(my_rules\.py, line 2\)",
        ),
    ],
)
def test_errors_name_the_file_and_the_line(tmp_path: Path, capsys, name: str, text: str | None, message: str) -> None:
    """Exit code 2 and one line; the file can be mended and loaded then."""
    path = str(tmp_path / name) if text is None else write(tmp_path, text, name)
    before = list(sys.path)
    assert main(["info", "--plugin", path]) == 2
    out, error = capsys.readouterr()
    assert out == "" and re.fullmatch(f"dmis: error: {message}\n", error)
    assert sys.path == before and "my_rules" not in sys.modules
    assert plugins.loaded_plugins() == ()


def test_a_plugin_is_loaded_once(tmp_path: Path, capsys) -> None:
    plugin = write(tmp_path, "print('loaded')")
    assert main(["info", "--plugin", plugin, "--plugin", os.path.relpath(plugin)]) == 0
    assert capsys.readouterr().out.count("loaded") == 1
