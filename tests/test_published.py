"""Every table of the pages is made from committed rows or code alone, and every picture by the script that is there."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType

import code_tables
import frozen
import numpy as np
import publish
import pytest
from common import page_of
from pieces import GALLERY, PIECES, Piece

from dmis.fit.registry import make_rule

ROOT = Path(__file__).parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
OTHER_FILES = {
    "images/data-flow.svg": "drawn by hand",
    "images/cluster.svg": "drawn by hand",
    "images/samples.svg": "drawn by hand",
    "images/explain.webp": "drawn by the command of docs/explain.md",
    "images/play.png": "a screenshot of the play page",
    "images/paper-figure.png": "made by the commands of docs/cli.md",
    "figures/captions.json": "titles and captions of all figures",
    "tables/reproduction-full.csv": "made by commit c8bbb91, in hours",
    "tables/reproduction-original.csv": "needs the public pbrt-v2 files",
    "tables/sun.csv": "docs/thesis.md has its command",
    "tables/published.csv": "what publish.py notes",
    "tables/renders.csv": "what publish.py notes",
}
"""Files of docs that are no piece, and why."""
BY_HAND = {
    "brdfs.md": "tests/brdf/test_models.py computes all cells",
    "does-not-pay.md": "experiments whose code is not kept",
    "thesis.md": "numbers of the thesis, and of captions: tests/test_examples.py compares them",
    "rules.md": "measured on pages that it links to",
}
"""Pages with numbers in tables that no block has, and why."""
ELSEWHERE = {
    "code.md: lines": "tests/test_count_lines.py",
    "thesis.md: sun": "tests/test_examples.py; the page has the command",
    "results.md: published": "publish.py, below",
}
"""Blocks that another test compares with what makes them."""
MODULES = [code_tables, *(import_module(name) for name in dict.fromkeys(piece.module for piece in PIECES) if name)]
FIGURES = [piece for piece in PIECES if piece.script]


def blocks() -> dict[str, list[str]]:
    """Return the lines of each block of the pages."""
    found = {}
    for page in PAGES:
        text = page.read_text("utf-8")
        for mark, block in re.findall(r"<!-- ([^\n]+): begin -->\n(.*?)<!-- \1: end -->", text, re.S):
            found[f"{page.name}: {mark}"] = block.split("\n")[:-1]
    return found


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_every_number_comes_from_committed_rows(module: ModuleType) -> None:
    on_pages = blocks()
    for block, lines in module.tables().items():
        assert on_pages[block] == [line for text in lines for line in text.split("\n")], block
    for page, sentences in getattr(module, "sentences", dict)().items():
        text = " ".join(page_of(page)[0].read_text("utf-8").split())
        for sentence in sentences:
            assert " ".join(sentence.split()) in text, page


def test_every_measured_table_is_in_a_block() -> None:
    """Tables with several decimals outside of blocks are those of `BY_HAND`; marks with dates are gone."""
    found = set()
    for page in PAGES:
        text = re.sub(r"<!-- ([^\n]+): begin -->.*?<!-- \1: end -->", "", page.read_text("utf-8"), flags=re.S)
        tables = re.findall(r"(?:^\|.*\n)+", text, re.M)
        if any(len(re.findall(r"\b\d*\.\d", table)) >= 6 for table in tables) or "<!-- table:" in text:
            found.add(page.name)
    assert sorted(found - set(BY_HAND)) == []
    # every block has a piece
    assert sorted(set(blocks()) - {block for module in MODULES for block in module.tables()} - set(ELSEWHERE)) == []


def test_every_piece_is_in_the_table_of_commands() -> None:
    """Pictures of the gallery share a row."""
    lines = publish.commands()
    assert blocks()["results.md: published"] == lines
    others = [piece for piece in PIECES if not piece.command.startswith(GALLERY) and piece.name in publish.published()]
    assert [line.split(" | ")[:2] for line in lines[2:-1]] == [[f"| {p.name}", f"`{p.command}`"] for p in others]
    assert f"| {len(publish.published()) - len(others)} figures |" in lines[-1]


def test_pieces_have_names_scripts_files_and_renders() -> None:
    docs, renders = ROOT / "docs", tuple(frozen.configurations())
    files = {
        f"{folder}/{path.name}" for folder in ("figures", "images", "tables") for path in (docs / folder).iterdir()
    }
    assert sorted(files - {name for piece in PIECES for name in piece.files} - set(OTHER_FILES)) == []
    assert len({piece.name for piece in PIECES}) == len(PIECES)
    for piece in PIECES:
        assert (ROOT / piece.command.split()[0]).exists(), piece.name
        assert all((docs / name).exists() for name in piece.files), piece.name
        assert all(any(name.startswith(begin) for name in renders) for begin in piece.renders), piece.name


@pytest.mark.parametrize("piece", FIGURES, ids=lambda piece: piece.name)
def test_no_picture_is_older_than_its_script(piece: Piece) -> None:
    assert publish.reason_to_make(piece, publish.published(), []) == ""


@pytest.mark.parametrize("piece", FIGURES, ids=lambda piece: piece.name)
def test_rules_of_figures_exist(piece: Piece) -> None:
    """Strings of a script that begin as a rule does, such as ``"thesis:patch=8"``, are rules."""
    nodes = list(ast.walk(ast.parse((ROOT / piece.script).read_text("utf-8"))))
    parts = {part for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if isinstance(node, ast.Constant) and node not in parts and re.fullmatch(r"[a-z-]+:\w+=\S+", str(node.value)):
            make_rule(node.value)


# Ages ---------------------------------------------------------------------------------------------------------------


@pytest.fixture
def piece(tmp_path, monkeypatch) -> Piece:
    """A piece with rows and a script, published with the renders of serial 1."""
    for name, path in (("DOCS", ""), ("ROOT", ""), ("PUBLISHED", "p.csv"), ("RENDERS", "r.csv"), ("PAGE", "p.md")):
        monkeypatch.setattr(publish, name, tmp_path / path)
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "a.csv").write_text("1\n")
    (tmp_path / "a.py").write_text('"""Say one."""\nprint(1)  # one\n')
    publish.write_rows(publish.RENDERS, [{"serial": 1}], ["serial"])
    piece = Piece("a", "a.py", renders=("tt auto",), script="a.py")
    publish.record(piece)
    publish.RENDERS.unlink()
    return piece


def reason(piece: Piece, *renders: tuple[str, int]) -> str:
    """Return why a piece is old if these renders have their newest fingerprint at these serial numbers."""
    rows = [{"render": name, "serial": str(serial)} for name, serial in renders]
    return publish.reason_to_make(piece, publish.published(), rows)


def test_ages(piece: Piece, tmp_path) -> None:
    """Renders of a piece, code and rows make it old; other renders and comments do not."""
    assert reason(piece) == "" == reason(piece, ("tt auto x", 1), ("tt balance", 2))
    assert "'tt auto x' has changed" in reason(piece, ("tt auto x", 2))
    assert reason(replace(piece, renders=()), ("tt auto", 2)) == ""
    assert "never" in reason(replace(piece, name="b"))
    (tmp_path / "a.py").write_text('"""Say it."""\nimport dmis\nprint(1)\n')
    assert reason(piece) == ""
    (tmp_path / "a.py").write_text("print(2)\n")
    assert "a.py has changed" in reason(piece)
    (tmp_path / "tables" / "a.csv").write_text("2\n")
    assert "files" in reason(piece)


def test_fingerprints_pass_rounding_and_see_other_numbers(piece: Piece, monkeypatch) -> None:
    """A last bit ages nothing; other random numbers age the pieces of that rule and scene, and no other."""
    small = replace(piece, renders=("cornell balance",))
    name, configuration = next(item for item in frozen.configurations().items() if item[0].startswith(small.renders))
    monkeypatch.setattr(frozen, "configurations", lambda: {name: configuration})
    monkeypatch.setattr(frozen, "RESOLUTION", (12, 10))
    exact = frozen.render

    def rounded(*arguments):
        arrays = exact(*arguments)
        return {**arrays, "image": np.nextafter(arrays["image"], np.float32(np.inf))}

    def reasons() -> list[str]:
        publish.update_renders([piece, small])
        return [
            publish.reason_to_make(x, publish.published(), publish.read_rows(publish.RENDERS)) for x in (piece, small)
        ]

    assert reasons() == ["", ""]
    monkeypatch.setattr(frozen, "render", rounded)
    assert reasons() == ["", ""]
    monkeypatch.setattr(frozen, "SEED", 4)
    assert reasons() == ["", f"the render '{name}' has changed"]


def test_publish_makes_what_is_old_and_names_what_failed(piece: Piece, tmp_path, monkeypatch, capfd) -> None:
    """An old piece loses its rows first; one that failed keeps its new ones, and the others are made."""
    bad = replace(piece, name="bad", command="b.py", files=("tables/b.csv",))
    (tmp_path / "tables" / "b.csv").write_text("1\n")
    publish.record(bad)
    (tmp_path / "b.py").write_text("open('tables/b.csv', 'a').write('2')\nraise SystemExit(1)\n")
    (tmp_path / "a.py").write_text("open('tables/a.csv', 'a').write('2')\n")
    monkeypatch.setattr(publish, "PIECES", (bad, piece))
    monkeypatch.setattr(publish, "update_renders", lambda pieces: None)
    assert publish.main([]) == 1 and "failed: bad" in capfd.readouterr().err
    assert reason(piece) == "" and "never" in reason(bad)
    assert [(tmp_path / "tables" / f"{name}.csv").read_text() for name in "ab"] == ["2", "2"]
    assert "`a.py`" in publish.PAGE.read_text("utf-8")
    assert publish.main([]) == 1 and (tmp_path / "tables" / "b.csv").read_text() == "22"
    assert publish.main(["--only", "a"]) == 0 and publish.main(["--list"]) == 0
