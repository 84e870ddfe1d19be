"""Materials: which lobes they are made of, their energy, and their sampling as mixtures of lobes."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers import LEVEL

from dmis.base.vectors import Array
from dmis.brdf import materials
from dmis.brdf.lobe import Directions, Lambert
from dmis.brdf.materials import Material, glass, matte, metal, mirror, plastic, shiny_metal, substrate, uber
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
