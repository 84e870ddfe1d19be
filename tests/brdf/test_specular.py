"""Mirrors and smooth glass: directions and factors in closed form."""

import numpy as np
import pytest

from dmis.base.vectors import dot
from dmis.brdf.fresnel import Conductor, Dielectric
from dmis.brdf.materials import Material
from dmis.brdf.specular import SpecularReflection, SpecularTransmission
from dmis.testing.scenes import surface
from dmis.testing.sphere import polar

GOLD = Conductor((0.143124, 0.3749396, 1.442507), (3.983175, 2.385725, 1.603214))


def specular(degrees: float, outside: bool, *lobes: SpecularReflection | SpecularTransmission) -> tuple:
    points = surface(Material(lobes), polar(degrees), outside=outside)
    return points, [lobe.scatter(points) for lobe in points.delta]


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 89.0, 89.99])
def test_mirror_direction(degrees: float) -> None:
    """A mirror turns the tangential part around and keeps the normal part."""
    points, [(wi, factor)] = specular(degrees, True, SpecularReflection((0.9, 0.5, 0.1)))
    np.testing.assert_allclose(wi, points.wo * [[-1], [-1], [1]], atol=1e-6)
    np.testing.assert_allclose(factor, np.float32([[0.9], [0.5], [0.1]]))


@pytest.mark.parametrize("outside, index", [(True, 1.5), (False, 1.5), (True, 1.0)])
@pytest.mark.parametrize("degrees", [0.0, 20.0, 41.0])
def test_snell(degrees: float, outside: bool, index: float) -> None:
    """``sin_t = sin_o / eta``, across the surface, in the plane of incidence; straight on at index 1."""
    points, [(wi, _)] = specular(degrees, outside, SpecularTransmission(1.0, index))
    np.testing.assert_allclose(wi[:2], -points.wo[:2] / (index if outside else 1 / index), atol=1e-6)
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


@pytest.mark.parametrize("degrees", [89.9999, 90.0])
@pytest.mark.parametrize("outside", [True, False])
def test_specular_grazing_is_finite(degrees: float, outside: bool) -> None:
    """No NaN where the direction lies in the surface."""
    for lobe in (SpecularReflection(1.0, GOLD), SpecularReflection(1.0, Dielectric(1.5)), SpecularTransmission(1.0)):
        _, [(wi, factor)] = specular(degrees, outside, lobe)
        assert np.isfinite(wi).all() and np.isfinite(factor).all() and (np.asarray(factor) >= 0).all()
