"""Materials: which lobes they are made of, their energy, and their sampling as mixtures of lobes."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers import LEVEL

from dmis.base.vectors import Array
from dmis.brdf import materials
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.distributions import Anisotropic, Blinn
from dmis.brdf.lobe import Directions, Lambert
from dmis.brdf.materials import Material, glass, matte, metal, mirror, plastic, shiny_metal, substrate, uber
from dmis.brdf.microfacet import Microfacet
from dmis.brdf.specular import SpecularReflection, SpecularTransmission
from dmis.brdf.texture import Image
from dmis.testing.density import DensityView
from dmis.testing.scenes import surface
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


@pytest.mark.parametrize(
    "made, kinds",
    [
        (matte(), (Lambert,)),
        (matte(0), ()),
        (plastic(), (Lambert, Microfacet)),
        (plastic(0, 0.2), (Microfacet,)),
        (metal(), (Microfacet,)),
        (shiny_metal(), (Microfacet, SpecularReflection)),
        (substrate(), (BlendBase, BlendCoat)),
        (mirror(), (SpecularReflection,)),
        (glass(), (SpecularReflection, SpecularTransmission)),
        (uber(), (Lambert, Microfacet)),
        (uber(opacity=0.5), (SpecularTransmission, Lambert, Microfacet)),
        (uber(kr=0.1, kt=0.1), (Lambert, Microfacet, SpecularReflection, SpecularTransmission)),
    ],
)
def test_lobes(made: Material, kinds: tuple[type, ...]) -> None:
    """A black parameter leaves its lobe out; the rest are there, in order."""
    assert tuple(type(lobe) for lobe in made.lobes) == kinds


def test_roughness_is_the_reciprocal_exponent() -> None:
    """pbrt's roughness r is Blinn's exponent 1/r; textured roughness too; u != v makes the coat anisotropic."""
    assert materials.blinn(0.002).exponent == pytest.approx(500)
    texels = np.array([[[0.1], [0.5]]], np.float32)
    middle = materials.blinn(Image(texels)).exponent(np.array([[0.25, 0.5], [0.5, 0.5]], np.float32))
    np.testing.assert_allclose(middle, [[10, 1 / 0.3]], rtol=1e-5)  # roughness is interpolated, not its reciprocal
    assert isinstance(substrate(u_roughness=0.1, v_roughness=0.1).lobes[1].distribution, Blinn)
    coat = substrate(u_roughness=0.02, v_roughness=0.1).lobes[1].distribution
    assert isinstance(coat, Anisotropic) and (coat.u, coat.v) == pytest.approx((50, 10))


def test_opacity_dims_all_but_what_passes_straight_through() -> None:
    """Opacity o multiplies Kd, Ks, Kr, Kt; a share 1 - o goes straight on at index 1."""
    made = uber(0.4, 0.2, 0.3, 0.1, opacity=(0.5, 0.25, 1.0))
    through, kd, ks, kr, kt = made.lobes
    assert through.transmittance == pytest.approx((0.5, 0.75, 0.0)) and through.eta == 1
    for lobe, value in ((kd, 0.4), (ks, 0.2), (kr, 0.3)):
        assert lobe.reflectance == pytest.approx((0.5 * value, 0.25 * value, value))
    assert kt.transmittance == pytest.approx((0.05, 0.025, 0.1)) and kt.eta == 1.5


def _image(*texel: float) -> Image:
    """Two texels, the first of which is good."""
    return Image(np.array([[np.full(len(texel), 0.1), texel]]))


def test_the_ends_of_ranges_are_in_them() -> None:
    """What a range includes is accepted, and a reflectance that is 1 but for rounding."""
    assert matte((1 + 1e-7, 1, 0), 90).lobes and mirror(_image(1, 1, 0)).lobes and metal(0, np.zeros(3)).lobes
    assert len(shiny_metal(1, (0, 1, 0.5)).lobes) == 2 and len(uber(_image(0.5), opacity=(0, 0.5, 1)).lobes) == 3
    assert plastic(roughness=np.array([0.1])).lobes[1].distribution.exponent == pytest.approx(10)
    assert glass(eta=1).lobes and glass(eta=1 / 1.5).lobes


def test_reflectances_of_files_may_exceed_1() -> None:
    """Those of pbrt files, while they are read, in this thread alone; bounds come back, also after an error."""
    with materials.unbounded():
        assert matte((255, 0, 0)).lobes and uber(kd=3, ks=2, opacity=0.9).lobes and mirror(_image(9.0)).lobes
        with ThreadPoolExecutor(1) as other:
            assert isinstance(other.submit(matte, 2).exception(), ValueError)
    with pytest.raises(ValueError, match="kd must be finite and not negative"), materials.unbounded():
        matte(-1)
    with pytest.raises(ValueError, match="kd must be at most 1"):
        matte(2)


def test_a_lobe_alone_is_no_tuple_of_lobes() -> None:
    with pytest.raises(ValueError, match=r"lobes must be a tuple of lobes; got Lambert.* Write Material\(\(lobe,\)\)"):
        Material(Lambert(0.5))
