"""What the pages, tutorials and examples show runs as it stands; links lead somewhere."""

import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("[0-9]_*.py"))
CODE = {page: re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.S) for page in PAGES}


@pytest.mark.parametrize("page", [page for page, blocks in CODE.items() if blocks], ids=lambda page: page.name)
def test_python_blocks_run(page, tmp_path, monkeypatch):
    """Every Python block of a page, one after the other, in an empty folder."""
    from dmis.rules import RULES

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DMIS_CACHE", str(tmp_path / "cache"))
    known = dict(RULES)
    namespace: dict = {"__name__": "page"}
    try:
        for code in CODE[page]:
            exec(compile(code, str(page), "exec"), namespace)
    finally:
        RULES.clear()
        RULES.update(known)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """References that tutorials share, as they do for a reader."""
    return tmp_path_factory.mktemp("references")


@pytest.mark.parametrize("tutorial", TUTORIALS, ids=lambda tutorial: tutorial.stem)
def test_tutorial_runs(tutorial, cache, tmp_path):
    """From any folder, without a word on standard error; where there is no screen it leaves its pictures as files."""
    pytest.importorskip("matplotlib")
    from PIL import Image

    done = subprocess.run(
        [sys.executable, tutorial],
        cwd=tmp_path,
        env={**os.environ, "DMIS_CACHE": str(cache), "MPLBACKEND": "agg", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (done.returncode, done.stderr) == (0, "")
    pictures = sorted((tmp_path / "figures" / "tutorials").iterdir())
    assert len(pictures) > 1 and "nan" not in done.stdout
    assert done.stdout.split()[-len(pictures) :] == [str(path.relative_to(tmp_path)) for path in pictures]
    for picture in pictures:
        with Image.open(picture) as image:
            assert min(image.size) > 200


def anchors(page: Path) -> set[str]:
    """What a link may point at in a page: its headings, as code hosts name them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.M)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    """Each local link to a file that is there, and to a heading of it."""
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text("utf-8")):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path) if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_public_names_are_in_the_reference():
    """The page about them lists each where it lives, and nothing else; each has a docstring of its own."""
    import dmis

    names = {name for name, value in vars(dmis).items() if not name.startswith("_") and not inspect.ismodule(value)}
    listed = re.findall(r"^   ~(dmis\.\w+)\.(\w+)$", (ROOT / "docs" / "api.rst.txt").read_text("utf-8"), re.M)
    assert {name for _, name in listed} == names
    for home, name in listed:
        value = getattr(sys.modules[home], name)
        assert value is getattr(dmis, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            assert value.__module__ == home and len(value.__doc__) > 40


def test_every_module_is_in_the_page_about_the_code():
    """Where things are, by name; those that read pbrt files are one entry."""
    page = (ROOT / "docs" / "code.md").read_text("utf-8")
    modules = {path.stem for path in (ROOT / "dmis").glob("*.py")} - {"__init__"}
    assert [name for name in sorted(modules) if f"`{name}`" not in page and not name.startswith("pbrt_")] == []


def test_demo_quick(tmp_path):
    """The demo prints its table and draws its picture."""
    picture = tmp_path / "demo.png"
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "demo.py", "--quick", "-o", picture],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.split("\n") if line.startswith(("| balance", "| thesis"))]
    assert len(rows) == 2 and rows[0].split("|")[-2].strip() == "1.000"
    assert picture.stat().st_size > 10_000


def test_demo_reference_states_its_error():
    """Two halves, and an error far below what the demo measures."""
    import dmis

    layers, attributes = dmis.read_exr(ROOT / "examples" / "data" / "teapot-area-light-400x400.exr")
    assert layers["first"].shape == layers["second"].shape == (400, 400, 3)
    assert 0 < float(attributes["mse"]) < 1e-5
