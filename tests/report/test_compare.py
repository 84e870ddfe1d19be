"""``compare``: table, plot, references, and the parser of rules with options."""

import csv

import numpy as np
import pytest

import dmis
from dmis.cli.commands import main
from dmis.experiment.reference import load_reference
from dmis.experiment.table import COLUMNS
from dmis.fit.registry import RULES, Thesis
from dmis.report.compare import parse_rules

SIZE = ["--resolution", "24x18", "--reference-spp", "16"]


def test_parse_rules():
    """The name of a rule begins a new rule, everything else is an option; repeated rules are dropped. ``all`` stands
    for every rule with its defaults, except those that need a value or are for teaching.
    """
    assert parse_rules("balance,thesis") == ["balance", "thesis"]
    assert parse_rules("thesis:patch=8,filter=none,auto") == ["thesis:patch=8,filter=none", "auto"]
    assert parse_rules("fixed:0.25,fixed:0.75") == ["fixed:0.25", "fixed:0.75"]
    assert parse_rules("auto, thesis:8,sigma=2 ,auto") == ["auto", "thesis:8,sigma=2"]
    assert set(parse_rules("all")) == set(RULES) - {"fixed", "uniform"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "rule must be one of"),
        ("thesis:patch=8,filter=box", "filter must be"),
        ("thesis:patch=8,nope:patch=4,auto", "^rule must be one of .*thesis.*; got 'nope'"),
        ("fixed:light=0.5,brdf=0.5,nope", "^rule must be one of .*thesis.*; got 'nope'"),
    ],
)
def test_bad_rules(text, message):
    """A text with an unknown rule or option is refused; the error names a misspelt rule wherever it stands."""
    with pytest.raises(ValueError, match=message):
        parse_rules(text)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rules": "balance"}, r"rules must be a list, such as \[.balance.*; got 'balance'"),
        ({"rules": [Thesis(patch=8)]}, r"must be text.*; got Thesis\(patch=8.*dmis\.register_rule\(.mine., MyRule\)"),
        ({"spp": 16}, r"spp must be a list, such as \[16\]; got 16"),
        ({"spp": [0]}, r"spp must be a whole number of at least 1; got 0"),
        ({"seeds": 0}, r"seeds must be a whole number of at least 1, or a list of seeds; got 0"),
        ({"reference": "r"}, r"reference must be a dmis\.Reference of 32x24 .*dmis\.make_reference.*; got str"),
        ({"techniques": "light"}, r"techniques must be names such as \('light', 'brdf'\); got 'light'"),
    ],
)
def test_bad_arguments_of_compare_are_named(tmp_path, box, changes, message):
    """An argument of the wrong form is refused at the top, and nothing is written."""
    width, height = box.camera.resolution
    black = np.zeros((height, width, 3), np.float32)
    arguments = {"rules": ["balance"], "spp": [4], "seeds": [0], "reference": dmis.Reference(black, black, 1)}
    with pytest.raises(ValueError, match=message):
        dmis.compare(box, folder=tmp_path / "out", **{**arguments, **changes})
    assert not (tmp_path / "out").exists()


def test_compare(tmp_path, capsys):
    """The table has a row per rule, budget and seed; a rule whose pilot does not fit is left out."""
    out = tmp_path / "out"
    arguments = ["compare", "teapot-area-light", "--rules", "thesis,fixed:1", "--spp", "4,8", "--seeds", "2"]
    assert main([*arguments, *SIZE, "-o", str(out)]) == 0
    with open(out / "results.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    rules = {"4": ("pinned", "balance", "fixed:1"), "8": ("pinned", "balance", "fixed:1", "thesis")}
    expected = {(rule, n, seed) for seed in "01" for n in rules for rule in rules[n]}
    assert len(rows) == len(expected) and {(row["rule"], row["spp"], row["seed"]) for row in rows} == expected
    for row in rows:
        parts = sum(float(row[f"{stage}_seconds"]) for stage in ("pilot", "fit", "render"))
        assert float(row["seconds"]) == pytest.approx(parts, abs=2e-4)
    assert (out / "convergence.png").stat().st_size > 10_000
    printed = capsys.readouterr().out
    assert "| 8 | thesis |" in printed and "| 4 | thesis |" not in printed and "| 8 | pinned |" in printed
    assert "Reference of 2 x 16 samples per pixel: standard error" in printed


@pytest.mark.usefixtures("drawn")
def test_errors_of_a_crop(tmp_path, capsys):
    """A lamp in one pixel has nearly all of the MSE, and the table says so; those of a window are of its pixels."""
    scene = dmis.load_scene("teapot-area-light", resolution=(24, 18))
    reference = dmis.make_reference(scene, 16)
    bright = reference.first.copy()
    bright[2, 3] += 1e3
    dmis.write_exr(tmp_path / "bright.exr", {"first": bright, "second": bright})
    small = "compare teapot-area-light --resolution 24x18 --rules balance --spp 4,8 --seeds 1".split()
    small += ["--reference", str(tmp_path / "bright.exr")]
    assert main([*small, "-o", str(tmp_path / "all")]) == 0
    printed = capsys.readouterr().out
    assert "| spp | rule | relMSE | relMSE / balance | relMSE·CPU s / balance | MSE | MSE / balance |" in printed
    assert "100% of balance's MSE lies in 1 % of the pixels (first seed, 8 samples per pixel)" in printed
    assert main([*small, "--crop", "4,1,24,18", "-o", str(tmp_path / "part")]) == 0
    assert "100% of balance's MSE" not in capsys.readouterr().out
    image = dmis.read_exr(tmp_path / "part" / "images" / "balance-8spp.exr")[0]["RGB"]
    r = bright[1:18, 4:24].astype(float)
    expected = ((image - r) ** 2).mean(), ((image - r) ** 2 / (r**2 + 0.01)).mean()
    with open(tmp_path / "part" / "results.csv", encoding="utf-8") as file:
        row = next(row for row in csv.DictReader(file) if (row["rule"], row["spp"]) == ("balance", "8"))
    assert (float(row["mse"]), float(row["relmse"])) == pytest.approx(expected, rel=1e-4)
    assert main([*small, "-o", str(tmp_path / "part")]) == 2  # the rows there are of the window
    assert "resolution was [20, 17], now is [24, 18]" in capsys.readouterr().err
    smaller = ("0,0,8,8 --resolution 12x9", "of 12x9 pixels")  # its window is inside of the reference
    for crop, message in (("4,1,4,18", "0 <= x0 < x1 <= 24"), ("0,0,24,19", "got (0, 0, 24, 19)"), smaller):
        assert main([*small, "--crop", *crop.split(), "-o", str(tmp_path / "bad")]) == 2
        assert message in capsys.readouterr().err and not (tmp_path / "bad").exists()


@pytest.mark.usefixtures("drawn")
def test_given_reference(tmp_path):
    """The reference may be an EXR file of the caller; Python and the command line count seeds alike."""
    scene = dmis.load_scene("teapot-area-light", resolution=(24, 18))
    image = dmis.render(scene, "balance", 64, seed=9).image
    path = tmp_path / "reference.exr"
    dmis.write_image(path, image)
    small = ["--resolution", "24x18", "--rules", "balance", "--spp", "4", "--seeds", "2", "--quiet"]
    assert main(["compare", "teapot-area-light", *small, "--reference", str(path), "-o", str(tmp_path / "a")]) == 0
    reference = load_reference(path)
    assert (reference.first == reference.second).all()
    runs = dmis.compare(scene, ["balance"], [4], 2, reference, tmp_path / "b").runs["balance", 4]
    images = [dmis.render(scene, "balance", 4, seed=seed).image.astype(float) for seed in (0, 1)]
    expected = [((image - reference.first) ** 2).mean() for image in images]
    with open(tmp_path / "a" / "results.csv", encoding="utf-8") as file:
        rows = [float(row["mse"]) for row in csv.DictReader(file) if row["rule"] == "balance"]
    assert rows == pytest.approx(expected, rel=1e-4) and [run.mse for run in runs] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    "more, message",
    [
        (["--rules", "best"], "rule must be one of"),
        (["--reference", "nowhere.exr"], "nowhere.exr"),
        (["--reference", "small.exr"], "reference must be a dmis.Reference of 24x18 pixels"),
        (["--reference", "flat.exr"], "must hold an image of three channels"),
    ],
)
def test_bad_input(tmp_path, capsys, monkeypatch, more, message):
    """Bad input gives one line of error and exit code 2."""
    monkeypatch.chdir(tmp_path)
    dmis.write_exr("small.exr", {"RGB": np.zeros((2, 2, 3), np.float32)})
    dmis.write_exr("flat.exr", {"RGB": np.zeros((18, 24), np.float32)})
    assert main(["compare", "teapot-area-light", "--resolution", "24x18", *more, "-o", "out"]) == 2
    error = capsys.readouterr().err
    assert message in error and len(error.splitlines()) == 1


@pytest.mark.usefixtures("drawn")
def test_compare_scenes(tmp_path, capsys):
    """Several scenes have a folder each and one page; means over them; the same command renders nothing again."""
    out = tmp_path / "out"
    command = ["compare", "teapot-area-light", "cornell", "--rules", "fixed:1", "--spp", "4", "--seeds", "2", *SIZE]
    assert main([*command, "-o", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "| fixed:1 |" in printed.partition("| rule | teapot-area-light | cornell | all, relMSE·CPU s |")[2]
    rows = [(out / name / "results.csv").read_text() for name in ("teapot-area-light", "cornell")]
    assert all(len(of.splitlines()) == 7 for of in rows)
    page = (out / "report.html").read_text("utf-8")
    assert page.count("<section") == 2 and "all, relMSE·CPU s" in page
    assert main([*command, "-o", str(out), "--quiet"]) == 0 and not capsys.readouterr().out
    assert rows == [(out / name / "results.csv").read_text() for name in ("teapot-area-light", "cornell")]
    for words, message in (
        (["cornell", "cornell"], "scenes must have different names"),
        (["cornell", "tt", "--reference", "x.exr"], "--reference needs one scene; got 2"),
        (["cornell", "nope"], "a scene must be"),
    ):
        assert main(["compare", *words, "-o", str(tmp_path / "bad")]) == 2
        assert message in capsys.readouterr().err and not (tmp_path / "bad" / "cornell").exists()


def test_compare_needs_a_scene_only(tmp_path, monkeypatch, box):
    """Without more arguments it is the command with its defaults, in a folder of the scene's name."""
    asked = {}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DMIS_CACHE", str(tmp_path))

    def no_measure(scene, budgets, seeds, reference, **_):
        asked.update(budgets=budgets, seeds=seeds, reference=reference)
        raise KeyboardInterrupt

    monkeypatch.setattr("dmis.report.compare.measure", no_measure)
    monkeypatch.setattr("dmis.report.compare.make_reference", lambda *a, **_: dmis.make_reference(a[0], 4))
    with pytest.raises(KeyboardInterrupt):
        dmis.compare(box)
    assert asked["budgets"] == [("pinned", 128), ("balance", 128), ("thesis", 128), ("auto", 128)]
    assert asked["seeds"] == [0, 1, 2, 3, 4] and asked["reference"].spp == 4
    assert (tmp_path / box.name / "comparison.json").is_file()
