"""Published tables say how they were made, and examples/table_ages.py finds those older than their modules."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import table_ages

ROOT = Path(__file__).parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
needs_git = pytest.mark.skipif(shutil.which("git") is None, reason="needs git")


def test_every_replaced_table_has_a_marker():
    """Each block between begin and end marks has exactly one marker, whose paths exist and whose script does, too."""
    blocks = [
        (f"{page.name}: {kind}", block)
        for page in PAGES
        for kind, block in re.findall(r"<!-- ([^\n]+): begin -->(.*?)<!-- \1: end -->", page.read_text("utf-8"), re.S)
        if "|---" in block
    ]
    assert len(blocks) > 20
    assert [name for name, block in blocks if len(table_ages.MARKER.findall(block)) != 1] == []
    for table in table_ages.find_tables(ROOT):
        scripts = [word for word in table.command.split() if word.endswith(".py")]
        assert [path for path in (*table.depends, *scripts) if not (ROOT / path).exists()] == [], table.place


def commit(root: Path, message: str, day: str) -> str:
    """Commit everything at noon of a day; return the commit."""
    stamp = f"{day}T12:00:00+0000"
    identity = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    subprocess.run(["git", "add", "-A"], cwd=root, check=True)
    subprocess.run(
        ["git", *identity, "commit", "-q", "-m", message],
        cwd=root,
        check=True,
        env={"PATH": str(Path(shutil.which("git") or "git").parent), "HOME": str(root),
             "GIT_AUTHOR_DATE": stamp, "GIT_COMMITTER_DATE": stamp},
    )  # fmt: skip
    return table_ages.git(root, "rev-parse", "--short", "HEAD")


@pytest.fixture
def project(tmp_path):
    """A repository with two modules and two tables, of which the module of the second changed later."""
    root = tmp_path / "project"
    (root / "docs").mkdir(parents=True)
    (root / "README.md").write_text("no table\n")
    for name in ("a.py", "b.py"):
        (root / name).write_text("1\n")
    subprocess.run(["git", "init", "-q", str(root)], check=True)
    first = commit(root, "Add modules", "2026-01-01")
    lines = [f"<!-- table: python {name}; 2026-01-02; commit {first}; depends: {name}.py -->" for name in ("a", "b")]
    (root / "docs" / "page.md").write_text("| 1 |\n" + "\n\n".join(lines) + "\n")
    commit(root, "Add tables", "2026-01-02")
    (root / "b.py").write_text("2\n")
    commit(root, "Change b", "2026-01-03")
    return root


@needs_git
def test_old_tables_are_found(project, capsys):
    """The table whose module changed after its commit, with that change, and no other."""
    assert table_ages.main(project) == 0
    said = capsys.readouterr().out
    assert "docs/page.md:2  2026-01-02" in said and said.count("OLDER") == 1
    assert re.search(r"OLDER than \w+ 2026-01-03 Change b\n    python b\n", said)
    assert said.endswith("1 of 2 tables are older than the modules that decide them\n")


@needs_git
@pytest.mark.parametrize("day, old", [("2026-01-02", 1), ("2026-01-03", 0)])
def test_unknown_commit_goes_by_the_date(project, capsys, day, old):
    """A commit that was squashed away is replaced by the end of the table's day."""
    page = project / "docs" / "page.md"
    page.write_text(re.sub(r"2026-01-02; commit \w+", f"{day}; commit 0123456", page.read_text()))
    assert table_ages.main(project) == 0
    assert f"\n{old} of 2 tables" in capsys.readouterr().out


def test_new_marker_keeps_the_paths(monkeypatch):
    """Command and date are those of now, the paths those of the block that is replaced."""
    monkeypatch.setattr(sys, "argv", [str(ROOT / "benchmarks" / "make_points_table.py"), "--seeds", "2"])
    old = "<!-- table: python x.py; 2020-01-01; commit 0123456; depends: dmis/fit dmis/light -->"
    match = table_ages.MARKER.fullmatch(table_ages.marker(f"\n| 1 |\n{old}\n"))
    assert match is not None and match["command"] == "python benchmarks/make_points_table.py --seeds 2"
    assert match["depends"] == "dmis/fit dmis/light" and match["date"] > "2020"
    assert table_ages.MARKER.fullmatch(table_ages.marker())["depends"] == "dmis"
