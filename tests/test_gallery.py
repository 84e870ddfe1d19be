"""Options of the gallery's scripts: from a command line, from the environment, and in a notebook."""

import os
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

from dmis.examples.gallery import options


@pytest.fixture(autouse=True)
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty working directory, and no variables that matter."""
    monkeypatch.chdir(tmp_path)
    for name in ("DMIS_QUICK", "DMIS_PBRT_SCENES"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    "quick, words, size",
    [
        ("1", [], "quick"),
        ("0", [], "default"),
        ("1", ["--full"], "full"),
    ],
)
def test_size(quick: str, words: list[str], size: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """DMIS_QUICK is a default that the command line overrides."""
    monkeypatch.setenv("DMIS_QUICK", quick)
    monkeypatch.setattr("sys.argv", ["plot_any.py", *words])
    opts, _ = options("plot_any", "Title\n=====")
    assert opts.size == size and opts.pick("quick", "default", "full") == size
    assert opts.output == Path("figures/plot_any.png") and os.listdir("figures") == []


def test_kernel_has_no_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is there is the kernel's own; the script's options have their defaults."""
    monkeypatch.setattr("sys.argv", ["/lib/ipykernel_launcher.py", "-f", "/run/kernel-1.json"])
    opts, given = options("plot_any", None, seeds={"type": int, "default": 3})
    assert (opts.size, given.seeds) == ("default", 3)
