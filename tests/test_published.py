"""Every table of the pages is made from committed rows alone, and every picture by the script that is there."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import publish
import pytest
from pieces import PIECES, Piece

from dmis.fit.registry import make_rule

ROOT = Path(__file__).parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
OTHER_FILES = {
    "images/data-flow.svg": "drawn by hand",
    "images/play.png": "a screenshot of the play page",
    "images/paper-figure.png": "made by the commands of docs/paper.md",
    "figures/captions.json": "titles and captions of all figures",
    "tables/reproduction-full.csv": "made by commit c8bbb91, in hours",
    "tables/reproduction-original.csv": "needs the public pbrt-v2 files",
    "tables/sun.csv": "docs/reproduction.md has its command",
    "tables/published.csv": "what publish.py notes",
    "tables/renders.csv": "what publish.py notes",
}
"""Files of docs that are no piece, and why."""
BY_HAND = {
    "brdfs.md": "tests/brdf/test_models.py computes all cells",
    "does-not-pay.md": "experiments whose code is not kept",
    "thesis.md": "numbers that the thesis prints",
    "reproduction.md": "figures, whose captions have the numbers: tests/test_examples.py compares them",
    "rules.md": "measured on pages that it links to",
}
"""Pages with numbers in tables that no block has, and why."""
ELSEWHERE = {
    "code.md: lines": "tests/test_count_lines.py",
    "reproduction.md: sun": "tests/test_examples.py; the page has the command",
}
"""Blocks that another test compares with what makes them."""
WITH_TABLES = [piece for piece in PIECES if piece.module]
FIGURES = [piece for piece in PIECES if piece.script]


def blocks() -> dict[str, list[str]]:
    """Return the lines of each block of the pages."""
    found = {}
    for page in PAGES:
        text = page.read_text("utf-8")
        for mark, block in re.findall(r"<!-- ([^\n]+): begin -->\n(.*?)<!-- \1: end -->", text, re.S):
            found[f"{page.name}: {mark}"] = block.split("\n")[:-1]
    return found


@pytest.mark.parametrize("piece", WITH_TABLES, ids=lambda piece: piece.name)
def test_every_cell_comes_from_committed_rows(piece: Piece) -> None:
    on_pages = blocks()
    for block, lines in publish.tables_of(piece).items():
        assert on_pages[block] == [line for text in lines for line in text.split("\n")], block


@pytest.mark.parametrize("piece", WITH_TABLES, ids=lambda piece: piece.name)
def test_numbers_in_sentences_come_from_committed_rows(piece: Piece) -> None:
    for page, sentences in publish.sentences_of(piece).items():
        text = " ".join(publish.page_of(page)[0].read_text("utf-8").split())
        for sentence in sentences:
            assert " ".join(sentence.split()) in text, page


def test_every_block_has_a_piece() -> None:
    missing = set(blocks()) - {block for piece in PIECES for block in piece.blocks} - set(ELSEWHERE)
    assert sorted(missing) == []


def test_every_measured_table_is_in_a_block() -> None:
    """Tables with several decimals outside of blocks are those of `BY_HAND`; marks with dates are gone."""
    found = set()
    for page in PAGES:
        text = re.sub(r"<!-- ([^\n]+): begin -->.*?<!-- \1: end -->", "", page.read_text("utf-8"), flags=re.S)
        tables = re.findall(r"(?:^\|.*\n)+", text, re.M)
        if any(len(re.findall(r"\b\d*\.\d", table)) >= 6 for table in tables) or "<!-- table:" in text:
            found.add(page.name)
    assert sorted(found - set(BY_HAND) - {"published.md"}) == []


def test_every_file_has_a_piece() -> None:
    docs = ROOT / "docs"
    files = {
        f"{folder}/{path.name}" for folder in ("figures", "images", "tables") for path in (docs / folder).iterdir()
    }
    missing = files - {name for piece in PIECES for name in piece.files} - set(OTHER_FILES)
    assert sorted(missing) == []
    assert all((ROOT / "docs" / name).exists() for piece in PIECES for name in piece.files)


def test_pieces_have_names_scripts_and_renders_of_their_own() -> None:
    import frozen

    renders = tuple(frozen.configurations())
    assert len({piece.name for piece in PIECES}) == len(PIECES)
    for piece in PIECES:
        assert (ROOT / piece.command.split()[0]).exists(), piece.name
        assert all(any(name.startswith(begin) for name in renders) for begin in piece.renders), piece.name


@pytest.mark.parametrize("piece", FIGURES, ids=lambda piece: piece.name)
def test_no_picture_is_older_than_its_script(piece: Piece) -> None:
    published, _ = publish.state()
    assert publish.reason_to_make(piece, published, []) == ""


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
def planted(tmp_path, monkeypatch) -> tuple[Piece, dict[str, dict[str, str]]]:
    """A piece with a file and a script, and its row as it was published with the renders of serial 1."""
    monkeypatch.setattr(publish, "DOCS", tmp_path)
    monkeypatch.setattr(publish, "ROOT", tmp_path)
    (tmp_path / "a.csv").write_text("1\n")
    (tmp_path / "a.py").write_text('"""Say one."""\nprint(1)  # one\n')
    piece = Piece("a", "a.py", files=("a.csv",), renders=("tt auto",), script="a.py")
    row = {"serial": "1", "script": publish.code_digest("a.py"), "files": publish.files_digest(piece)}
    return piece, {"a": row}


SMALL = "cornell balance"
"""A frozen render."""


def test_fingerprints_pass_rounding_and_see_other_numbers(planted, tmp_path, monkeypatch) -> None:
    """A last bit ages nothing; other random numbers age the pieces of that rule and scene, and no other."""
    import frozen

    piece, published = planted
    other = replace(piece, name="other", renders=("tt auto",))
    piece = replace(piece, renders=(SMALL,))
    name, configuration = next(item for item in frozen.configurations().items() if item[0].startswith(SMALL))
    monkeypatch.setattr(frozen, "configurations", lambda: {name: configuration})
    monkeypatch.setattr(frozen, "RESOLUTION", (12, 10))
    monkeypatch.setattr(publish, "RENDERS", tmp_path / "renders.csv")
    publish.update_renders([piece, other])
    assert [row["serial"] for row in publish.read_rows(publish.RENDERS)] == ["1"]
    exact = frozen.render

    def rounded(*arguments):
        arrays = exact(*arguments)
        return {**arrays, "image": np.nextafter(arrays["image"], np.float32(np.inf))}

    monkeypatch.setattr(frozen, "render", rounded)
    publish.update_renders([piece, other])
    assert publish.reason_to_make(piece, published, publish.read_rows(publish.RENDERS)) == ""
    monkeypatch.setattr(frozen, "SEED", 4)
    publish.update_renders([piece, other])
    rows = publish.read_rows(publish.RENDERS)
    assert [row["serial"] for row in rows] == ["1", "2"]
    published |= {"other": published["a"]}
    assert name in publish.reason_to_make(piece, published, rows)
    assert publish.reason_to_make(other, published, rows) == ""


def render(name: str, serial: int) -> dict[str, str]:
    """Return a row of the renders."""
    return {"serial": str(serial), "render": name}


AGES = [((), ""), (("tt auto x", 1), ""), (("tt balance", 2), ""), (("tt auto x", 2), "tt auto x")]
"""A render and the serial number of its newest fingerprint, and the render that makes the planted piece old."""


@pytest.mark.parametrize("newest, old", AGES)
def test_changed_renders_age_the_pieces_that_they_decide(planted, newest, old) -> None:
    reason = publish.reason_to_make(*planted, [render(*newest)] if newest else [])
    assert bool(reason) == bool(old) and old in reason


def test_pieces_without_renders_do_not_age_by_renders(planted) -> None:
    piece, published = planted
    assert publish.reason_to_make(replace(piece, renders=()), published, [render("tt auto", 2)]) == ""


def test_code_ages_a_picture_and_comments_do_not(planted, tmp_path) -> None:
    piece, published = planted
    (tmp_path / "a.py").write_text('"""Say it."""\nprint(1)\n')
    assert publish.reason_to_make(piece, published, []) == ""
    (tmp_path / "a.py").write_text("print(2)\n")
    assert "a.py has changed" in publish.reason_to_make(piece, published, [])


def test_replaced_files_and_unknown_pieces_are_told(planted, tmp_path) -> None:
    piece, published = planted
    (tmp_path / "a.csv").write_text("2\n")
    assert "files" in publish.reason_to_make(piece, published, [])
    assert "never" in publish.reason_to_make(piece, {}, [])


def test_publish_makes_what_is_old_and_names_what_failed(planted, tmp_path, monkeypatch, capfd) -> None:
    """A piece that fails does not keep the others from being made; what was made is new afterwards."""
    piece, _ = planted
    bad = replace(piece, name="bad", command="b.py")
    (tmp_path / "b.py").write_text("raise SystemExit(1)\n")
    (tmp_path / "tables").mkdir()
    for name in ("PUBLISHED", "RENDERS"):
        monkeypatch.setattr(publish, name, tmp_path / "tables" / f"{name}.csv")
    monkeypatch.setattr(publish, "PAGE", tmp_path / "published.md")
    monkeypatch.setattr(publish, "PIECES", (bad, piece))
    monkeypatch.setattr(publish, "write_pages", lambda pieces: publish.write_published())
    monkeypatch.setattr(publish, "update_renders", lambda pieces: None)
    assert publish.main([]) == 1
    assert "failed: bad" in capfd.readouterr().err
    assert publish.reason_to_make(piece, *publish.state()) == ""
    assert "`a.py`" in publish.PAGE.read_text("utf-8")
    assert publish.main(["--only", "a"]) == 0


def test_a_command_that_fails_before_its_first_row_changes_nothing(planted, tmp_path, monkeypatch) -> None:
    """Rows and their note stay; after a first row of its own an interrupted command would continue."""
    (tmp_path / "tables").mkdir()
    monkeypatch.setattr(publish, "PUBLISHED", tmp_path / "tables" / "published.csv")
    rows = tmp_path / "tables" / "rows.csv"
    rows.write_text("1\n")
    piece = replace(planted[0], files=("tables/rows.csv",))
    publish.record(piece)
    (tmp_path / "a.py").write_text("raise SystemExit(1)\n")
    assert not publish.make(piece)
    assert rows.read_text() == "1\n" and piece.name in publish.state()[0]
    (tmp_path / "a.py").write_text("open('tables/rows.csv', 'w').write('2')\nraise SystemExit(1)\n")
    assert not publish.make(piece)
    assert rows.read_text() == "2" and piece.name not in publish.state()[0]


def test_old_rows_are_deleted_and_interrupted_ones_kept(planted, tmp_path, monkeypatch) -> None:
    """A command continues with its rows: an old piece loses them first, one that was interrupted does not."""
    (tmp_path / "tables").mkdir()
    monkeypatch.setattr(publish, "PUBLISHED", tmp_path / "tables" / "published.csv")
    piece = replace(planted[0], files=("tables/rows.csv", "a.csv"))
    rows = tmp_path / "tables" / "rows.csv"
    rows.write_text("1\n")
    publish.forget(piece)
    assert rows.exists()
    publish.record(piece)
    publish.forget(piece)
    assert not rows.exists() and (tmp_path / "a.csv").exists()
    assert "never" in publish.reason_to_make(piece, publish.state()[0], [])
