"""The notebooks of the site, and the scripts of the figures, with the installed package alone; dmis in a notebook."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
pytest.importorskip("matplotlib")

pytestmark = pytest.mark.examples
ROOT = Path(__file__).parent.parent
SCRIPTS = sorted((ROOT / "examples").glob("*/plot_*.py"))
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("?_*.py"))
QUICK = ("plot_fig_2_1_variance", "plot_models")
"""Notebooks that the fast tests run, too: of a scene of the thesis, of a script in ``scenes``."""
NO_CHECKOUT = """import os, sys
sys.path[:] = [entry for entry in sys.path if not os.path.exists(entry + "/pyproject.toml")]
"""
"""Module ``sitecustomize`` that takes editable installs from the path."""


@pytest.fixture(scope="session")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with what the wheel has, by the rules of pyproject.toml: the path of a Python that has no checkout."""
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["hatch"]["build"]["targets"]["wheel"]
    folder = tmp_path_factory.mktemp("packages")
    excluded = shutil.ignore_patterns(*(Path(pattern).name for pattern in rules["exclude"]))
    for part in rules["only-include"]:
        shutil.copytree(ROOT / part, folder / rules["sources"].get(part, part), ignore=excluded, dirs_exist_ok=True)
    (folder / "sitecustomize.py").write_text(NO_CHECKOUT, "utf-8")
    return folder


@pytest.fixture
def environment(packages: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Variables of a process that has `packages`, and an empty working directory."""
    values = {"PYTHONPATH": packages, "DMIS_QUICK": 1, "DMIS_CACHE": tmp_path / "1", "IPYTHONDIR": tmp_path / "2"}
    for name, value in values.items():
        monkeypatch.setenv(name, str(value))
    for name in ("DMIS_PBRT_SCENES", "MPLBACKEND"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")


def notebook(script: Path):
    """Return a script as a notebook: a cell of text or code for each block between lines of ``# %%``."""
    _, docstring, code = script.read_text("utf-8").split('"""', 2)
    cells = [nbformat.v4.new_markdown_cell(docstring.strip())]
    for block in re.split(r"^# %%.*\n", code, flags=re.M):
        comment = re.match(r"(?:#.*\n)*", block)[0]
        cells.append(nbformat.v4.new_markdown_cell(re.sub(r"^# ?", "", comment, flags=re.M)))
        cells.append(nbformat.v4.new_code_cell(block[len(comment) :].strip()))
    return nbformat.v4.new_notebook(cells=[cell for cell in cells if cell.source])


def run(page, python: str = sys.executable) -> list:
    """Run a notebook in the working directory, by the kernel of `python`; return the outputs of its cells."""
    client = nbclient.NotebookClient(page, timeout=1200, resources={"metadata": {"path": os.getcwd()}})
    client.create_kernel_manager()
    client.km.kernel_spec.argv[0] = python
    client.execute()
    return [output for cell in page.cells if cell.cell_type == "code" for output in cell.outputs]


def check_notebook(script: Path, python: str = sys.executable) -> None:
    """A figure's notebook ends with its figure, in the page and in the folder; none has a word on standard error."""
    outputs = run(notebook(script), python)
    assert [o for o in outputs if o.output_type == "stream" and o.name == "stderr" and "samples" not in o.text] == []
    images = [k for k, output in enumerate(outputs) if "image/png" in output.get("data", {})]
    if script in SCRIPTS:
        assert images[-1] == len(outputs) - 1
        files = {path.name for path in Path().rglob("*") if path.is_file()}
        assert f"{script.stem}.png" in files <= {f"{script.stem}.png", f"{script.stem}.pdf"}
    assert images


@pytest.mark.filterwarnings("ignore")  # of Jupyter's own
@pytest.mark.parametrize("name", QUICK)
def test_notebook_runs(name: str, environment: None) -> None:
    (script,) = (script for script in SCRIPTS if script.stem == name)
    check_notebook(script)


@pytest.mark.parametrize("name", ["plot_1d_mixture", "why_is_this_pixel_noisy"])
def test_script_runs_from_any_folder(name: str, environment: None) -> None:
    """A script of the checkout, in an empty folder, by a Python that has the wheel."""
    script = ROOT / "examples" / "explained" / f"{name}.py"
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert [str(path) for path in Path().rglob("*.png")] == [f"figures/{name}.png"]


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Python of a new environment that has the built wheel and its extras."""
    pytest.importorskip("build")
    folder = tmp_path_factory.mktemp("installed")
    build = [sys.executable, "-m", "build", "--wheel", "--outdir", folder, ROOT]
    python = folder / "venv" / "bin" / "python"
    for command in (build, [sys.executable, "-m", "venv", folder / "venv"]):
        subprocess.run(command, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    subprocess.run([python, "-m", "pip", "install", "--quiet", f"{wheel}[all]"], check=True, capture_output=True)
    return str(python)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Jupyter's own
@pytest.mark.parametrize("script", [*SCRIPTS, *TUTORIALS], ids=lambda script: script.stem)
def test_notebook_runs_with_the_wheel(
    script: Path, installed: str, environment: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONPATH")
    check_notebook(script, installed)


@pytest.mark.filterwarnings("ignore")  # of Jupyter's own
def test_bar_and_comparer_in_a_notebook(environment: None) -> None:
    """progress=True is a widget, and a comparer as a cell's last line is its page."""
    pytest.importorskip("tqdm")
    pytest.importorskip("ipywidgets")
    code = """
import dmis
scene = dmis.load_scene("killeroo-diffuse", resolution=(16, 12))
dmis.show({"balance": dmis.render(scene, "balance", 4, progress=True), "other": dmis.render(scene, "fixed:0", 4)})
"""
    page = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code)])
    bar, shown = run(page)
    assert "application/vnd.jupyter.widget-view+json" in bar.data
    assert shown.data["text/html"].startswith("<iframe ") and "balance" in shown.data["text/html"]
    assert os.listdir() == []
