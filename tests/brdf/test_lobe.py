"""Lobes: sampling, densities, energy, symmetry, and the values that pbrt-v2's own classes print."""

import numpy as np
import pytest

from dmis.base.vectors import dot
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.coated_diffuse import CoatedBase
from dmis.brdf.diffuse import Lambert, OrenNayar
from dmis.brdf.distributions import Anisotropic, Blinn
from dmis.brdf.fresnel import Conductor, Dielectric
from dmis.brdf.materials import Material
from dmis.brdf.microfacet import Microfacet
from dmis.brdf.specular import SpecularReflection, SpecularTransmission
from dmis.testing.lobe import check_lobe
from dmis.testing.outcome import require
from dmis.testing.scenes import surface
from dmis.testing.sphere import polar

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


# Values that pbrt-v2 prints -----------------------------------------------------------------------------------------


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
