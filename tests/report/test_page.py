"""The report: one page that needs nothing else, says what results.csv says, and works in a browser."""

import base64
import csv
import dataclasses
import html
import io
import json
import re
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from helpers import run
from PIL import Image

from dmis import plot
from dmis.experiment.convergence import gains, ratio_text
from dmis.experiment.runs import PINNED
from dmis.experiment.table import Comparison
from dmis.report.comparer import linear_png
from dmis.report.page import write_report
from dmis.report.plots import INK, convergence, error_lines, map_png
from dmis.report.tables import paper_table, report_tables, summary

RULES, SPP = ["pbrt", "thesis:patch=4", "second-moment"], [8, 16]
ALL = ["balance", *RULES, PINNED]


@pytest.fixture(scope="module")
def page(made: tuple[Comparison, Path]) -> str:
    return (made[1] / "report.html").read_text("utf-8")


def tables_of(page: str) -> dict[str, list[list[str]]]:
    """Return the texts of the cells of tables by the tables' classes, titles first."""
    tables = {}
    for kind, table in re.findall(r'<table class="([^"]*)">(.*?)</table>', page, re.S):
        rows = re.findall(r"<tr[^>]*>(.*?)</tr>", table, re.S)
        cells = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.S) for row in rows]
        tables[kind] = [[html.unescape(re.sub(r"<[^>]*>", "", cell)) for cell in row] for row in cells]
    return tables


def decoded(uri: str) -> np.ndarray:
    """Pixels of a PNG in a data URI."""
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2], validate=True))))


def half_floats(uri: str) -> np.ndarray:
    """What the page's script makes of a PNG."""
    high, low = np.split(decoded(uri).astype(np.uint16), 2)
    return (high << 8 | low).astype(np.uint16).view(np.float16)


def test_page_is_whole(page):
    """Nothing is asked of the network or left over of a template; tags match; a name is given once."""
    assert not re.search(r"https?:|//[\w-]+\.\w|@import|\bfetch\(|url\(\s*[^#)]", page)
    assert all(source.startswith("data:image/png;base64,") for source in re.findall(r'\ssrc="([^"]*)"', page))
    assert re.findall(r'\shref="([^"#][^"]*)"', page.replace("xlink:href", "href")) == ["data:,"]
    assert not re.search(r"{[{%]", page) and INK not in page
    body = re.sub(r"<(script|svg|style).*?</\1>", "", page, flags=re.S)
    opened, closed = (Counter(re.findall(rf"<{slash}([a-z]\w*)", body)) for slash in ("", "/"))
    assert set(opened - closed) == {"meta", "link", "img", "input", "br", "wbr"} and not closed - opened
    names = re.findall(r'\sid="([^"]*)"', page)
    assert len(names) == len(set(names))
    assert {*re.findall(r'href="#([^"]*)"', page), *re.findall(r"url\(#([^)]*)\)", page)} <= set(names)


def test_pictures_decode(page):
    """Every data URI is a PNG of some pixels."""
    pictures = [decoded(uri) for uri in re.findall(r"data:image/png;base64,[A-Za-z0-9+/=]+", page)]
    assert len(pictures) == 5 + 6  # share maps of five rules; images
    assert all(pixels.shape[2] == 3 and min(pixels.shape[:2]) >= 6 for pixels in pictures)


def test_bold_is_the_winner_of_its_table():
    """A rule with half the relMSE and 1.02 of the MSE, and one that wins by MSE; no row of costs is bold."""
    runs = {
        (rule, 8): [dataclasses.replace(run(rule, 8, k, 1.0, mse), relmse=relmse) for k in range(2)]
        for rule, relmse, mse in (("balance", 1, 1), ("first", 0.5, 1.02), ("second", 1.1, 0.7))
    }
    runs |= {(PINNED, 8): [dataclasses.replace(run, rule=PINNED) for run in runs["balance", 8]]}
    tables = report_tables(Comparison({"scene": "box"}, runs, {}, None), gains(runs))
    best = {
        kind: [row[1] for row, mark in zip(table.rows, table.marks, strict=False) if "best" in mark]
        for kind, table in tables.items()
    }
    assert best == {"efficiency relMSE": ["first"], "efficiency MSE": ["second"], "costs": []}


@pytest.mark.usefixtures("without_plots")
@pytest.mark.parametrize("added", [0, 100])
def test_nothing_is_bold_where_few_pixels_decide(made, tmp_path, added):
    """One pixel of balance's image may have nearly all of the error: all that print a winner say so then."""
    runs = {of: [run(*of, k, 1.0, 1.0 - 0.5 * (of[0] != "balance")) for k in range(3)] for of in made[0].runs}
    layers = made[0].pictures["balance", 16]
    bright = layers["RGB"] + added * (np.indices(layers["RGB"].shape).sum(axis=0) == 0)
    pictures = {**made[0].pictures, ("balance", 16): {**layers, "RGB": bright}}
    changed = dataclasses.replace(made[0], runs=runs, pictures=pictures)
    write_report([changed], tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text("utf-8")
    tables = [paper_table(changed).text(form) for form in (".tex", ".md")]
    for bold in ('best"><td>', "is more efficient than", r"\textbf", "**0.5"):
        assert (bold in "".join([page, *tables])) == (not added)
    assert all(("ratios may be much too short" in text) == bool(added) for text in (page, summary(changed)))


def test_images_are_the_renders(made, page):
    """What the comparer shows is the first seed's image to half a float, and the mean of the reference's halves."""
    comparison, _ = made
    scene = json.loads(re.search(r'id="data">(.*?)</script>', page, re.S).group(1))["scenes"][0]
    labels = [image["label"] for image in scene["images"]]
    assert labels == ["reference", *(f"{rule}, 16 spp" for rule in ALL)]
    assert (scene["width"], scene["height"]) == (32, 24) and scene["scale"] > 0
    images = [half_floats(image["png"]).astype(np.float32) for image in scene["images"]]
    np.testing.assert_allclose(images[0], comparison.reference.mean, rtol=1e-3, atol=1e-7)
    for rule, image in zip(ALL, images[1:], strict=True):
        np.testing.assert_allclose(image, comparison.pictures[rule, 16]["RGB"], rtol=1e-3, atol=1e-7)


def test_efficiency_follows_from_the_file(made, page):
    """Means, medians and 1 / (MSE s), computed once more from results.csv."""
    with open(made[1] / "results.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    kinds = "efficiency relMSE", "efficiency MSE", "costs"
    *both, costs = (
        [dict(zip(head, line, strict=True)) for line in lines] for head, *lines in map(tables_of(page).get, kinds)
    )
    assert len(both[0]) == len(costs) == 10
    spp = ""
    for one, other, cost in zip(*both, costs, strict=True):
        cells = one | other
        spp = cells["spp"] or spp
        mine, pinned = ([r for r in rows if (r["rule"], r["spp"]) == (rule, spp)] for rule in (cells["rule"], PINNED))
        seconds = np.median([float(row["cpu_seconds"]) for row in mine])
        assert float(cost["CPU s"]) == pytest.approx(seconds, abs=0.0051) and cost["rule"] == cells["rule"]
        for name in ("MSE", "relMSE"):
            error, of_pinned = (np.mean([float(row[name.lower()]) for row in of]) for of in (mine, pinned))
            assert float(cells[name]) == pytest.approx(error, rel=1e-3)
            assert float(cost[f"{name}·CPU s"]) == pytest.approx(error * seconds, rel=0.01)
            assert float(cells[f"{name} / pinned"].split()[0]) == pytest.approx(error / of_pinned, abs=6e-4)
            if cells["rule"] == "balance":
                assert cells[f"{name} in equal time"] == "1.000"


def test_several_scenes(made, tmp_path):
    """An overview, and a section and a comparer for each."""
    comparison, _ = made
    path = tmp_path / "folder" / "two.html"
    other = Comparison({**comparison.about, "scene": "a <b> & c"}, comparison.runs, {}, comparison.reference)
    write_report([comparison, other], path, "Two & more")
    text = path.read_text("utf-8")
    assert text.count("<section ") == 2 and text.count('class="viewer"') == 2 and "Two &amp; more" in text
    assert 'alt="share map of thesis:patch=4"' in text
    assert "a &lt;b&gt; &amp; c" in text and "a <b> & c</h2>" not in text
    overview = tables_of(text)["overview"]
    assert overview[0] == ["rule", "box", "a <b> & c", "all, relMSE·CPU s", "all, MSE·CPU s"]
    assert [row[0] for row in overview[1:]] == ALL
    times = {g.rule: g.relmse.equal_time for g in gains(comparison.runs) if g.spp == 16}
    assert [row[1] for row in overview[1:]] == [ratio_text(times[rule]) for rule in ALL]


def test_errors_that_have_no_logarithm(made, tmp_path):
    """Two halves of a noisy reference may estimate an error below zero: no line, no number, and no failure."""
    comparison, _ = made
    for mse in (-1e-9, 0.0):
        runs = {
            budget: [dataclasses.replace(run, mse=mse, relmse=mse) for run in of]
            for budget, of in comparison.runs.items()
        }
        report = dataclasses.replace(comparison, runs=runs)
        write_report([report], tmp_path / "report.html")
        convergence(report, tmp_path / "convergence.png")
        tables = tables_of((tmp_path / "report.html").read_text("utf-8"))
        assert all(row[5] == "–" for name in ("relMSE", "MSE") for row in tables[f"efficiency {name}"][1:])


def test_linear_png_keeps_all_half_floats():
    """Exactly, from the smallest to the largest, signs and all; what is larger or no number becomes one."""
    values = np.arange(2**16, dtype=np.uint16).view(np.float16)
    values = values[np.isfinite(values)][: 3 * 21000].reshape(70, 300, 3)
    np.testing.assert_array_equal(half_floats(linear_png(values.astype(np.float32))), values)
    odd = half_floats(linear_png(np.array([[[1e9, np.nan, -1e9]]], np.float32)))
    np.testing.assert_array_equal(odd, [[[65504, 0, -65504]]])
    # the ends of the palette at the ends of the range
    pixels = decoded(map_png(np.array([[0.0, 1.0, 2.0]]), "magma"))
    low, high = (tuple(int(c[k : k + 2], 16) for k in (1, 3, 5)) for c in plot.palette("magma", 2))
    np.testing.assert_allclose(pixels[0], [low, high, high], atol=1)  # of rounding


@pytest.mark.parametrize("seconds, rays", [((0.4, 0.9), (3.1e8, 5.9e8)), ((0.1, 60), (1e5, 2e9))])
def test_ticks_say_different_things(made, seconds, rays):
    """No two places of an axis have the same number, in a range of less than twice or of many powers of ten."""
    (run,) = made[0].runs["balance", SPP[0]][:1]
    runs = {
        ("balance", n): [dataclasses.replace(run, spp=n, render_seconds=t, rays=int(r), mse=1 / n)]
        for n, t, r in zip((8, 16), seconds, rays, strict=True)
    }
    for size in ((12, 5), (5.4, 2.4)):
        figure, axes = plot.canvas(1, 2, *size)
        for axis, over in zip(axes[0], ("seconds", "rays"), strict=True):
            error_lines(axis, runs, over)
        figure.canvas.draw()
        for side in (side for axis in axes[0] for side in (axis.xaxis, axis.yaxis)):
            labels = [label for label in side.get_ticklabels() if label.get_text()]
            boxes = [label.get_window_extent() for label in labels]
            assert len({label.get_text() for label in labels}) == len(labels) >= 2
            assert not any(a.overlaps(b) for a, b in pairwise(boxes))


def test_names_that_are_code(made, tmp_path):
    """A scene's name is its file's, which may be anything: it is shown, and nothing else."""
    comparison, _ = made
    name = r'a"><img src=x onerror=alert(1)> \b\g<0> {{data}} <!--<script> $\frac$'
    odd = dataclasses.replace(comparison, about={**comparison.about, "scene": name})
    write_report([odd], tmp_path / "report.html")
    convergence(odd, tmp_path / "convergence.png")
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "<img src=x" not in page and page.count("<svg") == 3 and page.count("<script>") == 1
    assert html.unescape(re.findall("<h2>(.*?)</h2>", page)[0]) == name
    assert all(html.escape(f"Root of {error} over CPU seconds, {name}") in page for error in ("relMSE", "MSE"))


@pytest.mark.usefixtures("without_plots")
def test_winner_needs_an_interval_below_one(made, tmp_path):
    """With one seed, or a reference as noisy as the images, the page says why there is no winner."""
    comparison, _ = made

    def told(change, seeds=5) -> str:
        """The page with five seeds, each made of the first one's run."""
        runs = {}
        for budget, (of, *_) in comparison.runs.items():
            same = [dataclasses.replace(of, seed=k, mse=1 / of.spp, relmse=1 / of.spp) for k in range(seeds)]
            runs[budget] = list(map(change, same))
        write_report([dataclasses.replace(comparison, runs=runs)], tmp_path / "report.html")
        return (tmp_path / "report.html").read_text("utf-8")

    def better(run):
        factor = 0.5 if run.rule == "pbrt" else 1.0
        times = {"pilot_seconds": 0.0, "fit_seconds": 0.0, "render_seconds": run.spp, "cpu_seconds": run.spp}
        return dataclasses.replace(run, relmse=factor * (1 + 0.01 * run.seed) / run.spp, **times)

    none = "no rule has a 95 % interval of error × CPU time below that of the balance heuristic"
    page = told(better)
    assert "<b>pbrt</b> is more efficient" in page and "0.50 times as large (95 % interval 0.50 to 0.50" in page
    assert "corrected for 3 rules" in page and "the lowest of" not in page
    assert re.search(r'<tr class="[^"]*best"><td></td><td>pbrt<', page)
    page = told(better, seeds=1)
    assert none in page and "One seed shows no scatter of times" in page
    assert "rules cannot be compared" in told(lambda run: dataclasses.replace(run, relmse=-1e-6))
