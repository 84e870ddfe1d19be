"""Materials: their sampling as mixtures of lobes, that of glTF by its formulas, and parameters that are refused."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers import LEVEL, reflected

import dmis
from dmis.base.vectors import Array
from dmis.brdf import materials
from dmis.brdf.fresnel import Conductor, Dielectric
from dmis.brdf.lobe import Directions, Lambert
from dmis.brdf.materials import Material, glass, matte, metal, mirror, plastic, shiny_metal, substrate, uber
from dmis.brdf.metallic_roughness import UnderCoat
from dmis.brdf.microfacet import GGX
from dmis.brdf.specular import SpecularTransmission
from dmis.brdf.texture import Image
from dmis.testing.density import DensityView
from dmis.testing.scenes import FLOOR, surface
from dmis.testing.sphere import polar, uniforms

MIXTURES = {
    "plastic": plastic(0.3, 0.4, 0.02),
    "anisotropic substrate": substrate((0.2, 0.4, 0.2), 0.5, 0.02, 0.1),
    "uber": uber(0.3, 0.3, 0.2, 0.2, 0.01, opacity=0.7),
}


@pytest.mark.parametrize("name", MIXTURES)
@pytest.mark.parametrize("degrees", [10.0, 60.0, 84.0])
def test_samples_follow_the_density(name: str, degrees: float) -> None:
    """Chi-square of whole materials: a lobe picked uniformly, the pdf the mean over the lobes."""
    wo, count = polar(degrees), 2**16
    points = surface(MIXTURES[name], wo, count)
    wi = points.sample(uniforms(count))

    def pdf(w: Array) -> Array:
        some = surface(MIXTURES[name], wo, w.shape[1])
        return some.pdf(Directions(some, w))

    assert DensityView(wi, pdf, wi[2] > 0).p > LEVEL


def image(*texel: float) -> Image:
    """Two texels, the first of which is good."""
    return Image(np.array([[np.full(len(texel), 0.1), texel]]))


def test_ranges_of_parameters() -> None:
    """Those of pbrt files, while they are read, in this thread alone; bounds come back, also after an error."""
    with materials.unbounded():
        assert matte((255, 0, 0)).lobes and uber(kd=3, ks=2, opacity=0.9).lobes and mirror(image(9.0)).lobes
        with ThreadPoolExecutor(1) as other:
            assert isinstance(other.submit(matte, 2).exception(), ValueError)
    with pytest.raises(ValueError, match="kd must be finite and not negative"), materials.unbounded():
        matte(-1)
    with pytest.raises(ValueError, match="kd must be at most 1"):
        matte(2)
    assert matte((1 + 1e-7, 1, 0), 90).lobes and mirror(image(1, 1, 0)).lobes and metal(0, np.zeros(3)).lobes
    assert len(shiny_metal(1, (0, 1, 0.5)).lobes) == 2 and len(uber(image(0.5), opacity=(0, 0.5, 1)).lobes) == 3
    assert plastic(roughness=np.array([0.1])).lobes[1].distribution.exponent == pytest.approx(10)
    assert glass(eta=1).lobes and glass(eta=1 / 1.5).lobes
    # a lobe alone is no tuple of lobes
    with pytest.raises(ValueError, match=r"lobes must be a tuple of lobes; got Lambert.* Write Material\(\(lobe,\)\)"):
        Material(Lambert(0.5))


# Bad parameters -------------------------------------------------------------------------------------------------------


ONE = Image(np.ones((1, 1, 1)))
NOT_POSITIVE = (0, -0.1, np.inf, np.nan, 1e-39, 1e39, (0.1, 0.2), (1, 2, 3))
INDICES = (*NOT_POSITIVE, ONE)
BLACK_OUTSIDE = Image(np.full((2, 2, 1), 0.5), wrap="black")
LENGTHS = (*NOT_POSITIVE, image(0), image(-1), image(0.1, 0.2, 0.3), BLACK_OUTSIDE)
ALPHAS = (*LENGTHS, 1e-6)
COLOURS = (-0.1, 1.001, (255, 0, 0), (0.1, np.inf, 0), (0.1, 0.2), (1, 1, 1, 1), 1e39, image(200.0))
SHARES = (-0.1, 1.5, np.nan)
COUNTS = (0, 1.5, np.nan)
FRESNEL = (1.5, Dielectric(-1.5), Conductor((1, np.nan, 1), (0, 0, 0)), Conductor((1, 1, 1), (0, 0)))
BAD: list[tuple[Callable[..., Any], dict[str, tuple]]] = [
    (dmis.matte, {"kd": COLOURS, "sigma": (91, -1, np.nan, ONE)}),
    (dmis.plastic, {"kd": COLOURS, "ks": COLOURS, "roughness": LENGTHS, "eta": INDICES}),
    (dmis.metal, {"roughness": LENGTHS, "eta": ((1, 2), ONE, np.nan), "k": (ONE, (1, np.nan, 1), -1)}),
    (dmis.shiny_metal, {"ks": (*COLOURS, 2, ONE), "kr": COLOURS, "roughness": LENGTHS}),
    (dmis.substrate, {"kd": COLOURS, "ks": COLOURS, "u_roughness": LENGTHS, "v_roughness": LENGTHS}),
    (dmis.mirror, {"kr": COLOURS}),
    (dmis.glass, {"kr": COLOURS, "kt": COLOURS, "eta": INDICES}),
    (dmis.uber, {"kd": COLOURS, "ks": COLOURS, "kr": COLOURS, "kt": COLOURS}),
    (dmis.uber, {"opacity": (2, (0.5, -0.1, 1), ONE), "roughness": LENGTHS, "eta": INDICES}),
    (dmis.phong, {"kd": COLOURS, "ks": COLOURS, "exponent": LENGTHS}),
    (dmis.lafortune, {"exponent": LENGTHS, "c_n": (0, 1.2, np.nan, ONE), "c_t": (-1.1, 1.1, np.nan, ONE)}),
    (dmis.blinn_phong, {"kd": COLOURS, "ks": COLOURS, "exponent": LENGTHS}),
    (dmis.ward, {"kd": COLOURS, "ks": COLOURS, "alpha": ALPHAS, "alpha_v": ALPHAS}),
    (dmis.ashikhmin_shirley, {"kd": COLOURS, "ks": COLOURS, "n_u": LENGTHS, "n_v": LENGTHS}),
    (dmis.torrance_sparrow, {"kd": COLOURS, "ks": COLOURS, "exponent": LENGTHS, "fresnel": FRESNEL}),
    (dmis.cook_torrance, {"kd": COLOURS, "ks": COLOURS, "alpha": ALPHAS, "alpha_v": ALPHAS, "fresnel": FRESNEL}),
    (dmis.ggx, {"kd": COLOURS, "ks": COLOURS, "alpha": ALPHAS, "alpha_v": ALPHAS, "fresnel": FRESNEL}),
    (dmis.rough_glass, {"kr": COLOURS, "kt": COLOURS, "alpha": ALPHAS, "alpha_v": ALPHAS, "eta": (*INDICES, 1)}),
    (dmis.coated_diffuse, {"kd": COLOURS, "alpha": (1e-6, 11, np.nan, (0.1, 0.2), ONE), "bounces": COUNTS}),
    (dmis.coated_diffuse, {"eta": (0.9, 101, np.nan), "thickness": (-1, np.nan)}),
    (dmis.coated_conductor, {"eta": (0, np.nan), "k": (-1,), "coat_eta": (0.5, 4.1), "bounces": COUNTS}),
    (dmis.coated_conductor, {"alpha": (-1, 1.1), "coat_alpha": (1e-6, -1), "thickness": (-1, np.nan)}),
    (dmis.metallic_roughness, {"base": COLOURS, "metallic": SHARES, "roughness": SHARES, "opacity": SHARES}),
    (dmis.metallic_roughness, {"specular": SHARES, "eta": INDICES}),
    (partial(dmis.Part, FLOOR, dmis.ggx()), {"tangent": ((0, 0, 0), (np.nan, 1, 1), (0, 1))}),
    # whether or not there is a lobe that has it
    (partial(dmis.plastic, ks=0), {"eta": INDICES}),
    (partial(dmis.glass, kr=0, kt=0), {"eta": INDICES}),
    (partial(dmis.uber, ks=0), {"eta": INDICES}),
    (partial(dmis.uber, opacity=0), {"kd": (-1,)}),
    (partial(dmis.uber, opacity=(1, 1, 1)), {"kd": ((0.1, 0.2),)}),
]


@pytest.mark.parametrize("make, name, values", [(make, *item) for make, named in BAD for item in named.items()])
def test_a_parameter_out_of_range_is_named(make: Callable[..., Any], name: str, values: tuple) -> None:
    for value in values:
        with pytest.raises(ValueError, match=rf"{name.removeprefix('coat_')}( of fresnel)? must .*; got "):
            make(**{name: value})


# The material of glTF, against the formulas of its specification ------------------------------------------------------


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
