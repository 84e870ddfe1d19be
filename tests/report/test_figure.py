"""Figures and tables of a comparison for a paper, from its folder alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dmis
from dmis.cli.commands import main
from dmis.experiment.convergence import Interval, gains
from dmis.experiment.metrics import flip, relative_error
from dmis.experiment.runs import PINNED
from dmis.experiment.table import Comparison, read_comparison
from dmis.fit.registry import RULES
from dmis.image import read_exr, write_exr
from dmis.report.tables import TOO_FEW, Table, paper_table

pytest.importorskip("matplotlib")
from matplotlib.figure import Figure
from matplotlib.text import Text

from dmis.report import figure


def test_a_folder_tells_its_comparison(made: tuple[Comparison, Path]) -> None:
    """What is read has the numbers, images and reference of what was measured."""
    comparison, folder = made
    read = read_comparison(folder)
    assert read.runs.keys() == comparison.runs.keys() and read.about == comparison.about
    for mine, theirs in zip(gains(read.runs), gains(comparison.runs), strict=True):
        assert mine.rule == theirs.rule and mine.relmse.error == pytest.approx(theirs.relmse.error, rel=1e-4)
    assert all(np.array_equal(read.pictures[b]["RGB"], comparison.pictures[b]["RGB"]) for b in comparison.runs)
    assert read.reference.spp == 64
    np.testing.assert_array_equal(read.reference.second, comparison.reference.second)


IMAGE = "images/pbrt-8spp.exr"


@pytest.mark.parametrize(("name", "change", "message"), [
    *((name, Path.unlink, name) for name in ("results.csv", "comparison.json", "images/reference.exr", IMAGE)),
    ("results.csv", lambda path: path.write_text(path.read_text("utf-8").splitlines()[0] + "\n"), "csv has no rows"),
    (IMAGE, lambda path: write_exr(path, read_exr(path)[0]), "pbrt-8spp.exr must be an image that dmis rendered"),
])  # fmt: skip
def test_a_folder_that_is_not_whole_is_refused(
    made: tuple[Comparison, Path], tmp_path: Path, name: str, change: Callable[[Path], object], message: str
) -> None:
    """A file is missing, no run has a row, or an image does not say how it was rendered."""
    for path in made[1].rglob("*"):
        target = tmp_path / path.relative_to(made[1])
        if path.is_file() and path.suffix in (".csv", ".json", ".exr"):
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    change(tmp_path / name)
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        read_comparison(tmp_path)


def test_crops_are_where_rules_differ() -> None:
    """One rule is noisy in two places that do not touch; what both rules have counts nothing, nor does one pixel."""
    rng = np.random.default_rng(1)
    one = rng.uniform(0, 1, (60, 90))
    one[5:15, 60:75] += 30
    other = one.copy()
    other[40:50, 10:25] += 9
    other[20:30, 70:85] += 5
    other[50, 80] = 1e6
    (first, second) = figure.automatic_crops([one, other])
    for x0, y0, x1, y1 in (first, second):
        assert 0 <= y0 < y1 <= 60 and 0 <= x0 < x1 <= 90 and (y1 - y0, x1 - x0) == (10, 15)
    np.testing.assert_allclose([first[:2], second[:2]], [(10, 40), (70, 20)], atol=2)
    assert figure.automatic_crops([np.ones((9, 9)), np.zeros((9, 9))]) == [(0, 0, 8, 8)]  # they do not touch


def texts_of(drawn: Figure) -> list[Text]:
    """Names above the panels, and what is below."""
    return [text for axis in drawn.axes for text in (axis.title, axis.xaxis.label) if text.get_text()]


@pytest.mark.parametrize(("width", "errors"), [(7.0, False), (3.33, True)])
def test_panels_do_not_overlap(made: tuple[Comparison, Path], width: float, errors: bool) -> None:
    """Each panel lies in the figure and beside the others, its pixels are square, and texts stay inside."""
    comparison, _ = made
    shown = figure.contestants(comparison)
    assert [of.rule for of in shown] == ["balance", "pbrt", "thesis:patch=4", "second-moment"]
    windows = figure.automatic_crops([of.errors for of in shown])
    drawn = figure.draw(comparison, shown, windows, width=width, errors=errors)
    boxes = [axis.get_window_extent() for axis in drawn.axes]
    rows = len(windows)
    assert len(boxes) == 1 + rows * (len(shown) + 1) + rows * len(shown) * errors
    for k, a in enumerate(boxes):
        assert a.x0 > -1e-6 and a.x1 < drawn.bbox.x1 + 1e-6 and a.y0 > -1e-6 and a.y1 < drawn.bbox.y1 + 1e-6
        assert not any(a.x0 < b.x1 - 1 and b.x0 < a.x1 - 1 and a.y0 < b.y1 - 1 and b.y0 < a.y1 - 1 for b in boxes[:k])
        height, columns = drawn.axes[k].images[0].get_array().shape[:2]
        assert (a.width / columns) == pytest.approx(a.height / height, rel=1e-6)
    assert all(text.get_fontsize() >= 7 for text in texts_of(drawn))
    texts = [text.get_window_extent() for text in texts_of(drawn)]
    assert len(texts) == 2 * len(shown) + 1 and all(
        t.x0 > -1 and t.x1 < drawn.bbox.x1 + 1 and t.y0 > -1 and t.y1 < drawn.bbox.y1 + 1 for t in texts
    )


def test_words_of_a_figure(made: tuple[Comparison, Path]) -> None:
    comparison, _ = made
    (of, *_) = figure.contestants(comparison)
    drawn = figure.draw(comparison, [replace(of, rule="second-moment:patch=8,guard=12.5")] * 7, [(0, 0, 8, 8)], width=4)
    words = {word for text in texts_of(drawn) for word in text.get_text().split("\n")}
    assert {"second-", "patch=8,", "guard=12.5", "reference"} <= words
    wide = max(text.get_window_extent().width for text in texts_of(drawn))
    assert wide < drawn.axes[2].get_window_extent().x0 - drawn.axes[1].get_window_extent().x0
    # texts have the numbers of the table
    comparison, _ = made
    gain = next(g for g in gains(comparison.runs) if (g.rule, g.spp) == ("pbrt", 16))
    (_, of, *_) = figure.contestants(comparison, ["balance", "pbrt"], "mse")
    value, low, high = gain.mse.over_balance
    error = f"{gain.mse.error:.2e}".replace("e-0", "e-")
    assert of.lines == (f"MSE {error}", f"{value:.2f}×", f"({low:.2f}–{high:.2f})", f"{gain.cpu_seconds:.3g} CPU s")
    with pytest.raises(ValueError, match=r"among those of the comparison.*got 'pbr', did you mean 'pbrt'"):
        figure.contestants(comparison, ["pbr"])


def test_tables_are_bold_where_the_interval_allows(made: tuple[Comparison, Path]) -> None:
    """Bold are the ratios whose whole interval is below 1, and no others; CSV has all digits."""
    comparison, _ = made
    rows = [g for g in gains(comparison.runs) if g.rule != PINNED]
    ratios = [r for g in rows for m in g.measures for r in (m.over_balance, m.error_time)]
    wins = sum(r.high < 1 for r in ratios)
    latex, markdown, numbers = (paper_table(comparison).text(style) for style in (".tex", ".md", ".csv"))
    assert latex.count(r"\textbf") == wins and markdown.count("**") == 2 * wins and wins < len(ratios)
    assert latex.count(r"\midrule") == 2 and r"\toprule" in latex and "thesis:patch=4" in latex
    assert len(numbers.splitlines()) == 1 + len(rows) == markdown.count("\n|")
    head, *cells = (line.split(",") for line in numbers.splitlines())
    low = float(cells[1][head.index("relmse_over_balance_low")])
    assert low == pytest.approx(rows[1].relmse.over_balance.low, rel=1e-4)


@pytest.mark.parametrize("high", [0.02, 2e5, np.inf])
def test_wide_intervals_are_a_dash_with_a_note(high: float) -> None:
    """From two seeds an interval may reach from 0.00001 to 200,000, which says nothing; CSV keeps the ends."""
    table = Table(["spp", "rule", "MSE / balance"], [["8", "thesis", Interval(0.015, 0.01, high)]])
    latex, markdown, numbers = map(table.text, (".tex", ".md", ".csv"))
    assert ("0.0150 (–)" in markdown) == ("0.0150 (–)" in latex) == (high > 1)
    assert markdown.endswith(f"\n\n{TOO_FEW}\n") == latex.endswith(f"\n% {TOO_FEW}\n") == (high > 1)
    assert numbers.endswith(f",0.01,{high:.5g}\n")


def test_figure_command(made: tuple[Comparison, Path], tmp_path: Path, monkeypatch, capsys) -> None:
    """One command makes a picture, a page or a table, as the extension says; what cannot be drawn is named. Rules of
    plugins need no plugin, since nothing is rendered.
    """
    monkeypatch.delitem(RULES, "pbrt")
    folder = str(made[1])
    begins = {
        "f.pdf": "%PDF", "f.html": "<!doctype", "f.svg": "<?xml", "f.tex": "% needs", "f.md": "| spp", "f.csv": "spp,"
    }  # fmt: skip
    for name, begin in begins.items():
        assert main(["figure", folder, "-o", str(tmp_path / name), "--rules", "pbrt,balance", "--errors"]) == 0
        assert ("--crops" in capsys.readouterr().out) == (begin[0] in "%<" and name != "f.tex")
        assert (tmp_path / name).read_bytes().startswith(begin.encode())
    assert "thesis" not in (tmp_path / "f.csv").read_text()
    crops = ["--crops", "0,0,8,8", "9,9,17,17"]
    assert main(["figure", folder, "-o", str(tmp_path / "g.png"), *crops, "--metric", "mse", "--width", "3.5"]) == 0
    assert (tmp_path / "g.png").read_bytes().startswith(b"\x89PNG")
    assert main(["figure", folder, "-o", str(tmp_path / "m.csv"), "--metric", "mse"]) == 0
    assert (tmp_path / "m.csv").read_text().startswith("spp,rule,mse,mse_over_balance,mse_over_balance_low,")
    for more, message in (
        (["--crops", "0,0,8,8", "9,9,18,17"], "crops of a figure must have one size; got 8x8, 9x8"),
        (["--crops", "10,10,8,8"], "a window must be (x0, y0, x1, y1) in pixels"),
        (["--metric", "psnr"], "metric must be relmse or mse or flip; got 'psnr'"),
        (["-o", str(tmp_path / "x.md"), "--metric", "flip"], "metric of a table must be relmse or mse; got 'flip'"),
        (["-o", str(tmp_path / "x.gif")], "extension of a figure must be .pdf or .png or .svg or .html or .tex"),
        (["-o", str(tmp_path / "x.md"), "--rules", "pbr"], "got 'pbr', did you mean 'pbrt'"),
    ):
        assert main(["figure", folder, "-o", str(tmp_path / "x.png"), *more]) == 2
        assert message in capsys.readouterr().err


def test_errors_of_an_image(made: tuple[Comparison, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``info A B`` prints what the library computes, and draws its map; images of two sizes are refused."""
    comparison, folder = made
    image, truth = folder / "images" / "pbrt-8spp.exr", folder / "images" / "reference.exr"
    assert main(["info", str(image), str(truth), "-o", str(tmp_path / "d.png")]) == 0
    words = capsys.readouterr().out.split()
    pixels = comparison.pictures["pbrt", 8]["RGB"]
    assert float(words[1]) == pytest.approx(dmis.mse(pixels, comparison.reference), rel=1e-4)
    assert float(words[3]) == pytest.approx(relative_error(pixels, comparison.reference).mean(), rel=1e-4)
    assert (tmp_path / "d.png").read_bytes().startswith(b"\x89PNG")
    small = tmp_path / "small.exr"
    dmis.write_exr(small, pixels[:4, :5])
    for words, message in (
        ([str(small), str(truth)], "images must have one size; got 5x4 and"),
        ([str(image), "-o", "d.png"], "info takes a scene, an image, or two images"),
        ([str(image)] * 3, "info takes a scene, an image, or two images"),
    ):
        assert main(["info", *words]) == 2 and message in capsys.readouterr().err


def test_flip(monkeypatch: pytest.MonkeyPatch) -> None:
    """0 for an image itself, more for more noise, and 1 at most."""
    pytest.importorskip("flip_evaluator", reason="needs flip-evaluator")
    rng = np.random.default_rng(2)
    image = rng.uniform(0, 1, (32, 40, 3)).astype(np.float32)
    noisy, noisier = (image + s * rng.normal(size=image.shape).astype(np.float32) for s in (0.05, 0.3))
    assert flip(image, image).max() == 0
    assert 0 < flip(noisy, image).mean() < flip(noisier, dmis.Reference(image, image, 1)).mean() <= 1
    # flip is an extra
    monkeypatch.setitem(__import__("sys").modules, "flip_evaluator", None)
    with pytest.raises(ImportError, match=r"pip install 'dmis\[flip\]'"):
        flip(np.ones((4, 4, 3)), np.ones((4, 4, 3)))
