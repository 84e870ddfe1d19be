"""The doctor: right tables pass, planted faults are found and named, bad tables are refused with the reason."""

import functools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.stats
from helpers import shared_scene

import dmis
from dmis.cli.commands import main
from dmis.doctor import means
from dmis.doctor.causes import FITTED
from dmis.doctor.diagnosis import Diagnosis
from dmis.doctor.evidence import gather, joint_test
from dmis.doctor.table import REQUIRED, read_table

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "examples" / "exporters")]
import dmis_table  # noqa: E402
import doctor_alarms  # noqa: E402
import doctor_faults  # noqa: E402


def synthetic(n: int = 20_000, seed: int = 0) -> dict:
    """Return a right table of n light samples and as many BRDF samples, whose directions are told by x.

    p_l = 8 (1/2 - x) from 0 to 1/2, p_b = 2 x from 0 to 1, f = 1 + x where a coin says that nothing is in between.
    """
    rng = np.random.default_rng(seed)
    x = np.concatenate([0.5 - 0.5 * np.sqrt(rng.random(n)), np.sqrt(rng.random(n))])
    p_l, p_b = np.maximum(8 * (0.5 - x), 0), 2 * x
    cos, tilt = 0.2 + 0.7 * x, 0.3 * rng.random(2 * n)
    flat = np.zeros_like(x)
    up = np.stack([flat, flat, flat + 1], axis=1)
    camera_sample = np.tile(np.arange(n), 2)
    return {
        "version": 1, "light_samples": 1, "brdf_samples": 1, "shape": (10, 10),
        "pixel": camera_sample % 100, "camera_sample": camera_sample // 100, "technique": np.repeat([0, 1], n),
        "f": np.where(rng.random(2 * n) < 0.7, 1 + x, 0)[:, None] * np.ones(3), "p_l": p_l, "p_b": p_b,
        "direction": np.stack([np.sqrt(1 - cos**2), flat, cos], axis=1), "normal": up,
        "geometric_normal": np.stack([np.sin(tilt), flat, np.cos(tilt)], axis=1), "light_normal": -up,
        "distance": 1 + rng.random(2 * n), "light": camera_sample % 3,
    }  # fmt: skip


def some(table: dict, rows: np.ndarray) -> dict:
    """Return some rows of a table, by a mask or by their numbers."""
    count = len(table["f"])
    return {name: value[rows] if np.shape(value)[:1] == (count,) else value for name, value in table.items()}


@functools.cache
def diagnosis(fault: str = "") -> Diagnosis:
    """Return the diagnosis of the synthetic table with a planted fault; without: of the right one."""
    right = synthetic()
    if fault == "lobe":
        right["lobe"] = 1 + right["camera_sample"] // 7 % 2
    return dmis.diagnose(doctor_faults.plant(fault, right))


def test_right_tables_pass():
    """Of 40 right tables at a level of 1 % at most 2 alarm."""
    assert sum(not dmis.diagnose(synthetic(4000, seed)).healthy for seed in range(40)) <= 2


def test_errors_of_tests_are_right():
    """Differences vary over seeds as their standard errors say, and their mean is 0."""
    z = np.array(
        [[t.z for t in means.tests(read_table(synthetic(3000, k))) if t.where == "all rows"] for k in range(60)]
    )
    assert z.shape == (60, 5)
    assert np.all((z.std(axis=0) > 0.75) & (z.std(axis=0) < 1.3)) and np.all(np.abs(z.mean(axis=0)) < 0.55)
    # Sums over 100 camera samples are skewed, by 0.46 in the test of ratios; their z are not (error 0.12)
    results = [means.tests(read_table(synthetic(100, k)))[1] for k in range(400)]
    assert {(test.name, test.where) for test in results} == {("ratios", "all rows")}
    assert scipy.stats.skew([test.difference / test.error for test in results]) > 0.25
    assert abs(scipy.stats.skew([test.z for test in results])) < 0.3


@pytest.mark.parametrize("kind", ["few BRDF rows", "few light rows"])
def test_rare_rows_make_no_alarm(kind):
    """At a level of 1 % more than 2 of 40 right tables alarm with a probability of 0.8 %."""
    assert sum(doctor_alarms.trial(kind, seed)[0] for seed in range(40)) <= 2


FACTORS = {"density": 0.93, "area": 1, "cosine": 1, "lights": 3, "twice": 2, "two-sided": 2, "normals": 1, "lobe": 2}
FACTORS |= {"light's cosine": 1, "divided": None, "missing": None, "exchanged": None}


@pytest.mark.parametrize("fault", FACTORS)
def test_faults_are_named(fault):
    """The likeliest cause, or one that gives the same table, is the fault; its interval has the factor."""
    causes = diagnosis(fault).causes
    assert not diagnosis(fault).healthy and causes[0].z > 5
    (cause,) = [c for c in causes if (c.column, c.rows, c.measure) == doctor_faults.NAMES[fault]]
    assert cause.share > 0.4 and cause.p > 1e-3
    if FACTORS[fault] is not None:
        assert cause.low * 0.99 < FACTORS[fault] < cause.high * 1.01 and cause.high / cause.low < 1.2
    assert cause.where == {"lobe": "lobe 2", "missing": "light 0"}.get(fault, "")
    assert doctor_faults.named(fault, causes)
    assert not doctor_faults.named("sine", causes)


def test_sky_without_sine_is_named():
    """On the scene tt, of 48x27 pixels."""
    table = dmis_table.table(shared_scene("tt", (48, 27)), 8)
    assert dmis.diagnose(table).healthy
    assert doctor_faults.named("sine", dmis.diagnose(doctor_faults.plant("sine", table)).causes)


def test_smallest_error_is_named():
    """A fault of twice the smallest error that a right table promises to name is named; a fifth of it is not found."""
    right, least = synthetic(), diagnosis().smallest["p_b of light"]
    factors = {k: np.where(right["technique"] == 0, 1 + k * least, 1) for k in (0.2, 2.0)}
    assert dmis.diagnose(right | {"p_b": right["p_b"] * factors[0.2]}).healthy
    causes = dmis.diagnose(right | {"p_b": right["p_b"] * factors[2.0]}).causes
    factors = [c.factor ** (1 if (c.column, c.rows) == ("p_b", "light") else -1) for c in causes]
    assert factors[0] == pytest.approx(1 + 2 * least, rel=least) and causes[0].z == pytest.approx(10, rel=0.4)
    # a sampler that loses half of the light samples is p_l times 2 and p_b times 1/2
    first, second = diagnosis("two-sided").causes[:2]
    assert {first.column, second.column} == {"p_l", "p_b"} and first.share == pytest.approx(second.share, abs=0.02)
    assert first.factor * second.factor == pytest.approx(1, abs=0.01)


def test_estimates_and_measures():
    """Four of five far light samples and near BRDF samples are lost, which only the measure cos/d^2 shows."""
    table = synthetic(4000)
    table["distance"] *= 1e4
    lost = ((table["distance"] > 1.5e4) == (table["technique"] == 0)) & (np.random.default_rng(9).random(8000) < 0.8)
    wrong = some(table, ~lost)
    assert joint_test(read_table(table)) > 1e-3 and joint_test(read_table(wrong)) < 1e-9
    # the fourth function is e / (e + c) of the estimate e = f / (a_l + a_b), c the geometric mean of e
    rows = gather(read_table(synthetic(4000)), FITTED, 0)
    terms = rows.terms()
    lit = np.isfinite(rows.logs["f"])
    e = np.exp(rows.logs["f"] - np.logaddexp(rows.logs["p_l"], rows.logs["p_b"]))[lit]
    assert (terms[3] / terms[0])[lit] == pytest.approx(e / (e + np.exp(np.log(e).mean())))
    # with one to four rows each, the joint test has the standard errors of the tests of means
    table = synthetic(4000)
    double = some(table, np.repeat(np.arange(8000), 1 + table["camera_sample"] % 2))
    rows = read_table(double | {"light_samples": 2, "brdf_samples": 2})
    m, covariance = gather(rows, FITTED, 0).moments()
    t = [test.difference / test.error for test in means.tests(rows)[:2]]
    assert (m / np.sqrt(np.diag(covariance)))[:2] == pytest.approx(t)


def test_few_samples_decide_nothing():
    """One sample as bright as all others together makes no alarm."""
    table = synthetic(4000)
    table["f"][10] = table["f"].sum()
    diagnosis = dmis.diagnose(table)
    assert diagnosis.healthy and not next(t for t in diagnosis.tests if t.name == "f").trusted
    # Blocks of pixels in which no BRDF sample could have been a light sample: there is nothing to compare
    scene = shared_scene("cornell", (24, 24))
    for seed in range(6):
        diagnosis = dmis.diagnose(dmis.samples(scene, spp=16, seed=seed))
        assert diagnosis.healthy
        assert not any(test.trusted for test in diagnosis.tests if abs(test.difference) > 1.99)


def test_order_of_rows_means_nothing():
    """Shuffled rows have the same tests; rows that one technique cannot draw are left out."""
    table = synthetic(4000)
    shuffled = some(table, np.random.default_rng(1).permutation(8000))
    a, b = (read_table(t) for t in (table, shuffled))
    assert len(a) == len(b) < 8000 and (a.a_l > 0).all() and (np.diff(b.sample) >= 0).all()
    for one, other in zip(means.tests(a), means.tests(b), strict=True):
        assert one.where == other.where and one.z == pytest.approx(other.z, abs=1e-6)
    # the four lights of the most rows differ between few rows and all; a fault is named all the same
    table = doctor_faults.plant("density", synthetic() | {"light": np.tile(np.arange(20_000) // 100 % 9, 2)})
    assert doctor_faults.named("density", dmis.diagnose(table).causes)


def test_faults_without_a_cause_are_told():
    """A cosine forgotten in one lobe is beyond the doctor, and so the verdict begins; the nearest factor is listed."""
    right = synthetic() | {"lobe": np.tile(np.arange(20_000) // 7 % 2, 2)}
    wrong = doctor_faults.plant("cosine", right)
    table = right | {"p_b": np.where(right["lobe"] == 1, wrong["p_b"], right["p_b"])}
    for diagnosis in (dmis.diagnose(table), dmis.diagnose(doctor_faults.plant("sampling", right))):
        assert diagnosis.text().startswith("verdict: no single factor explains it: ")
        assert diagnosis.causes[0].p < 1e-3 and "the nearest causes:" in diagnosis.text()


def test_factors_of_1_explain_nothing():
    """Light samples about the axis z with angles of a wrong density, which cells of directions alone show."""
    table = synthetic()
    angle = 2 * np.pi * np.random.default_rng(2).random(40_000) ** np.where(table["technique"] == 0, 1.3, 1)
    x, _, z = table["direction"].T
    turned = np.stack([x * np.cos(angle), x * np.sin(angle), z], axis=1)
    wrong = dmis.diagnose(table | {"direction": turned, "geometric_normal": table["normal"]})
    assert wrong.text().startswith("verdict: no single factor explains it: ") and not wrong.causes
    assert wrong.joint > 1e-3 and "  hint: drawn directions that do not follow their pdf" in wrong.text()


def test_zero_density_of_one_light_is_told():
    """BRDF rows of a lamp that is forgotten in their p_l: its samples are missing, and a note says why."""
    table = synthetic()
    table["p_l"][(table["technique"] == 1) & (table["light"] == 1)] = 0
    text = dmis.diagnose(table).text()
    assert "BRDF samples of light 1 are missing" in text and "or p_l in BRDF rows (p_b" in text
    assert "BRDF samples have f > 0 and p_l = 0" in text


def test_what_is_told():
    """A table of 20 light samples tells nothing, and says so; absent columns, too."""
    required = {name: column for name, column in synthetic(20).items() if name in REQUIRED}
    few = dmis.diagnose(required)
    assert few.healthy and few.text().startswith("verdict: too few rows to tell")
    assert "joint test in two halves: left out" in few.text() and "lobe (a fault of" in few.text()
    # a light sampler that leaves out a part of the lamp though its density there is positive
    right = synthetic(10_000)
    assert "never draws" not in diagnosis().text()
    lost = (right["technique"] == 0) & (right["direction"][:, 2] > 0.25) & (right["direction"][:, 2] < 0.5)
    wrong = dmis.diagnose(some(right, ~lost))
    (line,) = [line for line in wrong.text().splitlines() if "numbers  z +0.38" in line]
    assert not wrong.healthy and "light sampling never draws these" in line


def test_light_samples_are_thinned_with_their_number():
    """Few BRDF samples: some light samples are kept as if no more were drawn, and a right table stays right."""
    table = synthetic(20_000)
    kept = (table["technique"] == 0) | (table["camera_sample"] % 20 == 0)
    rows = read_table(some(table, kept) | {"brdf_samples": 0.05})
    evidence = gather(rows, FITTED, 0)
    kept = np.exp(evidence.logs["p_l"])[evidence.is_light].max() / rows.a_l[rows.is_light].max()
    assert kept < 0.5 and evidence.is_light.sum() == pytest.approx(kept * rows.is_light.sum(), rel=0.1)
    assert joint_test(rows) > 1e-3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"p_b": None}, "p_b are missing"),
        ({"version": 9}, "version must be a whole number from 1 to 1.*got 9"),
        ({"brdf_samples": 0}, "without one technique"),
        ({"p_l": np.ones(5)}, "p_l must.*shape \\(5,\\).*closed"),
        ({"light": np.full(8000, "lamp")}, "light must be whole numbers.*type <U4"),
        ({"pixel": np.full(8000, 100)}, "pixel must.*got 100 with shape"),
        ({"direction": np.full((8000, 3), np.nan)}, "direction must be unit vectors.*nan"),
        ({"technique": np.zeros(8000, int), "f": np.zeros((8000, 3))}, "both can draw"),
        ({"light_samples": 0.4, "camera_sample": np.zeros(8000, int)}, "light_samples is 0.4, but"),
        ({"f": np.nan}, "f must be finite numbers.*row 7$"),
        ({"f": -1}, "must not be negative; row 7"),
        ({"p_b": -1}, "p_b must be finite numbers.*from 0 to.*delta lights.*got -1.0 in row 7"),
        ({"p_l": 0}, "calls 0, with f > 0; row 7 "),
        ({"technique": 1, "p_b": 0}, "calls 0, with f > 0; row 7 "),
    ],
)
def test_bad_tables_are_refused(change, message):
    """The message says what is wrong and what is allowed, of single values with the number of the first bad row."""
    table = synthetic(4000)
    table["f"][7] = 1
    for name, value in change.items():
        if value is not None and np.ndim(value) < np.ndim(table[name]):
            table[name][7] = value
        else:
            table[name] = value
    table = {name: value for name, value in table.items() if value is not None}
    with pytest.raises(ValueError, match=message):
        dmis.diagnose(table)


def test_directions_of_one_technique_alone_are_no_evidence():
    """Rows in which the other density is 0 change nothing."""
    table = synthetic(4000)
    more = some(table, np.concatenate([np.arange(8000), np.arange(0, 8000, 10)]))
    of_light = more["technique"][8000:] == 0
    more["p_b"][8000:][of_light] = 0
    more["p_l"][8000:][~of_light] = 0
    expected, found = dmis.diagnose(table), dmis.diagnose(more)
    assert found.rows == expected.rows
    assert [test.z for test in found.tests] == [test.z for test in expected.tests]


@pytest.mark.parametrize("of", [0, 1, 2])
def test_occluded_rows_may_be_left_out(of):
    """Those of light samples, of BRDF samples, or of both: the rest is compared, and a fault is named all the same."""
    right = synthetic(10_000)
    for fault in (None, "density"):
        table = doctor_faults.plant(fault, right) if fault else right
        kept = (table["f"][:, 0] > 0) | (table["technique"] == 1 - of)
        diagnosis = dmis.diagnose(some(table, kept))
        assert diagnosis.healthy == (fault is None) and doctor_faults.named("density", diagnosis.causes) == bool(fault)
        assert any("f = 0 are left out" in note for note in diagnosis.notes) == (of < 2)


def test_large_tables_are_thinned(monkeypatch):
    """Parts are of every k-th camera sample, in two halves still; all rows are tested with all rows."""
    table = read_table(synthetic(20_000))
    few = table.thinned(len(table) // 4 + 1)
    assert 0.2 < len(few) / len(table) < 0.3 and set(np.unique(few.sample % 2)) == {0, 1}
    assert few.sample[-1] == table.sample[-1] // 4 and (np.diff(few.sample) >= 0).all()
    rows = {test.where: test.rows for test in means.tests(table)}
    monkeypatch.setattr(means, "MOST", len(table) // 4 + 1)
    of_few = {test.where: test.rows for test in means.tests(table)}
    assert rows["all rows"] == of_few["all rows"] == len(table)
    assert of_few["light 1"] == pytest.approx(rows["light 1"] / 4, rel=0.1)


def test_command(tmp_path, capsys):
    """Exit code 0, 1 or 2; the text has verdict, ignored columns, cause and hint, the page the same."""
    paths = {name: tmp_path / f"{name}.npz" for name in ("right", "wrong", "text")}
    table = synthetic(4000)
    np.savez(paths["right"], weight=np.zeros(8000), **table)
    np.savez(paths["wrong"], **doctor_faults.plant("area", table))
    paths["text"].write_text("pixel,f\n0,1\n")
    assert main(["doctor", str(paths["right"])]) == 0
    out = capsys.readouterr().out
    assert all(part in out for part in ("no fault was found", "own weights are not seen", "note: ignored: weight\n"))
    page = tmp_path / "report.html"
    assert main(["doctor", str(paths["wrong"]), "--report", str(page)]) == 1
    out = capsys.readouterr().out
    assert "p_l in rows of BRDF samples is" in out and "per area" in out
    assert "p_l in rows of BRDF samples is" in page.read_text() and page.read_text().count('class="bad"') > 5
    assert main(["doctor", str(paths["text"])]) == 2
    assert "File is not a zip file. A table is an .npz file" in capsys.readouterr().err
    assert main(["doctor", str(paths["right"]), "--report", "report.pdf"]) == 2


def test_works_without_embree(tmp_path):
    """The command does not import embreex."""
    np.savez(tmp_path / "table.npz", **synthetic(1000))
    code = "import sys; sys.modules['embreex'] = None; from dmis.cli.commands import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "doctor", str(tmp_path / "table.npz")]
    assert subprocess.run(command, cwd=ROOT, check=False, capture_output=True).returncode == 0
