"""Spectra to RGB: the numbers that pbrt-v2 prints, and what the formulas say."""

import numpy as np
import pytest

from dmis.base.color import blackbody_to_rgb, read_spd, spectrum_to_rgb, xyz_to_rgb


def test_constant_spectra():
    assert spectrum_to_rgb([500], [1]) == pytest.approx((1.20489, 0.94823, 0.90927), abs=1e-5)
    assert spectrum_to_rgb([400, 700], [2, 2]) == pytest.approx(2 * np.array(spectrum_to_rgb([500], [1])))
    to_rgb = np.array([xyz_to_rgb(e) for e in np.eye(3)]).T
    assert np.linalg.solve(to_rgb, spectrum_to_rgb([500], [1])) == pytest.approx([1, 1, 1], rel=1e-3)
    # order of wavelengths does not matter
    assert spectrum_to_rgb([600, 400, 500], [3, 1, 2]) == spectrum_to_rgb([400, 500, 600], [1, 2, 3])


@pytest.mark.parametrize("name, rgb", [("eta", (0.143124, 0.3749396, 1.442507)), ("k", (3.983175, 2.385725, 1.603214))])
def test_gold(pbrt_scenes, name, rgb):
    assert spectrum_to_rgb(*read_spd(pbrt_scenes / f"spds/metals/Au.{name}.spd")) == pytest.approx(rgb, abs=1e-5)


def test_blackbody():
    red, _, blue = blackbody_to_rgb(2000)
    assert red > 5 * blue
    red, _, blue = blackbody_to_rgb(20000)
    assert blue > red
    assert blackbody_to_rgb(0) == (0, 0, 0)
    assert blackbody_to_rgb(5000, 3) == pytest.approx(3 * np.array(blackbody_to_rgb(5000)))
    # Planck's law itself, as a table
    nm = np.arange(360.0, 831.0)
    planck = 1 / (nm**5 * np.expm1(1.4388e7 / (nm * 4000)))
    assert blackbody_to_rgb(4000) == pytest.approx(spectrum_to_rgb(nm, planck / planck[555 - 360]), rel=1e-9)


def test_read_spd(tmp_path):
    path = tmp_path / "a.spd"
    path.write_text("# two samples\n400 1 # here\n500 2.5e0\n")
    assert [a.tolist() for a in read_spd(path)] == [[400, 500], [1, 2.5]]


@pytest.mark.parametrize(
    "text, message", [("400 1\n500 x\n", "a.spd: .*'x'"), ("400 1 500", "got 3 numbers"), ("", "got 0 numbers")]
)
def test_bad_spd(tmp_path, text, message):
    path = tmp_path / "a.spd"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_spd(path)


def test_bad_spectra(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.spd"):
        read_spd(tmp_path / "none.spd")
    with pytest.raises(ValueError, match="two at 500 nm"):
        spectrum_to_rgb([500, 400, 500], [1, 2, 3])
    with pytest.raises(ValueError, match="as many wavelengths as values"):
        spectrum_to_rgb([500, 400], [1])
    with pytest.raises(ValueError, match="finite"):
        spectrum_to_rgb([500], [np.nan])
    with pytest.raises(ValueError, match="at least 0 K"):
        blackbody_to_rgb(-1)
    with pytest.raises(ValueError, match="cold"):
        blackbody_to_rgb(1)
