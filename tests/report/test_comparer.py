"""`dmis.show`: images in one page without a report, in a notebook or a file."""

import html
import json
import re
from pathlib import Path

import numpy as np
import pytest

import dmis
from dmis.report.comparer import Comparer

pytest.importorskip("jinja2")
A, B = np.full((3, 4, 3), 0.5, np.float32), np.linspace(0, 2, 36, dtype=np.float32).reshape(3, 4, 3)


def data(comparer: Comparer) -> dict:
    """What the page's script reads."""
    (scene,) = json.loads(re.search(r'id="data">(.*?)</script>', comparer.page, re.S)[1])["scenes"]
    return scene


def test_results_and_arrays(box: dmis.Scene) -> None:
    """A result is its image, a map of one value per pixel is grey; no palette of errors without a reference."""
    result = dmis.render(box, "balance", 1, parallel=1)
    comparer = dmis.show({"result": result, "weight": result.weight}, title="two <images>")
    scene = data(comparer)
    assert [image["label"] for image in scene["images"]] == ["result", "weight"] and not scene["reference"]
    assert (scene["width"], scene["height"]) == (32, 24)
    assert "<title>two &lt;images&gt; · dmis</title>" in comparer.page and '"palette":[]' in comparer.page
    assert not re.search(r"https?:|\bfetch\(|{{", comparer.page)
    assert ".save(path)" in repr(comparer)
    # reference is first and scales errors
    pytest.importorskip("matplotlib")
    for reference in (A, dmis.Reference(A, A, 4)):
        scene = data(dmis.show({"b": B}, reference=reference))
        assert [image["label"] for image in scene["images"]] == ["reference", "b"] and scene["reference"]
        error = np.sqrt(((B - A) ** 2).mean(axis=2))
        assert scene["scale"] == pytest.approx(np.quantile(error, 0.98))


def test_notebook_frame_holds_the_page(tmp_path: Path) -> None:
    """The frame's page is the saved one; labels are text, whatever they hold."""
    comparer = dmis.show({'<b>"&': A})
    frame = comparer._repr_html_()
    assert frame.startswith("<iframe ") and frame.count('"') == 6 and "<b>" not in frame
    assert html.unescape(frame.partition('srcdoc="')[2].rpartition('"></iframe>')[0]) == comparer.page
    comparer.save(tmp_path / "folder" / "page.html")
    assert (tmp_path / "folder" / "page.html").read_text("utf-8") == comparer.page


@pytest.mark.parametrize(
    "images, reference, error, message",
    [
        ([A], None, TypeError, "images must be a dict of labels and at least one image; got list"),
        ({"a": A, "b": A[:2]}, None, ValueError, "one size, got a 4×3, b 4×2"),
        ({"a": A}, A[:, :1], ValueError, "one size, got reference 1×3, a 4×3"),
        ({"a": A[..., :2]}, None, ValueError, r"'a' must be numbers \(H, W, 3\) .*; got ndarray of shape \(3, 4, 2\)"),
        ({"reference": A}, A, ValueError, "label 'reference' is reserved for the reference"),
    ],
)
def test_what_cannot_be_shown(images, reference, error, message) -> None:
    with pytest.raises(error, match=message):
        dmis.show(images, reference=reference)


def test_browser_shows_the_frame(browser, tmp_path: Path) -> None:
    """As in a notebook: no script of the page around it, and the frame gets the height of what is in it."""
    comparer = dmis.show({"a": A, "b": B})
    (tmp_path / "cell.html").write_text(f"<!doctype html><body>{comparer._repr_html_()}</body>", "utf-8")
    tab = browser.new_page(viewport={"width": 700, "height": 800}, offline=True)
    troubles: list[str] = []
    tab.on("pageerror", lambda error: troubles.append(str(error)))
    tab.goto((tmp_path / "cell.html").as_uri())
    frame = tab.frame_locator("iframe")
    frame.get_by_role("button", name="side by side").click()
    frame.locator(".crops canvas").nth(1).wait_for()
    inner = tab.frames[1]
    inner.evaluate("() => VIEWERS[0].ready")
    pixels = inner.evaluate("() => [...VIEWERS[0].sheet.getContext('2d').getImageData(0, 0, 4, 3).data]")
    np.testing.assert_allclose(np.reshape(pixels, (3, 4, 4))[..., :3], 255 * dmis.image.tonemap(B), atol=2)
    tab.wait_for_function(
        "() => { const f = document.querySelector('iframe');"
        " return Math.abs(f.clientHeight - f.contentDocument.documentElement.offsetHeight) < 3 }"
    )
    assert frame.locator(".views button").count() == 0 and troubles == []
    tab.close()
