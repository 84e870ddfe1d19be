"""Lobes: sampling, densities, energy, symmetry, and the values that pbrt-v2's own classes print."""

import re
from pathlib import Path

import numpy as np
import pytest

from dmis.base.vectors import Array, dot
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.coated_diffuse import CoatedBase
from dmis.brdf.cosines import Directions
from dmis.brdf.diffuse import Lambert, OrenNayar
from dmis.brdf.distributions import Anisotropic, Blinn
from dmis.brdf.fresnel import Conductor, Dielectric
from dmis.brdf.materials import Material, substrate
from dmis.brdf.microfacet import Microfacet
from dmis.brdf.specular import SpecularReflection, SpecularTransmission
from dmis.testing.lobe import check_lobe
from dmis.testing.outcome import require
from dmis.testing.scenes import surface
from dmis.testing.sphere import columns, polar, uniforms

GOLD = Conductor((0.143124, 0.3749396, 1.442507), (3.983175, 2.385725, 1.603214))
"""Index and absorption of gold as pbrt-v2 makes RGB of its measured spectra."""

LOBES = {
    "lambert": Lambert(1.0),
    "oren-nayar 20": OrenNayar(1.0, 20.0),
    "oren-nayar 90": OrenNayar(1.0, 90.0),
    "blinn 10": Microfacet(1.0, Blinn(10.0)),
    "blinn 10 dielectric": Microfacet(1.0, Blinn(10.0), Dielectric(1.5)),
    "blinn 500 gold": Microfacet(1.0, Blinn(500.0), GOLD),
    "blinn 1e4": Microfacet(1.0, Blinn(1e4)),
    "blinn 1e4 dielectric": Microfacet(1.0, Blinn(1e4), Dielectric(1.5)),
    "anisotropic 20 200": Microfacet(1.0, Anisotropic(20.0, 200.0)),
    "blend base": BlendBase(1.0, 0.2),
    "blend coat blinn": BlendCoat(0.5, Blinn(50.0)),
    "blend coat anisotropic": BlendCoat(0.5, Anisotropic(300.0, 8.0)),
    "coated base": CoatedBase(1.0),
    "coated base rough": CoatedBase(0.9, 1.7, 0.3, 0.1, 5),
}
each_lobe = pytest.mark.parametrize("name", LOBES)


@each_lobe
def test_checks(name: str) -> None:
    """Samples, densities, energy, symmetry, finite values, renders."""
    require(check_lobe(LOBES[name], name))


@pytest.mark.parametrize("exponent, degrees", [(10.0, 80.0), (500.0, 89.0), (1e4, 80.0), (1e4, 89.0)])
def test_rounding_does_not_change_a_narrow_lobe(exponent: float, degrees: float) -> None:
    """The float32 density is the float64 one, in the mean over its own samples, at grazing angles too.

    The cosine of the half vector has an error of about eps / cos, which the exponent multiplies: 0.03 at worst here,
    and random from direction to direction; its mean over 2**14 samples is well below a hundredth.
    """
    wo, count = polar(degrees), 2**14
    points = surface(Material((Microfacet(1.0, Blinn(exponent)),)), wo, count)
    wi = points.sample(uniforms(count))
    got = points.pdf(Directions(points, wi)).astype(float)
    a, b = points.wo.astype(float), wi.astype(float)
    h = (a / np.linalg.norm(a, axis=0)) + (b / np.linalg.norm(b, axis=0))
    length = np.linalg.norm(h, axis=0)
    expected = (exponent + 1) / (2 * np.pi) * (h[2] / length) ** exponent / (2 * length)
    up = wi[2] > 1e-3
    up &= expected > 1e-3 * expected[up].max()
    assert abs((got / expected)[up].mean() - 1) < 0.01


def test_anisotropic_exponent_u_lies_along_dpdu() -> None:
    """A large exponent along dp/du makes the lobe narrow in that direction, wherever dp/du points."""
    material = Material((Microfacet(1.0, Anisotropic(1000.0, 10.0)),))
    for dpdu, other in (((1, 0, 0), (0, 1, 0)), ((0, 2, 0), (1, 0, 0))):
        points = surface(material, (0, 0, 1), 4096, dpdu=dpdu)
        wi = points.sample(uniforms(4096))
        assert np.std(np.asarray(dpdu, float) / np.linalg.norm(dpdu) @ wi) < 0.2 * np.std(np.asarray(other) @ wi)


# Values that pbrt-v2 prints -----------------------------------------------------------------------------------------

NUMBER = r"[-+]?\d*\.?\d+(?:e[-+]?\d+)?"


def numbers(text: str) -> list[float]:
    return [float(x) for x in re.findall(NUMBER, text)]


def pairs(folder: Path) -> list[tuple[Array, Array, dict[str, list[float]]]]:
    """Pairs (wo, wi) of the probe file with the values printed for them."""
    out = []
    name = ""
    for line in (folder / "probe.txt").read_text().splitlines():
        if line.startswith("pair"):
            wo, wi = (numbers(part) for part in re.findall(r"\(([^)]*)\)", line))
            out.append((np.array(wo), np.array(wi), {}))
        elif out and line.startswith("  pdf"):
            out[-1][2][name + " pdf"] = numbers(line)
        elif out:
            name, values = line.strip().rsplit(" f ", 1) if " f " in line else (line.strip(), "")
            values = values or " ".join(line.split()[-3:])
            out[-1][2][name] = numbers(values)
    assert out and all(values for _, _, values in out)
    return out


def test_dielectric_values_of_pbrt(references: Path) -> None:
    """Both index orders of the probe file: the swapped one of plastic is the reciprocal index. Printed to 1e-6.

    At cos .75 the swapped value sits on a slope of 20, at .76 of 7: an error of 6e-8 in the cosine is 1e-6 there.
    """
    lines = [numbers(x) for x in (references / "probe.txt").read_text().splitlines() if x.startswith("cos")]
    assert len(lines) == 9
    for line in lines:
        cos, swapped, usual = line[0], line[3], line[-1]
        np.testing.assert_allclose(Dielectric(1 / 1.5)(np.float32([cos])), swapped, atol=3e-6)
        np.testing.assert_allclose(Dielectric(1.5)(np.float32([cos])), usual, atol=1e-6)


def test_conductor_values_of_pbrt(references: Path) -> None:
    """Fresnel of gold at five angles, printed to 7 digits; a few roundings of float32."""
    lines = [numbers(x) for x in (references / "probe.txt").read_text().splitlines() if x.startswith("Au F")]
    assert len(lines) == 5
    for cos, *rgb in lines:
        np.testing.assert_allclose(GOLD(np.float32([cos]))[:, 0], rgb, atol=2e-6)


PROBED = {
    "metal Au rough .002": (Material((Microfacet(1.0, Blinn(500.0), GOLD),)), 500),
    "plastic spec Ks .2 rough .1": (Material((Microfacet(0.2, Blinn(10.0), Dielectric(1 / 1.5)),)), 10),
    "substrate Kd(.2 .4 .2) Ks .5 u=v=.05": (substrate((0.2, 0.4, 0.2), 0.5, 0.05, 0.05), 20),
    "substrate same, u=.02 v=.1": (substrate((0.2, 0.4, 0.2), 0.5, 0.02, 0.1), 50),
    "OrenNayar Kd .5 sigma 20": (Material((OrenNayar(0.5, 20.0),)), 1),
}


@pytest.mark.parametrize("name", PROBED)
def test_values_of_pbrt(references: Path, name: str) -> None:
    """BRDF and pdf of pbrt-v2's own classes; the exponent multiplies float32 roundings, three of 6e-8 or so."""
    material, exponent = PROBED[name]
    for wo, wi, values in pairs(references):
        points = surface(material, wo)
        directions = Directions(points, columns(wi))
        tolerance = 3e-6 + 4e-7 * exponent
        f = np.broadcast_to(points.eval(directions), (3, 1))[:, 0]
        np.testing.assert_allclose(f, values[name], rtol=tolerance)
        if name + " pdf" in values:
            np.testing.assert_allclose(points.pdf(directions), values[name + " pdf"], rtol=tolerance)


# Delta lobes --------------------------------------------------------------------------------------------------------


def specular(degrees: float, outside: bool, *lobes: SpecularReflection | SpecularTransmission) -> tuple:
    points = surface(Material(lobes), polar(degrees), outside=outside)
    return points, [lobe.scatter(points) for lobe in points.delta]


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 89.0, 89.99])
def test_mirror_direction(degrees: float) -> None:
    """A mirror turns the tangential part around and keeps the normal part."""
    points, [(wi, factor)] = specular(degrees, True, SpecularReflection((0.9, 0.5, 0.1)))
    np.testing.assert_allclose(wi, points.wo * [[-1], [-1], [1]], atol=1e-6)
    np.testing.assert_allclose(factor, np.float32([[0.9], [0.5], [0.1]]))


@pytest.mark.parametrize("outside", [True, False])
@pytest.mark.parametrize("degrees", [0.0, 20.0, 41.0])
def test_snell(degrees: float, outside: bool) -> None:
    """``sin_t = sin_o / eta``, across the surface, in the plane of incidence."""
    eta = 1.5 if outside else 1 / 1.5
    points, [(wi, _)] = specular(degrees, outside, SpecularTransmission(1.0, 1.5))
    np.testing.assert_allclose(wi[:2], -points.wo[:2] / eta, atol=1e-6)
    assert wi[2] < 0
    # at 41 degrees inside, the sine of the refracted angle is .984: a rounding is amplified five times
    np.testing.assert_allclose(dot(wi, wi), 1, atol=2e-6)


@pytest.mark.parametrize("outside", [True, False])
@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 85.0])
def test_glass_conserves_energy(degrees: float, outside: bool) -> None:
    """Reflection plus transmission is 1; radiance that enters eta is divided by eta^2, as its solid angle shrinks."""
    eta = 1.5 if outside else 1 / 1.5
    _, [(_, r), (_, t)] = specular(
        degrees, outside, SpecularReflection(1.0, Dielectric(1.5)), SpecularTransmission(1.0, 1.5)
    )
    np.testing.assert_allclose(r + t * eta**2, 1, atol=1e-6)
    if not outside and degrees > 42:
        np.testing.assert_array_equal(t, 0)


def test_transmission_at_equal_indices_goes_straight_on() -> None:
    """Index ratio 1 (pbrt's opacity) changes neither direction nor radiance."""
    points, [(wi, factor)] = specular(50.0, True, SpecularTransmission(0.3, 1.0))
    np.testing.assert_allclose(wi, -points.wo, atol=1e-6)
    np.testing.assert_allclose(factor, 0.3, atol=1e-6)


@pytest.mark.parametrize("degrees", [89.9999, 90.0])
@pytest.mark.parametrize("outside", [True, False])
def test_specular_grazing_is_finite(degrees: float, outside: bool) -> None:
    """No NaN where the direction lies in the surface."""
    for lobe in (SpecularReflection(1.0, GOLD), SpecularReflection(1.0, Dielectric(1.5)), SpecularTransmission(1.0)):
        _, [(wi, factor)] = specular(degrees, outside, lobe)
        assert np.isfinite(wi).all() and np.isfinite(factor).all() and (np.asarray(factor) >= 0).all()
