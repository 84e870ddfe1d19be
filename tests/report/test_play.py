"""The page to paint weights on: its maps by brute force, its numbers in Node and Chromium against Python's."""

import itertools
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import offline_tab

import dmis
from dmis.base.patches import patch_spread
from dmis.cli.commands import main
from dmis.estimator.cost import CAMERA, RAY, SHADING
from dmis.experiment.oracle import Oracle, between
from dmis.experiment.oracle_renders import EPSILON, measure_patches
from dmis.report import play
from dmis.report.play import MOST_SAMPLES, best_even, best_with_samples
from dmis.variance.curves import GRID, HALF

pytest.importorskip("jinja2")
INNER = GRID[1:-1]
SCRIPT = Path(play.__file__).with_name("play_model.js").read_text("utf-8")


def planted(rows: int, columns: int, shape: tuple[int, int] | None = None) -> Oracle:
    """Parabolas about random shares, of random height; light samples cost more, and the last patch is black."""
    random = np.random.default_rng(1)
    best, height = random.uniform(0, 1, (rows, columns)), random.lognormal(0, 1, (rows, columns))
    variance = height * (0.1 + (GRID[:, None, None] - best) ** 2).astype(float)
    variance[:, -1, -1] = 0
    cost = 1 + GRID[:, None, None] * random.uniform(0, 1, (rows, columns))
    return Oracle(variance, cost, 4, 64, shape or (4 * rows, 4 * columns))


def error_time(curves: Oracle, weight: np.ndarray, samples: np.ndarray | float = 1.0) -> float:
    """Return ``mean(V / n) mean(n C)`` of shares and numbers per patch, over that of w = 1/2 and even samples."""
    product = curves.mean(between(curves.variance, weight) / samples) * curves.mean(
        between(curves.costs, weight) * samples
    )
    return product / (curves.mean(curves.variance[HALF]) * curves.mean(curves.costs[HALF]))


def planted_page(curves: Oracle) -> tuple[dict[str, Oracle], str]:
    """Curves in both measures, and the page."""
    random = np.random.default_rng(2)
    image, factor = random.uniform(0, 1, (*curves.shape, 3)), random.uniform(0.1, 10, curves.variance.shape)
    measures = {"relative": replace(curves, variance=curves.variance * factor), "absolute": curves}
    thesis = patch_spread(random.uniform(0, 1, curves.pixel_share.shape), 4, curves.shape)
    return measures, play.page_of(measures, image, thesis, "<b>planted", 64)


@pytest.fixture(scope="module")
def page() -> tuple[dict[str, Oracle], str]:
    """The page of 19 by 27 pixels, whose patches at the border are smaller."""
    return planted_page(planted(5, 7, (19, 27)))


def data_of(text: str) -> str:
    return text.partition('id="data">')[2].partition("</script>")[0]


def test_maps_are_the_best_of_all() -> None:
    """No other shares have less error times time, by brute force; no other numbers of samples, by chance."""
    curves, random = planted(2, 2), np.random.default_rng(3)
    lit = itertools.product(INNER, repeat=3)  # the black patch takes the cheapest share
    least = min(error_time(curves, np.reshape((*w, INNER[0]), (2, 2))) for w in lit)
    assert error_time(curves, best_even(curves)) == pytest.approx(least, rel=1e-9)
    w, n = best_with_samples(curves)
    for _ in range(200):
        factor = random.lognormal(0, 0.3, (2, 2))
        factor[1, 1] = 1  # its numbers of samples are at their bound
        assert error_time(curves, random.choice(INNER, (2, 2)), n * factor) > error_time(curves, w, n)
    assert n[1, 1] == 1 / MOST_SAMPLES and error_time(curves, w, n) < 0.9 * least


def test_cost_and_relative_error_of_renders(box: dmis.Scene, tmp_path: Path) -> None:
    """At every share the mean cost is what a render's rays cost, and relative over absolute error that of renders."""
    oracle = dmis.make_oracle(box, 256, parallel=1, folder=tmp_path)
    cost, factor = measure_patches(box, 4, dmis.Settings(), parallel=1)
    assert cost.shape == factor.shape == (len(GRID), 6, 8) and cost[HALF].std() > 0.05
    brightness = dmis.render(box, "auto", 128, seed=9, parallel=1).image.mean(axis=2)
    for k in (2, HALF, 10):
        result = dmis.render(box, f"fixed:{GRID[k]}", 256, seed=3, sampler="independent", parallel=1)
        rays = {kind: number / (24 * 32 * 256) for kind, number in result.rays.items()}
        truth = (CAMERA + 2 * SHADING) * rays["camera"] + RAY * (rays["shadow"] + rays["brdf"])
        truth += (SHADING + RAY) * rays["delta"]
        assert cost[k].mean() == pytest.approx(truth, rel=0.01)
        variance = result.variance.mean(axis=2)
        truth = (variance / (brightness**2 + EPSILON)).mean() / variance.mean()
        assert (oracle.variance[k] * factor[k]).mean() / oracle.variance[k].mean() == pytest.approx(truth, rel=0.1)


def test_model_has_the_numbers_of_python(page) -> None:
    """In Node: both measures of random shares and numbers of samples, set patch by patch, and the text for `Given`."""
    if (node := shutil.which("node")) is None:
        pytest.skip("needs node to run the page's numbers without a browser")
    (measures, text), random = page, np.random.default_rng(4)
    w, n = random.uniform(0, 1, (5, 7)), 2.0 ** random.integers(-3, 4, (5, 7))
    w[0, :3] = 0, 0.5, 1
    script = f"""const NAMES = ["balance", "oracle", "oracle + samples"];{SCRIPT}
        const model = new Model({data_of(text)}), w = {w.ravel().tolist()}, n = {n.ravel().tolist()};
        for (let turn = 0; turn < 100; turn++)
            for (let p = 0; p < w.length; p++) model.set(p, {{ w: turn < 99 ? Math.random() : w[p], n: n[p] }});
        const values = m => NAMES.map(name => model.of(model.maps[m][name]).value(m));
        const even = model.of({{ w, n: n.map(() => 1) }});
        console.log(JSON.stringify({{
            changes: MEASURES.map(m => [...even.changes(m)]),
            sums: MEASURES.map(m => 2 - even.base[m] / even.error[m] - even.base.time / even.time),
            values: MEASURES.map(m => model.value(m)), maps: MEASURES.map(values), python: model.python(),
            lines: [model.stroke([0.5, 0.5], [6.5, 0.5], 0), model.stroke([3.1, 2.1], [3.1, 2.1], 1)],
        }}));"""
    done = subprocess.run([node, "-"], input=script, capture_output=True, text=True, check=True)
    result = json.loads(done.stdout)
    for k, curves in enumerate(measures.values()):
        assert result["values"][k] == pytest.approx(error_time(curves, w, n), rel=1e-5)
        best = [1, error_time(curves, best_even(curves)), error_time(curves, *best_with_samples(curves))]
        assert result["maps"][k] == pytest.approx(best, rel=1e-5)
        assert np.sum(result["changes"][k]) == pytest.approx(result["sums"][k], abs=1e-5)
    disc = np.hypot(*(np.indices((5, 7)) + 0.5 - np.reshape([2.1, 3.1], (2, 1, 1)))) <= 1.5
    assert result["lines"] == [list(range(7)), np.flatnonzero(disc).tolist()]
    exec(result["python"], names := {})
    for values, truth in ((names["rule"].weight, w), (names["rule"].samples, n)):
        np.testing.assert_allclose(values, patch_spread(truth, 4, (19, 27)), rtol=1e-3)


def test_noise_has_the_predicted_variance(page) -> None:
    """In Node: normal noise of V(w) / (16 n) in each patch, the same with the same seed, and none in other patches."""
    if (node := shutil.which("node")) is None:
        pytest.skip("needs node to run the page's numbers without a browser")
    script = f"""{SCRIPT}
        const model = new Model({data_of(page[1])}), bytes = new Uint8ClampedArray(4 * 19 * 27).fill(7);
        model.set(8, {{ w: 0.16, n: 4 }});
        const normal = normals(19 * 27, 1), colours = new Float32Array(4 * 19 * 27).fill(0.4);
        model.addNoise(34, bytes, colours, normal); // the black patch at the corner, 3 by 3 pixels
        const many = normals(200000, 1);
        console.log(JSON.stringify({{ deviations: [8, 9].map(p => model.deviation(p)), bytes: [...bytes],
            start: [...many.slice(0, 513)], same: normal.every((x, k) => x === many[k]),
            mean: many.reduce((a, b) => a + b) / 200000, square: many.reduce((a, b) => a + b * b, 0) / 200000 }}));"""
    result = json.loads(subprocess.run([node, "-"], input=script, capture_output=True, text=True, check=True).stdout)
    variance = page[0]["absolute"].variance
    k = int(np.flatnonzero(np.isclose(GRID, 0.16))[0])
    expected = [np.sqrt(variance[k, 1, 1] / 64), np.sqrt(variance[HALF, 1, 2] / 16)]
    assert result["deviations"] == pytest.approx(expected, rel=1e-4)
    assert result["same"] and abs(result["mean"]) < 0.01 and result["square"] == pytest.approx(1, abs=0.02)
    grey = round(255 * (1.055 * 0.4 ** (1 / 2.4) - 0.055))
    painted = np.full((19, 27, 4), 7)
    painted[16:, 24:, :3] = grey
    np.testing.assert_array_equal(np.reshape(result["bytes"], (19, 27, 4)), painted)


@pytest.fixture
def tab(browser, page, tmp_path: Path):
    """The page in a tab."""
    (tmp_path / "play.html").write_text(page[1], "utf-8")
    with offline_tab(browser, tmp_path / "play.html") as tab:
        yield tab


def shown(tab) -> tuple[float, float, float]:
    """The score, and both measures of the table's first row, as the page has them in text."""
    cells = tab.locator("#rows tr").first.locator("td")
    return tuple(float(cell.inner_text()) for cell in (tab.locator("#score b"), cells.nth(1), cells.nth(2)))  # type: ignore[return-value]


def test_browser_stroke_has_the_number_of_python(tab, page) -> None:
    """A drawn line of shares, then one of samples: the numbers of the map that the same patches have in Python."""
    w, n = np.full((5, 7), 0.5), np.ones((5, 7))
    box = tab.locator("#stage").bounding_box()

    def at(column: float, row: float) -> tuple[float, float]:
        return box["x"] + box["width"] * 4 * column / 27, box["y"] + box["height"] * 4 * row / 19

    for brush, value, row in (("share w", 0.27, 1), ("samples", 2, 3)):
        tab.get_by_role("button", name=brush, exact=True).click()
        tab.locator("#value").fill(str(value))
        tab.locator("#size").fill("0")
        tab.mouse.move(*at(1.5, row + 0.5))
        tab.mouse.down()
        tab.mouse.move(*at(4.5, row + 0.5), steps=5)
        tab.mouse.up()
        if brush == "samples":
            n[row, 1:5] = 2**value
        else:
            w[row, 1:5] = value
        truth = [error_time(curves, w, n) for curves in page[0].values()]
        numbers = tab.evaluate("() => MEASURES.map(measure => model.value(measure))")
        assert numbers == pytest.approx(truth, abs=1e-4)
        assert shown(tab) == pytest.approx((truth[0], *truth), abs=5.1e-4)
    assert "2 strokes" in tab.locator("#strokes").inner_text()
    tab.get_by_role("button", name="absolute").click()
    assert shown(tab)[0] == pytest.approx(truth[1], abs=5.1e-4)
    tab.get_by_role("button", name="copy for dmis.Given").click()
    exec(tab.locator("#code").input_value(), names := {})
    np.testing.assert_array_equal(names["rule"].samples, patch_spread(n, 4, (19, 27)))
    for _ in range(2):
        tab.get_by_role("button", name="undo").click()
    assert shown(tab) == (1, 1, 1)


def test_browser_keys_and_touch(tab) -> None:
    """The keys move, paint, undo, change the value; a map is loaded by its button, and the best one beats all."""
    tab.get_by_role("button", name="oracle + samples").click()
    relative = shown(tab)[1]
    assert relative < 0.9 and "beats" not in tab.locator("#strokes").inner_text()
    tab.evaluate("set({ strokes: 1, x: 3.5, y: 2.5 })")
    assert "beats balance, thesis, oracle" in tab.locator("#strokes").inner_text()
    tab.get_by_role("button", name="balance").click()
    tab.locator("#stage").focus()
    for key in ("]", "-", "-", "-", "ArrowUp", "ArrowLeft", "Space", "ArrowRight", "b"):
        tab.keyboard.press(key)
    painted = tab.evaluate("() => [...model.w].flatMap((w, p) => w === 0.5 ? [] : [[p, w]])")
    assert painted == [[1 * 7 + 2, pytest.approx(0.26)]]
    tab.keyboard.press("u")
    assert shown(tab) == (1, 1, 1)
    tab.keyboard.press("u")
    assert shown(tab)[1] == relative
    assert tab.evaluate("() => [state.brush, getComputedStyle(stage).touchAction]") == ["n", "none"]


def test_browser_redo_and_save(tab) -> None:
    """Redo brings a stroke back; the file saved has the map."""
    tab.evaluate("""() => {
        set({ x: 2.5, y: 1.5, brush: "n", values: { w: 0.25, n: 4 } });
        $("size").value = 0;
        begin(); go(); finish();
    }""")
    score = shown(tab)
    for key in ("u", "y"):
        tab.keyboard.press(key)
    assert shown(tab) == score and tab.get_by_role("button", name="redo").is_disabled()
    with tab.expect_download() as download:
        tab.get_by_role("button", name="save as map.py").click()
    assert download.value.suggested_filename == "map.py"
    exec(Path(download.value.path()).read_text("utf-8"), names := {})
    assert names["rule"].samples[4, 8] == 16


def test_browser_page_fits(tab) -> None:
    """Nothing is wider than a phone; the brush, the number and the whole image are on the first screen."""
    for width, height in ((390, 844), (1920, 1080)):
        tab.set_viewport_size({"width": width, "height": height})
        assert tab.evaluate("() => document.documentElement.scrollWidth") <= width
        box = tab.locator("#stage").bounding_box()
        assert box["y"] + box["height"] <= height and tab.locator("#score").bounding_box()["y"] < box["y"]


def test_command_writes_the_page(tmp_path: Path, monkeypatch, capsys) -> None:
    """The second time from the cache; nothing in the page is loaded from elsewhere."""
    path = tmp_path / "play.html"
    command = ["play", "teapot-area-light", "--resolution", "24x20", "--spp", "16", "-o", str(path)]
    assert main(command) == 0 and "play.html: open it in a browser" in capsys.readouterr().out
    text = path.read_text("utf-8")
    assert not re.search(r"https?:|\bfetch\(|{{", text) and json.loads(data_of(text))["shape"] == [20, 24, 5, 6]
    monkeypatch.setattr("dmis.experiment.oracle_renders.render_halves", lambda *_, **__: pytest.fail("rendered again"))
    assert main(command) == 0 and path.read_text("utf-8") == text
