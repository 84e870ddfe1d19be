"""How results, scenes and pilots show themselves, and bars of progress."""

from __future__ import annotations

import gc
import io
import re
import sys
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import shared_scene

import dmis
from dmis.image import png_of, write_png
from dmis.pipeline.progress import reporting
from dmis.testing.scenes import box_scene
from dmis.variance.moments import Film


@dataclass
class Keep(dmis.Rule):
    """A rule that keeps its pilot."""

    pilot: Mapping[Any, int] = field(default_factory=lambda: {0.5: 2})
    kept: list[Film] = field(default_factory=list)

    def fit(self, pilot: Mapping[Any, Film]) -> dmis.Fit:
        self.kept.extend(pilot.values())
        return dmis.Fit(0.5)


def small() -> dmis.Scene:
    return shared_scene("teapot-area-light", (20, 12))


def test_scenes_results_and_pilots_are_one_line() -> None:
    text = repr(dmis.render(small(), "thesis:patch=4", 8))
    assert re.fullmatch(r"Result\(teapot-area-light 20x12, rule thesis:patch=4, 8 spp, \d+\.\d s\)", text)
    assert re.fullmatch(r"Scene\(teapot-area-light 20x12, \d parts, [\d,]+ triangles, 2 lights\)", repr(small()))
    dmis.render(small(), rule := Keep(), 4)
    assert [repr(pilot) for pilot in rule.kept] == ["Film(20x12, 2 spp, light + brdf, sums: none)"]
    # Nor Embree's copy: its provenance is made from the fields of the scene
    scene = box_scene(resolution=(4, 3))
    kept = [weakref.ref(scene.plan), weakref.ref(scene.intersector)]
    result = dmis.render(scene, "balance", 1, parallel=1)
    del scene
    gc.collect()
    assert [reference() for reference in kept] == [None, None] and result.provenance["scene_hash"]


def test_average_has_the_unbiased_variance() -> None:
    """The mean of three renders; over 40 such means its predicted variance is the measured one to a fifth."""
    scene = small()
    means, variances = zip(
        *(dmis.average([dmis.render(scene, "balance", 4, seed=3 * k + r) for r in range(3)]) for k in range(40))
    )
    images = [dmis.render(scene, "balance", 4, seed=r).image.astype(float) for r in range(3)]
    np.testing.assert_allclose(means[0], np.mean(images, axis=0))
    dim = np.mean(means, axis=0) < 1  # not the lamp's edge
    predicted = np.mean(variances, axis=0)[dim].mean()
    assert predicted == pytest.approx(np.var(means, axis=0, ddof=1)[dim].mean(), rel=0.2)
    with pytest.raises(ValueError, match="results must be two renders or more"):
        dmis.average([])


def test_notebook_shows_the_picture(tmp_path: Path) -> None:
    """The bytes are those of a preview file, and any PNG reader finds the image in them."""
    pil = pytest.importorskip("PIL.Image")
    result = dmis.render(small(), "balance", 2)
    write_png(tmp_path / "a.png", result.image)
    assert result._repr_png_() == png_of(result.image) == (tmp_path / "a.png").read_bytes()
    with pil.open(io.BytesIO(result._repr_png_())) as picture:
        assert picture.size == (20, 12) and np.asarray(picture).max() > 100


# Progress ------------------------------------------------------------------------------------------------------------


def test_bar_follows_the_render(
    box: dmis.Scene, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """True shows both stages on standard error, and the image is that without a bar."""
    pytest.importorskip("tqdm")
    image = dmis.render(box, "thesis:patch=4", 8, parallel=1, progress=True).image
    shown = capsys.readouterr().err
    assert "pilot" in shown and "final" in shown and "samples" in shown
    assert (image == dmis.render(box, "thesis:patch=4", 8, parallel=1, progress=False).image).all()
    assert capsys.readouterr().err == ""
    # the message says what to install
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with pytest.raises(ImportError, match=r"pip install 'dmis\[progress\]'"), reporting(True):
        pass


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
