"""The script that counts the code of one render: `benchmarks/count_lines.py`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from helpers import script

ROOT = Path(__file__).parent.parent
SCRIPT = ROOT / "benchmarks" / "count_lines.py"


def test_reading_path_is_what_a_render_calls() -> None:
    """Every file of the reading path of docs/code.md is called, in its order; the page has the sentence of the sums."""
    done = subprocess.run(
        [sys.executable, SCRIPT],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    path = script("benchmarks/count_lines.py").reading_path()
    *table, sentence = done.stdout.splitlines()
    page = (ROOT / "docs" / "code.md").read_text("utf-8")
    assert f"\n{sentence}\n" in page, "run python benchmarks/count_lines.py --write"
    _, _, _, *rows, total, _ = (line.split() for line in table)
    assert len(path) > 10 and [row[0] for row in rows[: len(path)]] == path
    assert all(int(row[1]) > 0 and int(row[2]) >= int(row[1]) for row in rows)
    sums = [sum(int(row[k]) for row in rows) for k in (1, 2)]
    assert total == [str(len(rows)), "files", *map(str, sums)]


def test_names_on_the_reading_path_are_where_the_page_says() -> None:
    steps = (ROOT / "docs" / "code.md").read_text("utf-8").partition("the files in this order:")[2]
    named = re.findall(r"`([a-z_/]+\.py)`\s+\(((?:[^()]|\([^()]*\))*)\)", steps.partition("<!-- lines")[0])
    found = [(file, name) for file, text in named for name in re.findall(r"`([A-Za-z_.]+)`", text)]
    assert len(found) >= 10
    for file, name in found:
        code = (ROOT / "dmis" / file).read_text("utf-8")
        assert re.search(rf"(def|class) {name.split('.')[-1]}\b", code), f"{file} has no {name}"
