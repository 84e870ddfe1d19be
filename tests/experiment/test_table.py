"""What a comparison keeps: nothing is rendered twice, nothing of another kind is added to, nothing torn is believed."""

import csv
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

import dmis
from dmis.experiment.runs import PINNED, Run
from dmis.experiment.table import COLUMNS, Results, conditions, image_path
from dmis.fit.fixed import Fixed
from dmis.fit.registry import RULES as RULES_BY_NAME
from dmis.report.compare import compare

RULES, SPP = ["balance", "thesis:patch=4"], [4, 8]
RUN = Run(PINNED, 8, 3, 1234, 0.0, 0.0, 1.25, 3.25e-4, 1e-6, 2e-3, 2.5, -1.25)


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


@pytest.fixture
def write(box, reference, tmp_path, rendered):
    """Compare rules in a folder, and return what this has rendered."""

    def comparison(rules=RULES, spp=(8,), seeds=(0,), folder=tmp_path, **options):
        rendered.clear()
        comparison.result = compare(box, rules, spp, seeds, reference, folder, parallel=1, **options)
        return list(rendered)

    return comparison


def rows(folder: Path) -> list[dict[str, str]]:
    with open(folder / "results.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def errors(folder: Path) -> dict[tuple[str, str, str], str]:
    return {(row["rule"], row["spp"], row["seed"]): row["mse"] for row in rows(folder)}


def test_interrupted_comparison_goes_on(tmp_path, write, rendered, drawn):
    """After an interruption what is missing is rendered, and the table is that of an undisturbed run."""
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    write(spp=SPP, seeds=[0, 1], folder=whole)
    first = write.result
    assert len(rendered) == len(rows(whole)) == 10

    def stop(rule: str, done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(spp=SPP, seeds=[0, 1], folder=broken, progress=stop)
    assert len(rows(broken)) == len(rendered) == 3 and drawn == [whole]
    assert len(write(spp=SPP, seeds=[0, 1], folder=broken)) == 7
    assert errors(broken) == errors(whole) and list(write.result.runs) == list(first.runs)
    assert set(write.result.pictures) == set(write.result.runs)
    assert write(spp=SPP, seeds=[0, 1], folder=broken) == []


def test_more_seeds_rules_and_budgets(tmp_path, write):
    """They are added; what was measured before and is not asked for now stays in the table, and out of the report."""
    write()
    more = write(["pbrt"], [8, 16], [0, 1])
    expected = {(rule, n, seed) for rule in ("balance", "pbrt", PINNED) for n in (8, 16) for seed in (0, 1)}
    assert set(more) == expected - {("balance", 8, 0), (PINNED, 8, 0)}
    assert list(write.result.runs) == [(rule, n) for n in (8, 16) for rule in ("balance", "pbrt", PINNED)]
    assert len(rows(tmp_path)) == len(expected) + 1
    assert all(len(of) == 2 for of in write.result.runs.values())


def test_a_torn_row_is_rendered_again(tmp_path, write):
    """What was cut in the middle of a line is no result, even where what is left of it looks like one."""
    write()
    before = errors(tmp_path)
    (tmp_path / "results.csv").write_bytes((tmp_path / "results.csv").read_bytes()[:-4])
    assert write() == [("thesis:patch=4", 8, 0)] and errors(tmp_path) == before


def test_two_comparisons_in_one_folder(tmp_path, write):
    """Of rows that both have written one counts; a table that is removed meanwhile is not missed."""
    write(["balance"], [4], progress=lambda _, done, __: done == 1 and write(["balance"], [4]))
    assert len(rows(tmp_path)) == 3 and write(["balance"], [4]) == []
    (tmp_path / "results.csv").unlink()
    write(["balance"], [4], progress=lambda *_: (tmp_path / "results.csv").write_bytes(b""))
    assert [len(by_seed) for by_seed in write.result.runs.values()] == [1, 1]


def test_written_is_what_is_read(box, reference, tmp_path):
    """Rows come back as they were written, to six digits, and old tables keep their columns in front."""
    about = conditions(box, reference, 1)
    results = Results(tmp_path, about)
    results.append(replace(RUN, mse=0.1234567))
    assert Results(tmp_path, about).runs == results.runs == {(PINNED, 8, 3): replace(RUN, mse=0.123457)}
    assert rows(tmp_path)[0]["mse_over_balance"] == "1" and tuple(rows(tmp_path)[0]) == COLUMNS
    assert COLUMNS[15] == "mse_over_pinned" and COLUMNS[11] == "mse_over_balance"
    # the name is that of the baseline
    with pytest.raises(ValueError, match="name of a rule must not be pinned, because compare has it"):
        dmis.register_rule("pinned", Fixed)
    # Rules whose names differ in what a file's name cannot have, or are very long, do not share a picture
    rules = ["second-moment:guard=1e+3", "second-moment:guard=1e-3", "thesis", "x" * 300 + "1", "x" * 300 + "2"]
    names = [image_path(tmp_path, (rule, 16)).name for rule in rules]
    assert len(set(names)) == len(rules) and max(map(len, names)) < 160
    assert names[2] == "thesis-16spp.exr" and names[1] == "second-moment-guard=1e-3-16spp.exr"


def test_rows_are_relative_to_both_baselines(box, tmp_path, rendered):
    """`mse_over_balance` is over the balance heuristic with the sampler of the row, `mse_over_pinned` over the preset
    thesis with two shading samples.
    """
    options = {"sampler": "sobol", "shading_samples": 4, "integrator": "path", "max_depth": 2}
    reference = dmis.make_reference(box, 64, folder=tmp_path, integrator="path", max_depth=2)
    compare(box, ["fixed:1"], [8], [3], reference, tmp_path, parallel=1, **options)
    assert rendered[:2] == [(PINNED, 8, 3), ("balance", 8, 3)]
    by_rule = {row["rule"]: row for row in rows(tmp_path)}
    image = dmis.render(box, "balance", 8, seed=3, preset="thesis", integrator="path", max_depth=2).image
    assert float(by_rule[PINNED]["mse"]) == pytest.approx(dmis.mse(image, reference), rel=1e-5)
    assert (by_rule[PINNED]["mse_over_pinned"], by_rule[PINNED]["mse_over_balance"]) == ("1", "1")
    for rule in ("balance", "fixed:1"):
        for base in ("balance", PINNED):
            for measure in ("mse", "relmse"):
                ratio = float(by_rule[rule][measure]) / float(by_rule[base][measure])
                assert float(by_rule[rule][f"{measure}_over_{base}"]) == pytest.approx(ratio, rel=1e-4)
    assert float(by_rule["balance"]["mse_over_pinned"]) < 0.9


def test_other_conditions_are_refused(box, reference, tmp_path):
    """With the name of what differs; the table is left as it is."""
    about = conditions(box, reference, 1)
    Results(tmp_path, about).append(RUN)
    before = (tmp_path / "results.csv").read_bytes()
    camera = dmis.Camera.look_at((0, -7, 2), (0, 0, -0.2), fov=40, resolution=(32, 24))
    for found, told in (
        (conditions(box, replace(reference, second=reference.first), 1), "reference was"),
        (conditions(box, reference, 2), "parallel was 1 thread, now is 2 threads"),
        (conditions(replace(box, camera=camera), reference, 1), "scene_hash was"),
        (conditions(box, reference, 1, dmis.Settings(sampler="stratified")), "sampler was sobol, now is stratified"),
    ):
        with pytest.raises(ValueError, match=f"measured under other conditions: .*{told}.*; .* choose another"):
            Results(tmp_path, found)
        assert (tmp_path / "results.csv").read_bytes() == before


def test_another_rule_of_the_same_name_is_refused(write, monkeypatch):
    """A rule of one's own that was changed since; others may be added."""
    monkeypatch.setitem(RULES_BY_NAME, "mine", lambda: Fixed(0.5))
    write(["mine"])
    write(["mine", "thesis:patch=4"])
    monkeypatch.setitem(RULES_BY_NAME, "mine", lambda: Fixed(0.25))
    with pytest.raises(ValueError, match="was measured under other conditions: rule mine was"):
        write(["mine"])
    write(["balance"])
    with pytest.raises(ValueError, match="rule mine was"):
        write(["mine"])


@pytest.mark.parametrize(
    "name, data, message",
    [
        ("results.csv", f"{','.join(COLUMNS)}\nbox,balance,8\n", "cannot be read in line 2 ("),
        ("results.csv", f"{','.join(COLUMNS)}\n{','.join('x' * 18)}\n", "cannot be read in line 2 (invalid literal"),
        ("comparison.json", "[1]", "has no readable comparison.json"),
        ("comparison.json", None, "has no readable comparison.json"),
    ],
)
def test_damaged_tables_are_refused(box, reference, tmp_path, name, data, message):
    """File, line, reason and fix; the file is left as it is."""
    about, path = conditions(box, reference, 1), tmp_path / name
    Results(tmp_path, about)
    path.unlink()
    if data is not None:
        path.write_text(data)
    with pytest.raises(ValueError, match=r"; remove it, or choose another directory$") as error:
        Results(tmp_path, about)
    assert f"{tmp_path / 'results.csv'} {message}" in str(error.value)
    assert data is None or path.read_text() == data


def test_missing_images_are_rendered_again(tmp_path, write):
    """With the rows of their rule and budget; a damaged image is named. A new table has new images."""
    write(seeds=[0, 1])
    path, before = tmp_path / "images" / "balance-8spp.exr", errors(tmp_path)
    image = path.read_bytes()
    path.unlink()
    assert write(seeds=[0, 1]) == [("balance", 8, 0), ("balance", 8, 1)] and errors(tmp_path) == before
    path.write_bytes(image[:-100])
    with pytest.raises(
        ValueError, match=r"balance-8spp\.exr must be an image .*; remove it, and the command 'compare'"
    ):
        write(seeds=[0, 1])
    (tmp_path / "results.csv").unlink()
    write(sampler="independent")
    assert dmis.mse(write.result.pictures["balance", 8]["RGB"], write.result.reference) == pytest.approx(
        write.result.runs["balance", 8][0].mse, rel=1e-5
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device that is always full")
@pytest.mark.usefixtures("without_plots")
@pytest.mark.parametrize("name", ["results.csv", "comparison.json", "report.html"])
def test_a_full_disk_names_the_file(box, reference, tmp_path, name):
    """Whichever file of the folder it is that does not fit."""
    write = partial(compare, box, ["balance"], [8], [0], reference, tmp_path, parallel=1)
    if name == "results.csv":
        write = partial(Results(tmp_path, conditions(box, reference, 1)).append, RUN)
        (tmp_path / name).unlink()
    (tmp_path / name).symlink_to("/dev/full")
    with pytest.raises(OSError, match=rf"cannot write {tmp_path / name}: No space left on device"):
        write()
