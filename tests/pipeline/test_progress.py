"""Bars of progress: made by True, moved by renders, removed at the end."""

import io

import numpy as np
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


@pytest.mark.parametrize("rule", ["thesis:patch=4", "auto", "balance"])
def test_progress_is_that_of_the_whole_render(box: dmis.Scene, rule: str) -> None:
    """Samples of all rounds add up, so that a bar has the time left of the render; both halves of a reference, too."""
    calls: list[tuple[str, int, int]] = []
    dmis.render(box, rule, 64, parallel=1, progress=lambda *call: calls.append(call))
    done, total = (np.array(values) for values in list(zip(*calls, strict=True))[1:])
    assert (np.diff(done) > 0).all() and (done <= total).all() and done[-1] == total[-1] > 0.9 * total[0]


def test_progress_of_a_reference(box: dmis.Scene, tmp_path) -> None:
    calls: list[tuple[str, int, int]] = []
    dmis.make_reference(box, 32, folder=tmp_path, parallel=1, progress=lambda *call: calls.append(call))
    done = [done / total for _, done, total in calls]
    assert done == sorted(done) and done[-1] == 1 and done[0] <= 0.5


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
