"""The scripts of the gallery as notebooks, with dmis and `examples` alone; and dmis in a notebook."""

import os
import re
import sys
from pathlib import Path

import pytest

import dmis

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
pytest.importorskip("matplotlib")

ROOT = Path(__file__).parent.parent
SCRIPTS = sorted((ROOT / "examples").glob("*/plot_*.py"))
QUICK = ("plot_fig_2_1_variance",)
"""Scripts that the fast tests run, too: with a scene of the thesis and its reference."""


def notebook(script: Path):
    """Return a script as a notebook: a cell of text or code for each block between lines of ``# %%``."""
    _, docstring, code = script.read_text("utf-8").split('"""', 2)
    cells = [nbformat.v4.new_markdown_cell(docstring.strip())]
    for block in re.split(r"^# %%.*\n", code, flags=re.M):
        comment = re.match(r"(?:#.*\n)*", block)[0]
        cells.append(nbformat.v4.new_markdown_cell(re.sub(r"^# ?", "", comment, flags=re.M)))
        cells.append(nbformat.v4.new_code_cell(block[len(comment) :].strip()))
    return nbformat.v4.new_notebook(cells=[cell for cell in cells if cell.source])


def run(page, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list:
    """Run a notebook in `folder`; return the outputs of its cells.

    The only folder that Python is given besides the installed packages is one that has dmis and `examples` alone.
    """
    packages = folder.parent / "packages"
    packages.mkdir()
    for package in (Path(dmis.__file__).parent, ROOT / "examples"):
        (packages / package.name).symlink_to(package, target_is_directory=True)
    monkeypatch.setenv("PYTHONPATH", str(packages))
    monkeypatch.setenv("DMIS_QUICK", "1")
    monkeypatch.setenv("DMIS_CACHE", str(folder.parent / "cache"))
    monkeypatch.setenv("IPYTHONDIR", str(folder.parent / "ipython"))
    for name in ("DMIS_PBRT_SCENES", "MPLBACKEND"):
        monkeypatch.delenv(name, raising=False)
    folder.mkdir()
    client = nbclient.NotebookClient(page, timeout=1200, resources={"metadata": {"path": str(folder)}})
    client.create_kernel_manager()
    client.km.kernel_spec.argv[0] = sys.executable  # this Python's kernel, whatever others are installed
    client.execute()
    return [output for cell in page.cells if cell.cell_type == "code" for output in cell.outputs]


@pytest.mark.filterwarnings("ignore")  # of Jupyter's own
@pytest.mark.parametrize(
    "script",
    [pytest.param(s, marks=() if s.stem in QUICK else pytest.mark.slow, id=s.stem) for s in SCRIPTS],
)
def test_notebook_runs(script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It ends with its figure, in the page and in the folder, and has nothing to say on standard error."""
    page = notebook(script)
    outputs = run(page, tmp_path / "empty", monkeypatch)
    assert "image/png" in outputs[-1].data
    assert [o for o in outputs if o.output_type == "stream" and o.name == "stderr" and "samples" not in o.text] == []
    files = {path.name for path in (tmp_path / "empty").rglob("*") if path.is_file()}
    assert f"{script.stem}.png" in files <= {f"{script.stem}.png", f"{script.stem}.pdf"}


@pytest.mark.filterwarnings("ignore")  # of Jupyter's own
def test_bar_and_comparer_in_a_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """progress=True is a widget, and a comparer as a cell's last line is its page."""
    pytest.importorskip("tqdm")
    pytest.importorskip("ipywidgets")
    code = """
import dmis
scene = dmis.load_scene("killeroo-diffuse", resolution=(16, 12))
dmis.show({"balance": dmis.render(scene, "balance", 4, progress=True), "other": dmis.render(scene, "fixed:0", 4)})
"""
    page = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code)])
    bar, shown = run(page, tmp_path / "empty", monkeypatch)
    assert "application/vnd.jupyter.widget-view+json" in bar.data
    assert shown.data["text/html"].startswith("<iframe ") and "balance, other" in shown.data["text/plain"]
    assert os.listdir(tmp_path / "empty") == []
