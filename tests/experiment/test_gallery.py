"""Options of the gallery's scripts: from a command line, from the environment, and in a notebook."""

import os
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

from dmis.experiment.gallery import SCENES, options


@pytest.fixture(autouse=True)
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty working directory, and no variables that matter."""
    monkeypatch.chdir(tmp_path)
    for name in ("DMIS_QUICK", "DMIS_PBRT_SCENES"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    "quick, words, size",
    [
        (None, [], "default"),
        ("1", [], "quick"),
        ("0", [], "default"),
        ("1", ["--full"], "full"),
        ("", ["--quick"], "quick"),
    ],
)
def test_size(quick: str | None, words: list[str], size: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """DMIS_QUICK is a default that the command line overrides."""
    if quick is not None:
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


def test_scenes_shrink(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sizes of the thesis, divided."""
    monkeypatch.setattr("sys.argv", ["plot_any.py", "--quick"])
    opts, _ = options("plot_any", "Title")
    for name, about in SCENES.items():
        assert opts.scene(name).camera.resolution == tuple(round(side / 16) for side in about.size)
    assert opts.scene("tt", 100).camera.resolution == (15, 8)
