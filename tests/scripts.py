"""Runs scripts in the process of the tests, which saves most of their time: imports, and scenes that several load."""

from __future__ import annotations

import logging
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers import registries_kept, shared_scene

import dmis
from dmis.examples import gallery

ROOT = Path(__file__).resolve().parent.parent


def run_alone(run: Callable[[], Any], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Call `run` with a path, registries and settings of matplotlib that no other test changes or sees changed.

    The path is that of a script in `folder`. Modules that come from the folders of scripts are forgotten afterwards.
    """
    import matplotlib

    modules = set(sys.modules)
    path = [entry for entry in sys.path if Path(entry) not in (ROOT / "tests", ROOT / "examples", ROOT / "benchmarks")]
    with monkeypatch.context() as patch, matplotlib.rc_context(), registries_kept():
        matplotlib.use("agg")
        patch.setattr(sys, "path", [str(folder), *path])
        patch.setattr(dmis, "load_scene", shared_scene)
        patch.setattr(gallery, "load_scene", shared_scene)
        patch.delenv("DMIS_PBRT_SCENES", raising=False)
        try:
            run()
        finally:
            for name in set(sys.modules) - modules:
                file = getattr(sys.modules[name], "__file__", None) or ""
                if Path(file).parent in (ROOT / "examples", ROOT / "benchmarks"):
                    del sys.modules[name]


@pytest.fixture
def run_script(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture, caplog: pytest.LogCaptureFixture):
    """Function that runs a script with arguments and returns what it prints; a word on standard error fails the test.

    Warnings that are logged would be on standard error, too; other warnings are errors in all tests.
    """

    def run(script: Path, *arguments: str | Path) -> str:
        monkeypatch.setattr(sys, "argv", [str(script), *map(str, arguments)])
        code: Any = None
        capfd.readouterr()
        try:
            run_alone(lambda: runpy.run_path(str(script), run_name="__main__"), script.parent, monkeypatch)
        except SystemExit as end:
            code = end.code
        printed = capfd.readouterr()
        assert not code and printed.err == ""
        assert [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING] == []
        return printed.out

    return run
