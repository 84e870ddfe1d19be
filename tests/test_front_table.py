"""The table of README is put together from the tables of three other pages."""

from pathlib import Path

import pytest
from helpers import script

ROOT = Path(__file__).parent.parent
front = script("benchmarks/front_table.py")
MITSUBA = """<!-- mitsuba-errors: begin -->
| scene | Mitsuba's best | `balance`, sobol | {column} |
|---|---|---|---|
| tt | lights evenly | 0.8 ± 0.1 | 0.5 ± 0.1 |
| tt | of all | 0.9 ± 0.1 | 0.6 ± 0.1 |
<!-- mitsuba-errors: end -->
"""


STEPS = """<!-- steps: begin -->
| scene | shares | all three |
|---|---|---|
| tt 3×2 | 0.9 | **0.1 ± 0.0** |
| room, held out | 0.8 | 0.3 ± 0.0 |
<!-- steps: end -->
"""
POINTS = """<!-- points: begin -->
Made today.

| scene | rule | 32 spp | 128 spp |
|---|---|---|---|
| tt 3×2 | counts | 9 | 8 |
| tt 3×2 | auto | 9 | 0.2 ± 0.1 |
| room, held out | auto | 9 | 0.4 ± 0.1 |
<!-- points: end -->
"""


@pytest.mark.parametrize("column, best", [("`auto`, sobol", "0.6 ± 0.1"), ("ratio", "–")])
def test_rows(tmp_path, column, best):
    """The ratios of auto at 128 samples, and over the last of Mitsuba's lines; a dash where none was measured."""
    pages = [tmp_path / name for name in ("steps.md", "points.md", "mitsuba.md")]
    for page, text in zip(pages, (STEPS, POINTS, MITSUBA.format(column=column)), strict=True):
        page.write_text(text, "utf-8")
    assert front.front_rows(*pages)[2:] == [
        f"| tt 3×2 | **0.1 ± 0.0** | 0.2 ± 0.1 | {best} |",
        "| room, held out | 0.3 ± 0.0 | 0.4 ± 0.1 | – |",
    ]


def test_a_column_for_each_measure(tmp_path):
    """Where the pages have both; a page that has none by relMSE has MSE in its old column."""
    steps = STEPS.replace("all three", "all three, relMSE | all three, MSE").replace("0.1 ± 0.0**", "0.2 ± 0.0** | 0.1")
    points = POINTS.replace("128 spp", "128 spp, relMSE | 128 spp, MSE").replace("| 8 |", "| 8 | 8 |")
    steps, points = steps.replace("0.3 ± 0.0", "0.5 | 0.3"), points.replace("0.2 ± 0.1", "0.7 | 0.2")
    pages = [tmp_path / name for name in ("steps.md", "points.md", "mitsuba.md")]
    texts = (steps, points.replace("0.4 ± 0.1", "0.9 | 0.4"), MITSUBA.format(column="`auto`, sobol"))
    for page, text in zip(pages, texts, strict=True):
        page.write_text(text, "utf-8")
    head, _, tt, room = front.front_rows(*pages)
    assert head.count(", relMSE |") == head.count(", MSE |") == 3
    assert tt == "| tt 3×2 | **0.2 ± 0.0** | 0.1 | 0.7 | 0.2 | – | 0.6 ± 0.1 |"
    assert room == "| room, held out | 0.5 | 0.3 | 0.9 | 0.4 | – | – |"


def test_readme_has_the_table_of_the_pages():
    """README shows what these pages show now."""
    assert "\n".join(front.front_rows()) in (ROOT / "README.md").read_text("utf-8")
