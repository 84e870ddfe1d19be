"""Bars of progress: made by True, moved by renders, removed at the end."""

import sys

import numpy as np
import pytest

import dmis
from dmis.pipeline.progress import reporting


def test_bar_follows_the_render(box: dmis.Scene, capsys: pytest.CaptureFixture[str]) -> None:
    """True shows both stages on standard error, and the image is that without a bar."""
    pytest.importorskip("tqdm")
    image = dmis.render(box, "thesis:patch=4", 8, parallel=1, progress=True).image
    shown = capsys.readouterr().err
    assert "pilot" in shown and "final" in shown and "samples" in shown
    assert (image == dmis.render(box, "thesis:patch=4", 8, parallel=1, progress=False).image).all()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("rule", ["thesis:patch=4", "auto", "balance", "reference"])
def test_progress_is_that_of_the_whole_render(box: dmis.Scene, rule: str, tmp_path) -> None:
    """Samples of all rounds add up, so that a bar has the time left of the render; both halves of a reference, too."""
    calls: list[tuple[str, int, int]] = []
    options = {"parallel": 1, "progress": lambda *call: calls.append(call)}
    if rule == "reference":
        dmis.make_reference(box, 32, folder=tmp_path, **options)
    else:
        dmis.render(box, rule, 64, **options)
    done, total = (np.array(values) for values in list(zip(*calls, strict=True))[1:])
    assert (np.diff(done) > 0).all() and (done <= total).all() and done[-1] == total[-1] > 0.9 * total[0]


def test_progress_without_tqdm(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message says what to install."""
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with pytest.raises(ImportError, match=r"pip install 'dmis\[progress\]'"), reporting(True):
        pass
