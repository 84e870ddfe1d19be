"""What the pages, tutorials and examples show runs as it stands; links lead somewhere."""

import ast
import inspect
import json
import logging
import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import Z_LIMIT, run_cell, shared_scene
from scripts import run_alone, run_script  # noqa: F401  # a fixture

import dmis

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("[0-9]_*.py"))
CODE = {page: re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.S) for page in PAGES}


@pytest.mark.examples
@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize("page", [page for page, blocks in CODE.items() if blocks], ids=lambda page: page.name)
def test_python_blocks_run(page, tmp_path, monkeypatch):
    """Every Python block of a page, one after the other, in an empty folder."""
    monkeypatch.setattr(dmis, "load_scene", shared_scene)
    monkeypatch.chdir(tmp_path)
    namespace: dict = {"__name__": "page"}
    for k, code in enumerate(CODE[page]):
        code = code.replace("(200, 200)", "(40, 40)").replace("spp=128", "spp=32")  # of README.md
        run_cell(code, f"<{page.name}, block {k}>", namespace)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """References that tutorials share, as they do for a reader."""
    return tmp_path_factory.mktemp("references")


@pytest.mark.examples
@pytest.mark.parametrize("tutorial", TUTORIALS, ids=lambda tutorial: tutorial.stem)
def test_tutorial_runs(tutorial, cache, tmp_path, monkeypatch, capfd, caplog):
    """Small, in an empty folder, without a word on standard error; without a screen it leaves its pictures as files.

    Its text is run as a notebook's: there are no files beside it, and no ``__file__``. See `scripts`, too.
    """
    pytest.importorskip("matplotlib")
    from PIL import Image

    monkeypatch.chdir(tmp_path)
    text = tutorial.read_text("utf-8")
    for name, value in (("DMIS_CACHE", str(cache)), ("DMIS_QUICK", "1"), ("MPLBACKEND", "agg")):
        monkeypatch.setenv(name, value)
    variables = VARIABLES[tutorial.stem] = {"__name__": "__main__"}
    run_alone(lambda: run_cell(text, f"<{tutorial.name}>", variables), tmp_path, monkeypatch)
    printed = capfd.readouterr()
    assert printed.err == "" and not [record for record in caplog.records if record.levelno >= logging.WARNING]
    pictures = sorted((tmp_path / "figures" / "tutorials").iterdir())
    assert len(pictures) > 1 and "nan" not in printed.out
    assert printed.out.split()[-len(pictures) :] == [str(path.relative_to(tmp_path)) for path in pictures]
    for picture in pictures:
        with Image.open(picture) as image:
            assert min(image.size) > 200


VARIABLES: dict[str, dict] = {}
"""Variables of the tutorials that have been run in this process."""


def run(stem: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The variables of a tutorial, which is run at its small size in an empty folder, if it has not been run before."""
    if stem in VARIABLES:
        return SimpleNamespace(**VARIABLES[stem])
    pytest.importorskip("matplotlib").use("agg")
    monkeypatch.setenv("DMIS_QUICK", "1")
    monkeypatch.chdir(tmp_path)
    return SimpleNamespace(**runpy.run_path(str(ROOT / "docs" / "tutorials" / f"{stem}.py")))


@pytest.mark.examples
def test_one_batch_agrees_with_render(tmp_path, monkeypatch):
    """The image of tutorial 0 is that of `dmis.render` by z-tests: of its pixels, and of its mean."""
    batch = run("0_one_batch", tmp_path, monkeypatch)
    result = dmis.render(batch.scene, "balance", 64, seed=5, sampler="independent")
    difference = (batch.image - result.image)[..., 0]
    error = np.sqrt(batch.samples[0].var(axis=0, ddof=1) / batch.spp + result.variance[..., 0])
    assert abs(difference.sum() / np.sqrt((error**2).sum())) < Z_LIMIT
    z = difference[error > 0] / error[error > 0]
    assert np.all(difference[error == 0] == 0) and len(z) > 4000
    # a variance of 16 samples makes the tails those of Student's t: |t| > 3 in 0.9 % with 15 degrees of freedom
    assert 0.8 < z.std() < 1.15 and np.mean(np.abs(z) > 3) < 0.015


@pytest.mark.examples
def test_plates_of_both_techniques_are_the_image(tmp_path, monkeypatch):
    """Below the lamps the two plates of tutorial 3 add up to its image, pixel by pixel; the floor is blue."""
    mis = run("3_mis", tmp_path, monkeypatch)
    plates, image = (mis.light + mis.brdf)[mis.below], mis.result.image[mis.below]
    np.testing.assert_allclose(plates, image, rtol=1e-3, atol=1e-5)
    assert image.mean() > 0.05 and np.nanmedian(mis.part[-3:]) > 0.7


def prose(tutorial: Path) -> str:
    """Return the text of a tutorial: its docstring, and its comments at the start of a line."""
    text = tutorial.read_text("utf-8")
    comments = (line[1:] for line in text.split("\n") if line.startswith("#"))
    return "\n".join([ast.get_docstring(ast.parse(text)) or "", *comments])


@pytest.mark.parametrize("tutorial", TUTORIALS, ids=lambda tutorial: tutorial.stem)
def test_tutorial_is_a_lesson(tutorial):
    """It begins with goals, has formulas and three graded exercises, and is short; its lines fit on the page."""
    text, number = prose(tutorial), int(tutorial.name[0])
    assert "After this tutorial you can\n\n* " in text and ".. math::" in text and len(text.split()) <= 1200
    names = [path.name for k in range(1, 4) for path in (ROOT / "docs" / "exercises").glob(f"{3 * number + k:02}_*.py")]
    assert re.findall(r"``(\d\d_\w+\.py)``", text) == names and len(names) == 3
    graded = re.findall(r"^ *(\d+)\. \*(\w+)\.\* ", text, re.M)
    assert graded == [(str(3 * number + k), grade) for k, grade in enumerate(("Easy", "Medium", "Hard"), 1)]
    assert max(len(line) for line in tutorial.read_text("utf-8").split("\n")) <= 88


def test_pages_are_few_and_old_addresses_redirect(tmp_path):
    """At most 28 pages; each page that was removed has a stub that leads to one of them, with the anchor."""
    redirects = runpy.run_path(str(ROOT / "docs" / "redirects.py"))
    moved, stubs = redirects["MOVED"], redirects["stubs"]()
    pages = {page.stem for page in (ROOT / "docs").glob("*.md")} - moved.keys()
    assert len(pages) <= 28 and set(moved.values()) <= pages
    assert stubs.keys() == {f"{old}.html" for old in moved}
    for old, page in moved.items():
        text = stubs[f"{old}.html"]
        assert f'href="{page}.html"' in text and f'location.replace("{page}.html" + location.hash)' in text


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_page_is_short(page):
    """At most 1,500 words, tables and code aside; twice as many of what was measured, and of the thesis."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", page.read_text("utf-8"), flags=re.S)
    lines = [line for line in text.split("\n") if not line.startswith(("|", "    "))]
    assert len(" ".join(lines).split()) <= (3000 if page.name in ("results.md", "thesis.md") else 1500)


def test_five_paths():
    """README and the index show the same five lists of at most six pages, whose last lines lead on."""
    readme, index = ((ROOT / name).read_text("utf-8") for name in ("README.md", "docs/index.md"))
    bullets = re.findall(r"^\* \*\*(You .*?|Your .*?):\*\*(.*?)(?=^\S)", readme, re.M | re.S)
    lists = re.findall(r"^\*\*(You .*?|Your .*?)\.\*\*\n\n(.*?)\n\n", index, re.M | re.S)
    paths = [(name, re.findall(r"\]\(docs/(.*?)\)", links)) for name, links in bullets]
    assert paths == [(name, re.findall(r"\]\((.*?)\)", links)) for name, links in lists]
    assert len(paths) == 5 and all(2 <= len(links) <= 6 for _, links in paths)
    for _, links in paths:
        pages = [name for name in links if name.endswith(".md")]
        assert list(map(next_page, pages[:-1])) == pages[1:]
    for page in (ROOT / "docs").glob("*.md"):
        assert next_page(page.name) != page.name


def next_page(name):
    """Return the page to which the last paragraph of a page leads."""
    *_, last = (ROOT / "docs" / name).read_text("utf-8").rstrip().split("\n\n")
    return re.match(r"Next: \[[^]]+\]\((.*?\.md)\)", last)[1]


def test_exercises_and_the_batch():
    """Each starter and each solution, once."""
    text = (ROOT / "docs" / "syllabus.md").read_text("utf-8")
    folder = ROOT / "docs" / "exercises"
    files = [path.relative_to(folder.parent).as_posix() for path in folder.rglob("[0-9][0-9]_*.py")]
    assert sorted(re.findall(r"\]\((exercises/[^)]*\.py)\)", text)) == sorted(files)
    # from the first random number to the image in at most 40 lines of code
    text = (ROOT / "docs" / "tutorials" / "0_one_batch.py").read_text("utf-8")
    batch = text[text.index("# The batch") : text.index("# Four arrays")]
    lines = [line for line in batch.split("\n") if line.strip() and not line.startswith("#")]
    assert "stream(" in batch and lines[-1].startswith("image = ") and len(lines) <= 40


@pytest.mark.examples
def test_steps_of_the_thesis_agree_with_the_rule(tmp_path, monkeypatch):
    """Tutorial 4 finds the weights of the rule bit for bit from the same pilot; its image agrees by z-tests."""
    steps = run("4_thesis", tmp_path, monkeypatch)
    rule = dmis.make_rule(steps.rule)
    pilot = dict(zip((0.0, 0.5, 1.0), steps.moments, strict=True))
    assert dict(rule.pilot) == dict.fromkeys(pilot, 2)
    assert np.array_equal(rule.fit(pilot).weight, steps.weight) and np.ptp(steps.weight) > 0.5
    result = dmis.render(steps.scene, rule, 32, seed=11, sampler="independent")
    assert np.array_equal(steps.final.samples + 6, result.samples)  # the pilot's
    difference = (steps.final.image - result.image).mean(axis=-1)
    error = np.sqrt((steps.final.variance + result.variance).mean(axis=-1))
    assert abs(difference.sum() / np.sqrt((error**2).sum())) < Z_LIMIT
    z = difference[error > 0] / error[error > 0]
    assert len(z) > 3000 and np.mean(np.abs(z) > 3) < 0.02


def test_published_figures():
    """Each script has a small figure and says how it was made; those of the thesis have short captions and a link."""
    folder, page = ROOT / "docs" / "figures", (ROOT / "docs" / "thesis.md").read_text("utf-8")
    captions = json.loads((folder / "captions.json").read_text("utf-8"))
    scripts = {path.stem: path.parent.name for path in (ROOT / "examples").glob("*/plot_*.py")}
    assert set(scripts) == set(captions) == {path.stem for path in folder.glob("*.webp")}
    for stem, about in captions.items():
        assert (folder / f"{stem}.webp").stat().st_size <= 150_000
        assert re.fullmatch(r"\d{4}-\d\d-\d\d, commit [0-9a-f]{7,}, \d+ CPU seconds", about["made"])
        left, top, right, bottom = about["panel"]
        assert 0 <= left < right <= 1 and 0 <= top < bottom <= 1
        if scripts[stem] == "thesis":
            assert len(about["caption"].split()) <= 50
            assert f"](figures/{stem}.webp), [script](../examples/thesis/{stem}.py)" in page


def test_data_flow_names_modules():
    """The picture is on two pages, and its boxes of code are modules."""
    import xml.etree.ElementTree as xml

    picture = xml.parse(ROOT / "docs" / "images" / "data-flow.svg").getroot()
    texts, boxes = (list(picture.iter(f"{{http://www.w3.org/2000/svg}}{kind}")) for kind in ("text", "rect"))
    modules = {path.stem for path in (ROOT / "dmis").rglob("*")}
    code = [
        re.match(r"\w+", text.text)[0] for text, box in zip(texts, boxes, strict=True) if box.get("class") == "code"
    ]
    assert len(code) == 8 and set(code) <= modules
    for page in ("code.md", "index.md"):
        assert "](images/data-flow.svg)" in (ROOT / "docs" / page).read_text("utf-8")


def test_code_fits_a_page():
    """Lines of code have at most 88 columns: more would scroll beside the table of contents."""
    scripts = [*TUTORIALS, *(ROOT / "examples").glob("*/plot_*.py")]
    shown = {page.name: "\n".join(code) for page, code in CODE.items() if page.name != "README.md"}
    shown |= {path.name: path.read_text("utf-8").split('"""', 2)[2] for path in scripts}
    lines = [(name, line) for name, code in shown.items() for line in code.split("\n") if not line.startswith("#")]
    assert [(name, line) for name, line in lines if len(line) > 88] == []


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
    """The page about them lists each once, and nothing else; each has a docstring of its own."""
    pytest.importorskip("matplotlib")  # of `plot`
    listed = re.findall(r"^   dmis\.(\w+)$", (ROOT / "docs" / "api.rst.txt").read_text("utf-8"), re.M)
    assert sorted(listed) == dmis.__all__
    for name in listed:
        value = getattr(dmis, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            assert value.__module__ == dmis._HOMES[name] and len(value.__doc__) > 40


def test_every_room_is_in_the_page_about_the_code():
    """docs/code.md has a row for each room, and names no file that does not exist."""
    page = (ROOT / "docs" / "code.md").read_text("utf-8")
    rooms = {path.stem for path in (ROOT / "dmis").iterdir()} - {"__init__", "__main__", "__pycache__", "py"}
    rows = re.findall(r"^\| (`.*?`) \|", page, re.M)
    assert {name for row in rows for name in re.findall(r"`(\w+)/?`", row)} == rooms
    files = re.findall(r"`(\w+(?:/\w+)*\.py)`", page)
    assert [name for name in files if not (ROOT / "dmis" / name).exists() and not (ROOT / name).exists()] == []


@pytest.mark.examples
def test_demo_quick(run_script, tmp_path):  # noqa: F811
    """The demo prints its table and draws its picture."""
    picture = tmp_path / "demo.png"
    printed = run_script(ROOT / "examples" / "demo.py", "--quick", "-o", picture)
    rows = [line.split("|") for line in printed.split("\n") if line.startswith(("| balance", "| thesis", "| auto"))]
    assert [row[1].strip() for row in rows] == ["balance", "thesis", "auto"]
    balance, thesis, auto = ([float(cell) for cell in row[-3:-1]] for row in rows)
    assert balance == auto == [1, 1]  # auto learns from 16 samples per pixel on
    assert all(1.5 < ratio < 20 for ratio in thesis)  # 6 of 8 samples are its pilot
    assert picture.stat().st_size > 10_000
    # two halves, and an error far below what the demo measures
    layers, attributes = dmis.read_exr(ROOT / "examples" / "data" / "teapot-area-light-400x400.exr")
    assert layers["first"].shape == layers["second"].shape == (400, 400, 3)
    assert 0 < float(attributes["mse"]) < 1e-5
