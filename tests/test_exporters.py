"""Exporters of the doctor's table: what each writes is read, right, and wrong with a fault planted."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers import shared_scene

import dmis
from dmis.doctor.table import LABELS, read_table

pytestmark = pytest.mark.examples
ROOT = Path(__file__).parents[1]
EXPORTERS = ROOT / "examples" / "exporters"
sys.path[:0] = [str(ROOT / "benchmarks"), str(EXPORTERS)]
import dmis_table  # noqa: E402
import doctor_faults  # noqa: E402


def test_table_of_dmis():
    """It has the rows of `dmis.samples`, and geometry: normals face the viewer, p_l is that of the lamp's area."""
    scene = shared_scene("teapot-area-light", (24, 18))
    table, samples = dmis_table.table(scene, 4), dmis.samples(scene, spp=4, sampler="independent", compensation=0)
    drawn = samples.rows(samples.technique >= 0)
    assert len(table["f"]) == len(drawn.f) and table["f"].sum() == pytest.approx(drawn.f.sum(), rel=1e-4)
    assert {*LABELS[:2], "direction", "normal", "geometric_normal", "distance", "light_normal"} <= set(table)
    cos = np.abs((table["light_normal"] * table["direction"]).sum(axis=1))
    area = table["distance"] ** 2 / (cos * table["p_l"])
    assert np.ptp(area) < 0.01 * area.mean()
    assert np.allclose(np.linalg.norm(table["normal"], axis=1), 1, atol=1e-4)


def test_table_of_cpp(tmp_path):
    """The header is C++11 without warnings; its table is right, and has what was added."""
    compiler = shutil.which("c++") or pytest.skip("needs a C++ compiler")
    demo, file = tmp_path / "demo", tmp_path / "table.npz"
    options = ["-std=c++11", "-O2", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *options, str(EXPORTERS / "demo.cpp"), "-o", str(demo)], check=True)
    subprocess.run([str(demo), str(file)], check=True)
    with np.load(file) as table:
        assert table["f"].shape == table["direction"].shape == (40_000, 3) and int(table["rows"]) == 40_000
        assert np.array_equal(table["camera_sample"][-2:], [199, 199]) and np.array_equal(
            table["technique"][:2], [0, 1]
        )
        assert np.allclose(table["p_l"] + table["p_b"], 2)
        assert np.allclose(table["direction"][:, 2] * 2, table["p_b"])
        wrong = doctor_faults.plant("cosine", dict(table))
    assert dmis.diagnose(file).healthy
    assert doctor_faults.named("cosine", dmis.diagnose(wrong).causes)


def test_table_of_mitsuba():
    """The box of Mitsuba is right; with a density per area, and with a cosine forgotten, it is not."""
    mi = pytest.importorskip("mitsuba")
    import mitsuba_table

    box = mi.cornell_box()
    box["sensor"]["film"] |= {"width": 24, "height": 24}
    table = mitsuba_table.table(mi.load_dict(box), 32)
    assert dmis.diagnose(table).healthy
    for fault in ("area", "cosine"):
        assert doctor_faults.named(fault, dmis.diagnose(doctor_faults.plant(fault, table)).causes)
    assert len(read_table(table)) > 1000
