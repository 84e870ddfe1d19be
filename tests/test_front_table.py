"""The table of README is put together from the tables of two other pages."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).parent.parent
MITSUBA = """<!-- mitsuba-errors: begin -->
| scene | Mitsuba's best | `balance`, sobol | {column} |
|---|---|---|---|
| tt | lights evenly | 0.8 ± 0.1 | 0.5 ± 0.1 |
| tt | of all | 0.9 ± 0.1 | 0.6 ± 0.1 |
<!-- mitsuba-errors: end -->
"""


def table(mark: str, ratio: str) -> str:
    """Return a table of `make_points_table` with two budgets and two rules on two scenes."""
    rows = [
        f"| {scene} | {rule} | 9 | {ratio if rule == 'auto' else 8} |"
        for scene in ("tt 3×2", "room, held out")
        for rule in ("counts", "auto")
    ]
    head = "| scene | rule | 32 spp | 128 spp |\n|---|---|---|---|\n"
    return f"<!-- {mark}: begin -->\nMade today.\n\n{head}" + "\n".join(rows) + f"\n<!-- {mark}: end -->\n"


@pytest.fixture
def front() -> SimpleNamespace:
    return SimpleNamespace(**runpy.run_path(str(ROOT / "benchmarks" / "front_table.py")))


@pytest.mark.parametrize("column, best", [("`auto`, sobol", "0.6 ± 0.1"), ("ratio", "–")])
def test_rows(front, tmp_path, column, best):
    """The ratios of auto at 128 samples, and over the last of Mitsuba's lines; a dash where none was measured."""
    points, mitsuba = tmp_path / "points.md", tmp_path / "mitsuba.md"
    points.write_text(table("points", "**0.1 ± 0.0**") + table("points strong", "0.2 ± 0.1"), "utf-8")
    mitsuba.write_text(MITSUBA.format(column=column), "utf-8")
    assert front.front_rows(points, mitsuba)[2:] == [
        f"| tt 3×2 | **0.1 ± 0.0** | 0.2 ± 0.1 | {best} |",
        "| room, held out | **0.1 ± 0.0** | 0.2 ± 0.1 | – |",
    ]


def test_page_without_marks(front, tmp_path):
    """An error that names the page and the marks."""
    page = tmp_path / "page.md"
    page.write_text("| a |\n", "utf-8")
    with pytest.raises(ValueError, match=r"page\.md must have a table between <!-- points: begin -->"):
        front.read_rows(page, "points")


def test_readme_has_the_table_of_the_pages(front):
    """README shows what the two pages show now."""
    assert "\n".join(front.front_rows()) in (ROOT / "README.md").read_text("utf-8")
