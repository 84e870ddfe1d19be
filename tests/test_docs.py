"""What the pages and examples show runs as it stands."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
CODE = {page: re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.S) for page in PAGES}


@pytest.mark.parametrize("page", [page for page, blocks in CODE.items() if blocks], ids=lambda page: page.name)
def test_python_blocks_run(page, tmp_path, monkeypatch):
    """Every Python block of a page, one after the other, in an empty folder."""
    from dmis.fit import RULES

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
