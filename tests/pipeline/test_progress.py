"""Bars of progress: made by True, moved by renders, removed at the end."""

import io

import pytest

import dmis
from dmis.pipeline.progress import ProgressBar, reporting


def test_bar_follows_the_render(box: dmis.Scene, capsys: pytest.CaptureFixture[str]) -> None:
    """True shows both stages on standard error, and the image is that without a bar."""
    pytest.importorskip("tqdm")
    image = dmis.render(box, "thesis:patch=4", 8, parallel=1, progress=True).image
    shown = capsys.readouterr().err
    assert "pilot" in shown and "final" in shown and "samples" in shown
    assert (image == dmis.render(box, "thesis:patch=4", 8, parallel=1, progress=False).image).all()
    assert capsys.readouterr().err == ""


def test_bar_begins_again_with_each_render() -> None:
    """A stage of the same name and length, as of the second half of a reference."""
    pytest.importorskip("tqdm")
    bar = ProgressBar("samples")
    bar._bar.fp = io.StringIO()
    for done in (5, 10, 5, 10):
        bar("final", done, 10)
        assert bar._bar.n == done
    bar.close()


def test_measure_counts_renders(box: dmis.Scene, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tqdm")
    reference = dmis.Reference(*2 * [dmis.render(box, "balance", 8, parallel=1).image], 8)
    dmis.measure(box, [("balance", 2)], [0, 1], reference, parallel=1, progress=True)
    assert "balance" in (shown := capsys.readouterr().err) and "renders" in shown


def test_progress_without_tqdm(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message says what to install."""
    monkeypatch.setitem(__import__("sys").modules, "tqdm.auto", None)
    with pytest.raises(ImportError, match=r"pip install 'dmis\[progress\]'"), reporting(True):
        pass
