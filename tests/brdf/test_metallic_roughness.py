"""The material of glTF against the formulas of its specification, and its images."""

import numpy as np
import pytest
from helpers import reflected

import dmis
from dmis.brdf.lobe import Directions, Lambert
from dmis.brdf.metallic_roughness import UnderCoat
from dmis.brdf.microfacet import GGX
from dmis.brdf.specular import SpecularTransmission
from dmis.testing.scenes import surface
from dmis.testing.sphere import polar


def by_the_book(base, metallic, roughness, specular, eta, wo, wi):
    """Appendix B of the specification, one pair of directions at a time, but for the base."""
    base = np.broadcast_to(base, 3).astype(float)
    h = (wo + wi) / np.linalg.norm(wo + wi)
    v_dot_h, n_l, n_v, n_h = wi @ h, wi[2], wo[2], h[2]
    a2 = roughness**4
    d = a2 / (np.pi * (n_h**2 * (a2 - 1) + 1) ** 2)
    root_l, root_v = (n + np.sqrt(a2 + (1 - a2) * n * n) for n in (n_l, n_v))
    lambda_l, lambda_v = ((root / n - 2) / 2 for root, n in ((root_l, n_l), (root_v, n_v)))  # of each, uncorrelated
    v = 1 / ((1 + lambda_l + lambda_v) * 4 * n_l * n_v)
    grow = (1 - abs(v_dot_h)) ** 5
    f0 = specular * ((eta - 1) / (eta + 1)) ** 2
    metal, dielectric = d * v * (base + (1 - base) * grow), f0 + (specular - f0) * grow
    grazing = max(specular * (1 - 0.9 * roughness**2), f0)
    through_i, through_o = (1 - f0 - (grazing - f0) * (1 - n) ** 5 for n in (n_l, n_v))
    diffuse = base / np.pi * through_i * through_o / (1 - f0 - (grazing - f0) / 21)
    return metallic * metal + (1 - metallic) * (diffuse + dielectric * d * v)


@pytest.mark.parametrize("metallic", [0, 0.3, 1])
@pytest.mark.parametrize("roughness", [0.2, 0.7])
@pytest.mark.parametrize("coat", [(1, 1.5), (0.4, 1.8)])
def test_formulas(metallic, roughness, coat):
    base, wo = (0.9, 0.4, 0.1), polar(50, 10)
    w = np.stack([polar(a, b) for a, b in ((10, 0), (45, 190), (60, 200), (80, 60))], axis=1)
    some = surface(dmis.metallic_roughness(base, metallic, roughness, *coat, 0.6), wo, w.shape[1])
    values = np.broadcast_to(some.eval(Directions(some, w.astype(np.float32))), w.shape)
    expected = np.stack([by_the_book(base, metallic, roughness, *coat, wo, wi) for wi in w.T], axis=1)
    np.testing.assert_allclose(values, 0.6 * expected, rtol=3e-4)


@pytest.mark.parametrize("degrees", [0, 50, 80, 88])
@pytest.mark.parametrize("metallic, roughness", [(0, 0.1), (0, 0.5), (0, 1), (0.5, 0.5), (1, 0.5)])
def test_a_white_surface_reflects_no_more_than_it_gets(degrees, metallic, roughness):
    share = reflected(dmis.metallic_roughness(1.0, metallic, roughness), polar(degrees, 25), 400)
    assert 0.3 < share < 1.01
    if metallic == 0 and roughness == 0.1:  # all of it, through the coat or by the coat
        assert share > 0.93


def test_lobes_that_are_needed():
    kinds = [type(lobe) for lobe in dmis.metallic_roughness(0.5).lobes]
    assert kinds == [UnderCoat, GGX]
    assert [type(lobe) for lobe in dmis.metallic_roughness(0.5, 1).lobes] == [GGX]
    assert [type(lobe) for lobe in dmis.metallic_roughness(0.5, specular=0).lobes] == [Lambert]
    clear, base, coat = dmis.metallic_roughness(0.5, opacity=0.25).lobes
    assert isinstance(clear, SpecularTransmission) and clear.transmittance == (0.75,)
    assert base.reflectance == (0.125,) and coat.reflectance == 0.25


def test_images_are_combined():
    """Of two sizes: the smaller is interpolated. The lobes have the values of the formulas at each texel."""
    rng = np.random.default_rng(1)
    base, metallic = dmis.Image(rng.random((4, 6, 3))), dmis.Image(rng.random((4, 6, 1)))
    rough = dmis.Image(np.full((2, 2, 1), 0.5))
    diffuse, glossy = dmis.metallic_roughness(base, metallic, rough).lobes
    np.testing.assert_allclose(diffuse.reflectance.texels, base.texels * (1 - metallic.texels), rtol=1e-6)
    f0 = 0.04 * (1 - metallic.texels) + base.texels * metallic.texels
    np.testing.assert_allclose(glossy.fresnel.f0.texels, f0, rtol=1e-5)
    np.testing.assert_allclose(glossy.roughness.alpha.texels, 0.25)
    small = dmis.Image(metallic.texels[:2, :2])
    combined = dmis.metallic_roughness(base, small).lobes[0].reflectance
    t, s = (np.mgrid[:4, :6] + 0.5).reshape(2, -1) / [[4], [6]]
    expected = base.texels.reshape(-1, 3) * (1 - small(np.float32([s, t])).T)
    np.testing.assert_allclose(combined.texels.reshape(-1, 3), expected, rtol=1e-5)
    with pytest.raises(ValueError, match="images that are combined must have one scale, offset and wrap"):
        dmis.metallic_roughness(base, dmis.Image(metallic.texels, scale=(2, 2)))
