"""What a comparison keeps: nothing is rendered twice, nothing of another kind is added to, nothing torn is believed."""

import csv
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import dmis
import dmis.experiment.runs
from dmis.experiment.runs import PINNED
from dmis.experiment.table import COLUMNS, Results, conditions
from dmis.fit.fixed import Fixed
from dmis.fit.registry import RULES as RULES_BY_NAME
from dmis.report.compare import compare

RULES, SPP = ["balance", "thesis:patch=4"], [4, 8]


@pytest.fixture(scope="module")
def reference(box: dmis.Scene, tmp_path_factory: pytest.TempPathFactory) -> dmis.Reference:
    return dmis.make_reference(box, 16, folder=tmp_path_factory.mktemp("references"))


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch, drawn: list[Path]) -> list[tuple[str, int, int]]:
    """What is rendered from here on."""
    seen = []
    original = dmis.render

    def counted(scene, rule, spp, *, seed, **options):
        seen.append((PINNED if options["settings"].preset else rule, spp, seed))
        return original(scene, rule, spp, seed=seed, **options)

    monkeypatch.setattr("dmis.experiment.runs.render_alone", counted)
    return seen


def rows(folder: Path) -> list[dict[str, str]]:
    with open(folder / "results.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def errors(folder: Path) -> dict[tuple[str, str, str], str]:
    return {(row["rule"], row["spp"], row["seed"]): row["mse"] for row in rows(folder)}


def test_interrupted_comparison_goes_on(box, reference, tmp_path, rendered, drawn):
    """After an interruption what is missing is rendered, and the table is that of an undisturbed run."""
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    first = compare(box, RULES, SPP, [0, 1], reference, whole, parallel=1)
    assert len(rendered) == len(rows(whole)) == 10

    def stop(rule: str, done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    rendered.clear()
    with pytest.raises(KeyboardInterrupt):
        compare(box, RULES, SPP, [0, 1], reference, broken, parallel=1, progress=stop)
    assert len(rows(broken)) == 3 and drawn == [whole]
    again = compare(box, RULES, SPP, [0, 1], reference, broken, parallel=1)
    assert len(rendered) == len(set(rendered)) == 10
    assert errors(broken) == errors(whole) and list(again.runs) == list(first.runs)
    assert set(again.pictures) == set(again.runs)
    rendered.clear()
    compare(box, RULES, SPP, [0, 1], reference, broken, parallel=1)
    assert rendered == []


def test_more_seeds_rules_and_budgets(box, reference, tmp_path, rendered):
    """They are added; what was measured before and is not asked for now stays in the table, and out of the report."""
    compare(box, RULES, [8], [0], reference, tmp_path, parallel=1)
    rendered.clear()
    more = compare(box, ["pbrt"], [8, 16], [0, 1], reference, tmp_path, parallel=1)
    expected = {(rule, n, seed) for rule in ("balance", "pbrt", PINNED) for n in (8, 16) for seed in (0, 1)}
    assert set(rendered) == expected - {("balance", 8, 0), (PINNED, 8, 0)}
    assert list(more.runs) == [(rule, n) for n in (8, 16) for rule in ("balance", "pbrt", PINNED)]
    assert len(rows(tmp_path)) == len(expected) + 1
    assert all(len(of) == 2 for of in more.runs.values())


def test_a_torn_row_is_rendered_again(box, reference, tmp_path, rendered):
    """What was cut in the middle of a line is no result, even where what is left of it looks like one."""
    compare(box, RULES, [8], [0], reference, tmp_path, parallel=1)
    before = errors(tmp_path)
    text = (tmp_path / "results.csv").read_bytes()
    (tmp_path / "results.csv").write_bytes(text[:-4])
    rendered.clear()
    compare(box, RULES, [8], [0], reference, tmp_path, parallel=1)
    assert rendered == [("thesis:patch=4", 8, 0)] and errors(tmp_path) == before


def test_two_comparisons_in_one_folder(box, reference, tmp_path, drawn):
    """Rows that both have written are merged; a row that the other one has lost, by an older table, is not missed."""
    arguments = box, ["balance"], [4], [0], reference, tmp_path

    def other(rule: str, done: int, total: int) -> None:
        if done == 1:
            compare(*arguments, parallel=1)

    compare(*arguments, parallel=1, progress=other)
    assert len(rows(tmp_path)) == len(errors(tmp_path)) == len(drawn) == 2
    (tmp_path / "results.csv").unlink()
    runs = compare(*arguments, parallel=1, progress=lambda *_: (tmp_path / "results.csv").write_bytes(b"")).runs
    assert [len(by_seed) for by_seed in runs.values()] == [1, 1]


def test_written_is_what_is_read(box, reference, tmp_path):
    """Rows come back as they were written, to the digits that are written."""
    about = conditions(box, reference, 1)
    run = dmis.experiment.runs.Run(PINNED, 8, 3, 1234, 0.0, 0.0, 1.25, 3.25e-4, 1e-6, 2e-3, 2.5, -1.25)
    results = Results(tmp_path, about)
    results.append(run)
    assert Results(tmp_path, about).runs == [run]
    assert rows(tmp_path)[0]["mse_over_balance"] == "1.00000" and tuple(rows(tmp_path)[0]) == COLUMNS


def test_rows_are_relative_to_both_baselines(box, tmp_path, rendered):
    """`mse_over_balance` is over the balance heuristic with the sampler of the row, `mse_over_pinned` over the preset
    thesis with two shading samples; an old table keeps its columns in front.
    """
    options = {"sampler": "sobol", "shading_samples": 4, "integrator": "path", "max_depth": 2}
    reference = dmis.make_reference(box, 64, folder=tmp_path, integrator="path", max_depth=2)
    compare(box, ["fixed:1"], [8], [3], reference, tmp_path, parallel=1, **options)
    assert COLUMNS[15] == "mse_over_pinned" and COLUMNS[11] == "mse_over_balance"
    assert rendered[:2] == [(PINNED, 8, 3), ("balance", 8, 3)]
    by_rule = {row["rule"]: row for row in rows(tmp_path)}
    image = dmis.render(box, "balance", 8, seed=3, preset="thesis", integrator="path", max_depth=2).image
    expected = dmis.mse(image, reference.first, reference.second)
    assert float(by_rule[PINNED]["mse"]) == pytest.approx(expected, rel=1e-5)
    assert (by_rule[PINNED]["mse_over_pinned"], by_rule[PINNED]["mse_over_balance"]) == ("1.0000", "1.00000")
    for rule in ("balance", "fixed:1"):
        row = {name: float(by_rule[rule][name]) for name in ("mse", "mse_over_balance", "mse_over_pinned")}
        assert row["mse_over_balance"] == pytest.approx(row["mse"] / float(by_rule["balance"]["mse"]), abs=1e-5)
        assert row["mse_over_pinned"] == pytest.approx(row["mse"] / expected, rel=1e-4)
        for base in ("balance", PINNED):
            ratio = float(by_rule[rule]["relmse"]) / float(by_rule[base]["relmse"])
            assert float(by_rule[rule][f"relmse_over_{base}"]) == pytest.approx(ratio, rel=1e-4)
    assert float(by_rule["balance"]["mse_over_pinned"]) < 0.9


def test_no_rule_of_ones_own_is_called_pinned():
    """The name is that of the baseline."""
    with pytest.raises(ValueError, match="name of a rule must not be pinned, because compare has it"):
        dmis.register_rule("pinned", Fixed)


@pytest.mark.parametrize("change", ["resolution", "reference", "parallel", "camera", "settings"])
def test_other_conditions_are_refused(box, reference, tmp_path, change):
    """With the name of what differs; the table is left as it is."""
    about = conditions(box, reference, 1)
    Results(tmp_path, about).append(dmis.experiment.runs.Run(PINNED, 8, 0, 1, 0.0, 0.0, 1.0, 1.0, 0.1, 1.0, 1.0))
    before = (tmp_path / "results.csv").read_bytes()
    other = dmis.Reference(reference.first, reference.first, 16)
    found, told = {
        "resolution": ({**about, "resolution": [9, 9]}, "resolution was [32, 24], now is [9, 9]"),
        "reference": (conditions(box, other, 1), "reference was"),
        "parallel": (conditions(box, reference, 2), "parallel was 1 thread, now is 2 threads"),
        "camera": (conditions(_moved(box), reference, 1), "scene_hash was"),
        "settings": (
            conditions(box, reference, 1, dmis.Settings(sampler="stratified")),
            "sampler was sobol, now is stratified",
        ),
    }[change]
    with pytest.raises(ValueError, match="measured under other conditions") as error:
        Results(tmp_path, found)
    assert told in str(error.value) and "choose another directory" in str(error.value)
    assert (tmp_path / "results.csv").read_bytes() == before


@pytest.mark.usefixtures("drawn")
def test_another_rule_of_the_same_name_is_refused(box, reference, tmp_path, monkeypatch):
    """A rule of one's own that was changed since; others may be added."""
    monkeypatch.setitem(RULES_BY_NAME, "mine", lambda: Fixed(0.5))
    compare(box, ["mine"], [8], [0], reference, tmp_path, parallel=1)
    compare(box, ["mine", "thesis:patch=4"], [8], [0], reference, tmp_path, parallel=1)
    monkeypatch.setitem(RULES_BY_NAME, "mine", lambda: Fixed(0.25))
    with pytest.raises(ValueError, match="was measured with another rule mine: its options or its class changed"):
        compare(box, ["mine"], [8], [0], reference, tmp_path, parallel=1)
    compare(box, ["balance"], [8], [0], reference, str(tmp_path), parallel=1)
    with pytest.raises(ValueError, match="another rule mine"):
        compare(box, ["mine"], [8], [0], reference, tmp_path, parallel=1)


def _moved(scene: dmis.Scene) -> dmis.Scene:
    camera = dmis.Camera.look_at((0, -7, 2), (0, 0, -0.2), fov=40, resolution=(32, 24))
    return dmis.Scene(camera, scene.parts, scene.lights, scene.name)


@pytest.mark.parametrize(
    "data, message",
    [
        (b"scene,rule\nbox,balance\n", "line 1 (its columns must be scene,rule,spp"),
        (f"{','.join(COLUMNS)}\nbox,balance,8\n".encode(), "line 2 (3 values for 18 columns)"),
        (f"{','.join(COLUMNS)}\n{','.join('x' * 18)}\n".encode(), "line 2 (invalid literal"),
        (b"junk", "line 1 (its columns must be"),
        (b"\xff\xfe\x00junk\n\n", "line 1 ("),
    ],
)
def test_tables_of_another_kind_are_refused(box, reference, tmp_path, data, message):
    """File, line, reason and fix; the file is left as it is."""
    about, path = conditions(box, reference, 1), tmp_path / "results.csv"
    Results(tmp_path, about)
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"; remove it, or choose another directory$") as error:
        Results(tmp_path, about)
    assert f"{path} cannot be read in {message}" in str(error.value) and path.read_bytes() == data


@pytest.mark.parametrize(
    "column, value",
    [("mse", "nan"), ("mse", "1e999"), ("mse", "-1"), ("relmse", "-1"), ("relmse", "nan"), ("render_seconds", "-1")]
    + [("cpu_seconds", "inf"), ("mean_z", "-inf"), ("mse_error", "-1e-9"), ("rays", "-1")],
)
def test_rows_with_impossible_numbers_are_refused(box, reference, tmp_path, rendered, column, value):
    """By line and column. An error may be below 0, as there are two halves, but not below that of their mean."""
    compare(box, ["balance"], [8], [0], reference, tmp_path, parallel=1)
    path, (pinned, row) = tmp_path / "results.csv", rows(tmp_path)
    for cells, expected in (
        ({column: value}, pytest.raises(ValueError, match=rf"in line 3 \({column} must be finite and at least")),
        ({column: "0", "mse": dmis.mse(reference.mean, reference)}, pytest.warns(match="its mean squared error is")),
    ):
        lines = (COLUMNS, pinned.values(), {**row, **cells}.values())
        path.write_text("".join(f"{','.join(map(str, line))}\n" for line in lines))
        with expected:
            compare(box, ["balance"], [8], [0], reference, tmp_path, parallel=1)


@pytest.mark.parametrize("text", [None, "no json", "[1]"])
def test_a_table_without_its_conditions_is_refused(box, reference, tmp_path, text):
    """Its rows may be of another scene."""
    about = conditions(box, reference, 1)
    Results(tmp_path, about)
    (tmp_path / "comparison.json").unlink()
    if text is not None:
        (tmp_path / "comparison.json").write_text(text)
    with pytest.raises(ValueError, match=r"has no readable comparison\.json"):
        Results(tmp_path, about)


def test_pictures_have_names_of_their_own(box, reference, tmp_path):
    """Rules whose names differ in what a file's name cannot have, or are very long, do not share a picture."""
    results = Results(tmp_path, conditions(box, reference, 1))
    rules = ["second-moment:guard=1e+3", "second-moment:guard=1e-3", "thesis", "x" * 300 + "1", "x" * 300 + "2"]
    names = [results.image((rule, 16)).name for rule in rules]
    assert len(set(names)) == len(rules) and max(map(len, names)) < 160
    assert names[2] == "thesis-16spp.exr" and names[1] == "second-moment-guard=1e-3-16spp.exr"


def test_missing_damaged_and_foreign_images_are_rendered_again(box, reference, tmp_path, rendered, recwarn):
    """With a warning, and without a new row; the bits are those of before."""
    compare(box, RULES, [8], [0], reference, tmp_path, parallel=1)
    folder, table = tmp_path / "images", (tmp_path / "results.csv").read_bytes()
    first, second, pinned = (folder / f"{name}-8spp.exr" for name in ("balance", "thesis-patch=4", "pinned"))
    before = {path: dmis.read_exr(path) for path in (first, second, pinned)}
    cut = pinned.read_bytes()[:-100]
    for damage, path, rule in (
        (pinned.unlink, pinned, PINNED),
        (lambda: pinned.write_bytes(cut), pinned, PINNED),
        (lambda: second.write_bytes(first.read_bytes()), second, "thesis:patch=4"),
        (lambda: dmis.write_exr(first, {"RGB": before[first][0]["RGB"]}), first, "balance"),
        (lambda: dmis.write_image(first, dmis.render(box, "balance", 8, sampler="independent")), first, "balance"),
        (lambda: dmis.write_image(first, np.ones((3, 4, 3))), first, "balance"),
    ):
        damage()
        rendered.clear()
        with pytest.warns(UserWarning, match=rf"{re.escape(str(path))} is rendered again: ."):
            again = compare(box, RULES, [8], [0], reference, tmp_path, parallel=1)
        assert rendered == [(rule, 8, 0)] and (tmp_path / "results.csv").read_bytes() == table
        for name, layer in dmis.read_exr(path)[0].items():
            np.testing.assert_array_equal(layer, before[path][0][name])
            np.testing.assert_array_equal(layer, again.pictures[rule, 8][name])
    rendered.clear()
    recwarn.clear()
    compare(box, RULES, [8], [0], reference, tmp_path, parallel=1)
    assert rendered == [] and not len(recwarn)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device that is always full")
@pytest.mark.usefixtures("without_plots")
@pytest.mark.parametrize("name", ["results.csv", "comparison.json", "report.html"])
def test_a_full_disk_names_the_file(box, reference, tmp_path, name):
    """Whichever file of the folder it is that does not fit."""
    run = dmis.experiment.runs.Run(PINNED, 8, 0, 1, 0.0, 0.0, 1.0, 1.0, 0.1, 1.0, 1.0)
    write = partial(compare, box, ["balance"], [8], [0], reference, tmp_path, parallel=1)
    if name == "results.csv":
        write = partial(Results(tmp_path, conditions(box, reference, 1)).append, run)
        (tmp_path / name).unlink()
    (tmp_path / name).symlink_to("/dev/full")
    with pytest.raises(OSError, match=rf"cannot write {tmp_path / name}: No space left on device"):
        write()
