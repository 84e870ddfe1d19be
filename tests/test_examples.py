"""The example scripts at their quick size, and their options."""

import csv
import importlib
import itertools
import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import pytest
from PIL import Image
from rows import write_rows
from scripts import run_alone, run_script  # noqa: F401  # a fixture

from dmis.examples.gallery import SCENES

pytest.importorskip("matplotlib")

from dmis.examples.gallery import options

ROOT = Path(__file__).parent.parent
FIGURES = sorted((ROOT / "examples").rglob("plot_*.py"))
PROCESSES = ["plot_scale"]
"""Figures that are drawn in a process of their own, because they start others."""
THESIS = ["fig_2_1", "fig_3_1", "fig_3_2", "fig_3_3", "fig_3_4", "fig_3_5", "fig_4_1", "fig_5_1", "table_4_1", "eq_3_1"]


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """References of the quick size, shared by the scripts of one session."""
    return tmp_path_factory.mktemp("references")


@pytest.fixture
def run(run_script, cache, monkeypatch):  # noqa: F811
    """Function that runs a script at its quick size in this process, and returns what it prints."""
    monkeypatch.setenv("DMIS_CACHE", str(cache))
    return lambda script, *arguments: run_script(script, "--quick", *arguments)


@pytest.fixture
def score_tables(monkeypatch):
    """The module that makes the tables of the reproduction."""
    monkeypatch.syspath_prepend(ROOT / "examples" / "thesis")
    return importlib.import_module("score_tables")


def run_process(script: Path, cache: Path, *arguments: str | Path, scenes: Path | None = None) -> str:
    """Run a script at its quick size in a process of its own; return what it prints."""
    environment = {**os.environ, "DMIS_CACHE": str(cache)}
    environment.pop("DMIS_PBRT_SCENES", None)
    if scenes is not None:
        arguments = (*arguments, "--scene-dir", scenes)
    done = subprocess.run(
        [sys.executable, script, "--quick", *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=1200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == "" or scenes is not None  # the original files have lines that are not used
    return done.stdout


def check(picture: Path) -> None:
    """A picture of some size, with a title and a caption that say something."""
    with Image.open(picture) as image:
        about = image.info
        assert min(image.size) > 300
    assert len(about["Title"]) > 10 and len(about["Description"]) > 100
    assert not re.search(r"\bnan\b", about["Description"])


def test_figures_of_the_thesis_show_the_fit():
    """Scripts that call the library's fit print its code at the end of a cell, below which the site has it, too."""
    texts = [path.read_text("utf-8") for path in FIGURES if path.parent.name == "thesis"]
    fits = [text for text in texts if "parabola_minimum" in text]
    assert len(fits) == 6
    assert all(re.search(r"^print\(getsource\(parabola_minimum\)\)\n\n# %%", text, re.M) for text in fits)


@pytest.mark.examples
@pytest.mark.parametrize("script", FIGURES, ids=lambda script: script.stem)
def test_figure(script, run, cache, tmp_path):
    """It runs without a word on standard error, and draws."""
    picture = tmp_path / "figure.png"
    alone = script.stem in PROCESSES
    printed = run_process(script, cache, "-o", picture) if alone else run(script, "-o", picture)
    assert printed.rstrip().endswith(str(picture))
    check(picture)
    with Image.open(picture) as image:
        dpi, about = image.info["dpi"][0], image.info
        assert dpi > 199.9 and image.size[0] / dpi < 7.01
    assert float(about["Letters"]) >= 7 and int(about["Legends"]) <= 1
    if script.parent.name == "thesis":  # for print
        assert picture.with_suffix(".pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.slow
@pytest.mark.parametrize("script", FIGURES, ids=lambda script: script.stem)
def test_figure_of_the_original_scenes(script, cache, tmp_path, pbrt_scenes):
    picture = tmp_path / "figure.png"
    run_process(script, cache, "-o", picture, scenes=pbrt_scenes)
    check(picture)


@pytest.mark.examples
def test_contact_sheet(run, tmp_path):
    """One line per script; a page that shows what there is."""
    script = ROOT / "examples" / "make_figures.py"
    lines = run(script, "-o", tmp_path / "any.png", "--only", "fig_2_1", "1d_mixture").splitlines()
    assert len(lines) == 2 + 1 and "plot_fig_2_1_variance" in lines[0]
    page = (tmp_path / "index.html").read_text("utf-8")
    assert page.count("<figure ") == 2 and 'src="plot_1d_mixture.png"' in page
    headings = [page.index(f"<h2>{heading}</h2>") for heading in ("The thesis, figure by figure", "Explained")]
    assert headings[0] < page.index("thesis/plot_fig_2_1") < headings[1] < page.index("explained/plot_1d_mixture")
    assert "<h2>Measured</h2>" not in page
    assert "MSE" in (tmp_path / "plot_fig_2_1_variance.txt").read_text("utf-8")


@pytest.mark.parametrize(
    ("options", "message"),
    [("--quick", "default size; got --quick"), ("--scene-dir=.", "got the scene folder .. Unset DMIS_PBRT_SCENES")],
)
def test_other_scenes_are_not_published(options, message, tmp_path, monkeypatch):
    """Pages show figures of the default size, and of the scenes that come with dmis."""
    script = ROOT / "examples" / "make_figures.py"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(script), "--publish", "docs", options])
    monkeypatch.delenv("DMIS_QUICK", raising=False)
    with pytest.raises(SystemExit, match=re.escape(message)):
        run_alone(lambda: runpy.run_path(str(script), run_name="__main__"), script.parent, monkeypatch)
    assert not (tmp_path / "docs").exists()


@pytest.mark.examples
def test_errors_are_resumed(run, tmp_path, monkeypatch):
    """A row for each render; a second run renders nothing, and more seeds leave the rows of the first."""
    monkeypatch.setenv("DMIS_CACHE", str(tmp_path))
    script, table = ROOT / "examples" / "thesis" / "make_score.py", tmp_path / "results.csv"
    arguments = ("--divisor", "64", "--csv", table, "-o", tmp_path / "a.png", "--scenes", "teapot-area-light")
    assert run(script, *arguments, "--seeds", "1").count(" s\n") == 6 + 3 + 2 + 11  # all rows of the page
    first = table.read_text("utf-8")
    assert run(script, *arguments, "--seeds", "1") == "" and table.read_text("utf-8") == first
    run(script, *arguments, "--seeds", "2", "--setups", "nearest", "--rules", "balance", "power")
    rows = list(csv.DictReader(table.read_text("utf-8").splitlines()))
    assert len(rows) == 22 + 2 and set(first.splitlines()) <= set(table.read_text("utf-8").splitlines())
    assert 0 < sum(float(row["clipped mse"]) for row in rows) < sum(float(row["linear mse"]) for row in rows)
    assert all(row["linear own"] == row["linear balance"] for row in rows if row["rule"] == "balance")


def test_set_ups_of_the_reproduction(tmp_path, monkeypatch):
    """Points, numbers of samples, integrator and samples of the final pass; Eq. 3.5 without dmis's choices."""
    from dmis.fit.thesis import parabola_minimum

    script = ROOT / "examples" / "thesis" / "make_score.py"
    arguments = ["--seeds", "0", "--csv", tmp_path / "a.csv", "-o", tmp_path / "a.png"]
    monkeypatch.setattr(sys, "argv", [str(script), *map(str, arguments)])
    cells = {}
    run_alone(lambda: cells.update(runpy.run_path(str(script), run_name="__main__")), script.parent, monkeypatch)
    teapot, setups = cells["scene_of"]("teapot-area-light"), []
    for setup, name in itertools.product(("independent", "nearest"), ("tt", "killeroo-gold")):
        settings = cells["SETUPS"][setup].settings(teapot, name)
        setups.append((settings.sampler, settings.shading_samples, settings.integrator))
    assert setups[0] == setups[1] == ("independent", 2, "direct")
    assert setups[2:] == [("lowdiscrepancy", 32, "direct"), ("lowdiscrepancy", 2, "path")]
    assert [setup.final() for setup in cells["SETUPS"].values()] == [122, 122, 128, 128, 128]
    w, y = np.array([0, 0.5, 1]), np.random.default_rng(1).exponential(size=(3, 5, 6))
    expected, status = parabola_minimum(w, y)
    raw = cells["Printed"]().fit_variances(w, y, 1).maps["raw"]
    np.testing.assert_allclose(raw[status < 2], expected[status < 2])
    assert 0 < (raw[status == 2] != expected[status == 2]).sum() and (status < 2).sum() > 4


def planted_results(path: Path, blocks: dict[str, np.ndarray]) -> None:
    """Write a table of results of two seeds with the errors of blocks ``(2, n)`` of each rule, on all scenes."""
    rows = []
    for scene, (rule, errors), seed in itertools.product(SCENES, blocks.items(), range(2)):
        e, balance, tilt = errors[seed], blocks["balance"][seed], blocks["tilt"][seed]
        moments = {"mse": e.sum(), "own": (e * e).sum(), "balance": (e * balance).sum(), "tilt": (e * tilt).sum()}
        row = {"setup": "independent", "scenes": "shipped", "divisor": 4, "scene": scene, "rule": rule, "seed": seed}
        row |= {"blocks": e.size, "seconds": 3 if rule == "balance" else 4}
        row |= {f"{of} {name}": f"{v:.17g}" for of in ("linear", "clipped") for name, v in moments.items()}
        rows.append(row)
    write_rows(path, rows, list(rows[0]))


def test_tables_of_planted_errors(score_tables, tmp_path, monkeypatch):
    """Ratios, intervals, scores, bounds and seconds by hand."""
    rng = np.random.default_rng(3)
    balance, shares = rng.exponential(1e-5, (2, 2, 50))
    blocks = {"balance": balance, "tilt": 2 * balance, "shares": shares, "patch 4": balance}
    planted_results(tmp_path / "results.csv", blocks)
    monkeypatch.setattr(score_tables, "measured", lambda: score_tables.read(tmp_path / "results.csv"))
    printed = "\n".join(line for lines in score_tables.tables().values() for line in lines)
    told = np.array([about.equal_samples for about in SCENES.values()])
    assert "| thesis, equal time × 119 / 122 | 0.091 |  |  |" in printed and " of 1 | 0.180 |  |  |" in printed
    score = np.sqrt((np.log(2 / told) ** 2).mean())
    ratio = shares.sum() / balance.sum()
    half = 1.96 * ratio * np.sqrt(((shares / shares.sum() - balance / balance.sum()) ** 2).sum() * 100 / 99)
    mse, bound = balance.sum() / 2, 0.94465 * 128 / 122
    assert f"| independent, 1/4, 2 seeds | {score:.3f} ({score:.3f} – {score:.3f}) |" in printed
    assert (
        f"| TT | independent, 1/4, 2 seeds | {mse:.2e} (8.252e-06): {mse / 8.252e-6:.2g} | {2 * mse:.2e} (1.06e-05) |"
        f" 2.000 ± 0.000 (1.286) | no | {bound:.3f} | {ratio:.3f} ± {half:.3f} |"
    ) in printed
    assert f"| TT | independent, 1/4, 2 seeds | 48 +33% (147 +4%) | {8 / 3:.3f} (1.299) |" in printed
    assert f"| patches of 4×4 pixels | {' | '.join(4 * ['1.000 ± 0.000'])} | 0.180 |" in printed


def test_results_about_the_sun_are_those_of_the_page(score_tables):
    """The page's block is made of sun.csv, which no piece makes."""
    text = (ROOT / "docs" / "thesis.md").read_text("utf-8")
    assert "\n".join(["<!-- sun: begin -->", *score_tables.sun(), "<!-- sun: end -->"]) in text


def test_caption_of_tt_repeats_the_tables(score_tables):
    """The script of Fig. 5.1 measures one ratio; those of another set-up and another sky are of the page's rows."""
    captions = json.loads((ROOT / "docs" / "figures" / "captions.json").read_text("utf-8"))
    value, variance, _ = score_tables.Group("nearest").ratio("tt", "tilt")
    sunless = next(
        row["tilt"] for row in score_tables.read(score_tables.TABLES / "sun.csv") if "overcast" in row["scene"]
    )
    numbers = f"nearest: {value:.2f} ± {1.96 * value * variance**0.5:.2f}; sunless: {sunless}"
    assert numbers in captions["plot_fig_5_1_limitation_tt"]["caption"]


def test_numbers_of_the_reproduction_have_a_source():
    """A number with a decimal point in its text is in a table or caption, one in a figure's row in its caption."""
    page = (ROOT / "docs" / "thesis.md").read_text("utf-8")
    captions = json.loads((ROOT / "docs" / "figures" / "captions.json").read_text("utf-8"))
    page = re.sub(r"```.*?```|<!--.*?-->|^    .*?$", "", page, flags=re.S | re.M)
    rows = dict(re.findall(r"^(\|.*\(figures/(\w+)\.webp.*)$", page, re.M))
    assert len(rows) == len(THESIS)
    tables = "\n".join(line for line in page.splitlines() if line.startswith("|") and line not in rows)
    shown = {stem: captions[stem]["caption"] for stem in [*rows.values(), "plot_shares_and_points"]}
    sources = {line: shown[stem] for line, stem in rows.items()}
    for line in page.splitlines():
        if not line.startswith("|") or line in rows:
            source = sources.get(line, "\n".join([tables, *shown.values(), "0.1.0"]))
            named = r"\]\([^)]*\)|Fig\. \d\.\d|(?:Eq|Sec|Table|Figure)s?\.? \d\.\d(?:(?:,| and) \d\.\d)*"
            text = re.sub(named, "", line)
            assert [n for n in re.findall(r"\d+\.\d+", text) if n not in source] == [], line


MEASUREMENTS = [
    ("make_points_table", "show_points", ("--seeds", "2", "--scenes", "tt"), {"| geometric mean |": 2}),
    ("make_parabola_table", "", ("--seeds", "1"), {"| 4 | ": 4, "nan": 0}),
    pytest.param("make_stability_table", "", (), {"| offset |": 1, "| veach-mis": 1}, marks=pytest.mark.slow),
    ("make_path_table", "show_paths", ("--seeds", "2", "--scenes", "tt"), {"| tt ": 2}),
]
"""Scripts that measure, the module with their tables if it is another, arguments, and parts of the tables."""


@pytest.mark.examples
@pytest.mark.parametrize("script, module, arguments, counts", MEASUREMENTS)
def test_measurements_are_resumed_and_make_tables(run, tmp_path, monkeypatch, script, module, arguments, counts):
    """A second run measures nothing again; tables come from the rows alone."""
    rows = tmp_path / "rows.csv"
    run(ROOT / "benchmarks" / f"{script}.py", *arguments, "--csv", rows)
    before = rows.read_bytes()
    run(ROOT / "benchmarks" / f"{script}.py", *arguments, "--csv", rows)
    assert rows.read_bytes() == before
    shown = importlib.import_module(module or script)
    monkeypatch.setattr(shown, "CSV", rows)
    if hasattr(shown, "measured"):
        shown.measured.cache_clear()
    text = "\n".join(line for lines in shown.tables().values() for line in lines)
    if hasattr(shown, "measured"):
        shown.measured.cache_clear()
    assert {part: text.count(part) for part in counts} == counts


@pytest.mark.examples
def test_stability_figure(run, tmp_path):
    """Float32 against float64, which is a process of its own."""
    picture = tmp_path / "figure.png"
    printed = run(ROOT / "examples" / "make_stability_figure.py", "-o", picture)
    assert printed.rstrip().endswith(str(picture))
    check(picture)


@pytest.mark.examples
def test_errors_figure(run, tmp_path):
    """relMSE sees more of the dark parts than MSE."""
    picture = tmp_path / "errors.png"
    printed = run(ROOT / "examples" / "make_errors_figure.py", "-o", picture)
    dark = dict(re.findall(r"^(\w+): (\d+)%", printed, re.MULTILINE))
    assert 1.5 * int(dark["MSE"]) < int(dark["relMSE"])
    check(picture)


@pytest.mark.examples
def test_doctor_figure(run, tmp_path):
    """Nine faults beside the right images: those of two sides lose half of the light, mixed normals next to none."""
    picture = tmp_path / "doctor.png"
    printed = run(ROOT / "examples" / "make_doctor_figure.py", "-o", picture)
    change = dict(re.findall(r"^([a-z-]+), .* mean ([-+.0-9]+)%", printed, re.MULTILINE))
    assert len(change) == 9 and -60 < float(change["two-sided"]) < -40 and abs(float(change["normals"])) < 0.1
    check(picture)


# Options of scripts --------------------------------------------------------------------------------------------------


SCRIPT, KERNEL = "plot_any.py", "/lib/ipykernel_launcher.py"


@pytest.mark.parametrize(
    "quick, argv, size",
    [
        ("1", [SCRIPT], "quick"),
        ("0", [SCRIPT], "default"),
        ("1", [SCRIPT, "--full"], "full"),
        ("0", [KERNEL, "-f", "/run/kernel-1.json"], "default"),
    ],
)
def test_size(quick: str, argv: list[str], size: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """DMIS_QUICK is a default that the command line overrides; options of a kernel are its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DMIS_PBRT_SCENES", raising=False)
    monkeypatch.setenv("DMIS_QUICK", quick)
    monkeypatch.setattr("sys.argv", argv)
    opts, given = options("plot_any", "Title\n=====", seeds={"type": int, "default": 3})
    assert opts.size == size and opts.pick("quick", "default", "full") == size and given.seeds == 3
    assert opts.output == Path("figures/plot_any.png") and os.listdir("figures") == []
