"""The report in Chromium: it fits, shows the renders, compares them, and saves what it shows."""

import csv
import io
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from helpers import offline_tab
from PIL import Image

import dmis
from dmis import plot
from dmis.experiment.runs import PINNED
from dmis.report.tables import COSTS

ALL = ["balance", "pbrt", "thesis:patch=4", "second-moment", PINNED]


@pytest.fixture
def opened(browser, made):
    """The page in a tab."""
    with offline_tab(browser, made[1] / "report.html") as tab:
        yield tab


def pixels(tab) -> np.ndarray:
    """What the comparer shows, one pixel of the image each, when it has drawn all that it was told to."""
    width, height, data = tab.evaluate("""async () => {
        await VIEWERS[0].ready;
        const { sheet } = VIEWERS[0], { width, height } = sheet;  // a copy, since reading a canvas often is warned of
        const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
        copy.drawImage(sheet, 0, 0);
        return [width, height, [...copy.getImageData(0, 0, width, height).data]];
    }""")
    return np.reshape(data, (height, width, 4))[..., :3].astype(float)


def shown(tab) -> str:
    return tab.locator(".methods button[aria-pressed=true]").inner_text()


def expected(image: np.ndarray, exposure: float = 0.0) -> np.ndarray:
    return 255 * dmis.image.tonemap(image.astype(np.float32), 2**exposure)


def test_browser_shows_the_renders(opened, made):
    """To one step of 8 bits: decoded, exposed and turned into sRGB as Python does it."""
    comparison, _ = made
    assert shown(opened) == "balance, 16 spp"
    np.testing.assert_allclose(pixels(opened), expected(comparison.pictures["balance", 16]["RGB"]), atol=2)


def test_browser_flips(opened, made):
    """By arrow keys around the end, by digits, by buttons."""
    comparison, _ = made
    seen = []
    for key, rule in (("ArrowRight", "pbrt"), ("3", "thesis:patch=4"), ("ArrowRight", "second-moment")):
        opened.keyboard.press(key)
        seen.append(pixels(opened))
        assert shown(opened) == f"{rule}, 16 spp"
        np.testing.assert_allclose(seen[-1], expected(comparison.pictures[rule, 16]["RGB"]), atol=2)
    for label in ("pinned, 16 spp", "reference"):
        opened.keyboard.press("ArrowRight")
        pixels(opened)
        assert shown(opened) == label
    opened.get_by_role("button", name="pbrt, 16 spp").click()
    np.testing.assert_array_equal(pixels(opened), seen[0])


def test_browser_shows_errors(opened, made):
    """Black for the reference; for a rule the root of the mean squared error in the colours of the palette."""
    comparison, _ = made
    opened.keyboard.press("e")
    found = pixels(opened)
    image, truth = comparison.pictures["balance", 16]["RGB"], comparison.reference.mean
    error = np.sqrt(((image - truth) ** 2).mean(axis=2))
    colours = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in plot.palette("magma")])
    share = np.minimum(1, error / np.quantile(error, 0.98))
    # half floats move an error by at most a few of the 256 steps
    np.testing.assert_allclose(found, colours[(share * 255).astype(int)], atol=12)
    opened.keyboard.press("0")
    assert (pixels(opened) == colours[0]).all()


@pytest.mark.parametrize("width", [1280, 390])
def test_browser_page_fits(opened, width):
    """The last column of every table is visible at 1280 pixels; on a phone tables scroll, and the page does not."""
    opened.set_viewport_size({"width": width, "height": 800})
    tables = opened.evaluate("() => [...document.querySelectorAll('.wide')].map(e => [e.scrollWidth, e.clientWidth])")
    assert len(tables) == 3 and opened.evaluate("() => document.documentElement.scrollWidth") <= width
    assert width < 1000 or [wide - visible for wide, visible in tables] == [0] * 3


def test_browser_splits(opened, made):
    """The left image up to the divider, which can be dragged; or both side by side, at the same place."""
    state = "() => VIEWERS[0].panes.map(p => [VIEWERS[0].scene.images[p.k].label, p.from, p.to, p.size])"
    opened.get_by_role("button", name="split").click()
    assert opened.evaluate(state) == [["reference", 0, 0.5, 1], ["balance, 16 spp", 0.5, 1, 1]]
    opened.locator(".left select").select_option("pbrt, 16 spp")
    stage = opened.locator(".stage")
    stage.scroll_into_view_if_needed()
    box = stage.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 4
    opened.mouse.move(x, y)
    opened.mouse.down()
    opened.mouse.move(x - box["width"] / 4, y)
    opened.mouse.up()
    pixels(opened)
    assert opened.evaluate(state)[0] == ["pbrt, 16 spp", 0, pytest.approx(0.25, abs=0.01), 1]
    picture = np.asarray(Image.open(io.BytesIO(stage.screenshot())).convert("RGB")).astype(float)
    for rule, share in (("pbrt", 0.125), ("balance", 0.625)):  # in the middle of a pixel of the image, away from names
        column, row = int(share * 32), 18
        at = round((row + 0.5) / 24 * picture.shape[0]), round((column + 0.5) / 32 * picture.shape[1])
        np.testing.assert_allclose(picture[at], expected(made[0].pictures[rule, 16]["RGB"][row, column]), atol=2)
    opened.locator("body").press("s")
    pixels(opened)
    assert opened.evaluate(state) == [["pbrt, 16 spp", 0, 0.5, 0.5], ["balance, 16 spp", 0.5, 1, 0.5]]


def test_browser_links_crops(opened, made):
    """A click takes the crop of the same place of every image; a click on a crop shows its image."""
    opened.evaluate("() => { VIEWERS[0].middle = [0, 0]; }")
    crops = opened.locator(".crops canvas")
    assert crops.count() == 6
    stage = opened.locator(".stage")
    box = stage.bounding_box()
    stage.click(position={"x": box["width"] - 2, "y": box["height"] / 2})
    pixels(opened)
    assert opened.evaluate("() => VIEWERS[0].corner") == [8, 0, 24]  # a crop stays inside: 24 of 32 columns
    comparison, _ = made
    for k, rule in enumerate(ALL[:2], 1):
        data = opened.evaluate(
            "k => [...VIEWERS[0].crops[k].canvas.getContext('2d').getImageData(0, 0, 24, 24).data]", k
        )
        image = comparison.pictures[rule, 16]["RGB"][:, 8:]
        np.testing.assert_allclose(np.reshape(data, (24, 24, 4))[..., :3], expected(image), atol=2)
        error = np.sqrt(((image - comparison.reference.mean[:, 8:]) ** 2).mean())
        caption = opened.locator(".crops figcaption").nth(k).inner_text()
        assert caption.startswith(f"{rule}, 16 spp: RMSE ")
        assert float(caption.split()[-1]) == pytest.approx(error, rel=0.06)
    crops.nth(3).click()
    pixels(opened)
    assert shown(opened) == "thesis:patch=4, 16 spp"


def test_browser_saves_tables_and_plots(opened, tmp_path):
    """A table of numbers; a plot is a file that other programs can read."""
    with opened.expect_download() as download:
        opened.get_by_label("save the table costs of box as CSV").click()
    assert download.value.suggested_filename == "box-costs.csv"
    download.value.save_as(tmp_path / "costs.csv")
    with open(tmp_path / "costs.csv", newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert tuple(head) == COSTS and [float(row[2]) > 0 for row in rows] == [True] * 10
    with opened.expect_download() as download:
        opened.get_by_role("button", name="save Root of relMSE over CPU seconds, box as SVG").click()
    download.value.save_as(tmp_path / "plot.svg")
    root = ElementTree.parse(tmp_path / "plot.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg" and float(root.get("width")) > 300
    assert len(list(root.iter("{http://www.w3.org/2000/svg}path"))) > 5
