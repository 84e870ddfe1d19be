"""Stiff scenes: the mean is right up to what float32 must lose, and nothing is infinite, whatever the rule.

The family is that of examples/stiff.py, whose truths are closed forms and quadrature in float64. NumPy's floating-point
warnings are errors, here as in all tests. A sample takes seconds; `make test-slow` has the whole map.
"""

import warnings
from collections.abc import Callable

import numpy as np
import pytest
import stiff
from helpers import Z_LIMIT

import dmis
from dmis.base.vectors import Array
from dmis.brdf.lobe import Directions
from dmis.fit.registry import RULES
from dmis.testing.scenes import box_scene, surface
from dmis.testing.sphere import columns, polar, unit

FAMILY = list(stiff.family())
SAMPLE = (
    *("light radius, roughness 8e-06, 1e-08", "light radius, roughness 8e+06, 1e-08", "light distance 8e+06"),
    *("radiance 1e+30", "sun's contrast 1e+08", "grazing view 1e-07", "light in contact, facing 0.0001"),
    *("ground under a sphere of radius 1 1e+06", "offset 8e+06", "scale 1e+06", "albedo 1"),
    "identical techniques, light 0",
)
CASES = {case.name: case for case in FAMILY}


@pytest.mark.parametrize("name", SAMPLE)
def test_a_sample_of_the_map(name: str) -> None:
    """The balance heuristic."""
    assert stiff.measure(CASES[name], "balance", 64).z(CASES[name].rounding) < Z_LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["balance", "pbrt", "second-moment", "auto"])
@pytest.mark.parametrize("case", FAMILY, ids=lambda case: case.name)
def test_every_case_of_the_map(case: stiff.Case, rule: str) -> None:
    """All cases; where float32 loses everything, what comes out is at least finite."""
    found = stiff.measure(case, rule, 128, seed=2)
    assert np.isfinite(found.mean) == (not found.refused) == (not case.refused)
    assert case.refused or case.rounding >= 1 or found.z(case.rounding) < Z_LIMIT


EVERY_RULE = [
    *(rule for rule in sorted(RULES) if rule not in ("fixed", "pbrt", "one-sample")),
    *("thesis:patch=4,spp=4,channels=rgb,combiner=power", "balance:combiner=maximum"),
    *("second-moment:combiner=power-3", "auto:combiner=cutoff-0.3"),
]
"""The rules, without those that differ from another by their heuristic alone; and some heuristics."""


@pytest.mark.parametrize("rule", EVERY_RULE)
def test_every_rule_is_finite(rule: str) -> None:
    """No rule divides by what a stiff scene makes 0, or squares what it makes too large."""
    blind = rule.startswith(("uniform", "thesis"))  # the latter may leave a technique too few samples
    for name in ("radiance 1e+30", "light radius, roughness 8e-06, 1e-08", "light distance 8e+06"):
        result = stiff.measure(CASES[name], rule, 16)
        assert np.isfinite(result.mean) and (blind or result.z(CASES[name].rounding) < Z_LIMIT)


# Images that are degenerate -----------------------------------------------------------------------------------------


def one_point(radiance: float = 1.0, resolution: tuple[int, int] = (1, 1), lit: bool = False) -> dmis.Scene:
    """A floor under a lamp, in few pixels; or nothing but the lamp in all of them."""
    lamp = dmis.QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (radiance,) * 3)
    target, eye = ((0, 0, 2), (0, -0.1, 0.5)) if lit else ((0, 0, 0), (0, -1, 0.7))
    extra = (dmis.light_part(lamp),)
    return box_scene(lights=(lamp,), extra=extra, resolution=resolution, eye=eye, target=target, fov=5.0)


@pytest.mark.filterwarnings("ignore:.*none of its 1 lights emits:dmis.scene.scene.SceneWarning")
@pytest.mark.parametrize("rule", EVERY_RULE)
def test_images_without_noise(rule: str) -> None:
    """All black, all lamp, or all behind a screen: nothing varies, and no weight is better than another."""
    screen = dmis.Part(dmis.geometry.shapes.quad((-9, -9, 1.5), (18, 0, 0), (0, 18, 0)), dmis.matte(0.5))
    lamp = one_point(7.0, (5, 4))
    shadow = lamp.changed(parts=(*lamp.parts, screen))
    for scene, seen in ((one_point(0.0, (5, 4)), 0.0), (one_point(7.0, (5, 4), lit=True), 7.0), (shadow, 0.0)):
        result = dmis.render(scene, rule, 16, parallel=1)
        np.testing.assert_array_equal(result.image, np.full((4, 5, 3), seen, np.float32))
        np.testing.assert_array_equal(result.variance, 0)
        assert np.isfinite(result.weight).all()
    assert sum(result.rays.values()) > result.rays["camera"]


@pytest.mark.parametrize("rule", EVERY_RULE)
@pytest.mark.parametrize("resolution", [(1, 1), (1, 5)])
def test_images_smaller_than_a_patch(rule: str, resolution: tuple[int, int]) -> None:
    """One pixel, one column, less than a patch."""
    result = dmis.render(one_point(resolution=resolution), rule, 64, parallel=1)
    assert result.image.shape == (resolution[1], resolution[0], 3) and (result.image >= 0).all()
    assert np.isfinite(result.weight).all() and np.isfinite(result.variance).all()


def test_one_sample_has_no_variance() -> None:
    """1 spp is an image; its variance is said to be unknown."""
    result = dmis.render(one_point(), "balance", 1)
    assert np.isfinite(result.image).all() and np.isnan(result.variance).all()


# Numerics -----------------------------------------------------------------------------------------------------------


EXPONENTS = [dmis.torrance_sparrow, dmis.blinn_phong, dmis.phong]
ROUGHNESSES = [dmis.ward, dmis.cook_torrance, dmis.ggx]


@pytest.mark.parametrize("make", [*EXPONENTS, *ROUGHNESSES, dmis.ashikhmin_shirley])
@pytest.mark.parametrize("exponent", [1e4, 1e8])
def test_sharp_lobes(make: Callable[..., dmis.Material], exponent: float) -> None:
    """Densities of a sharp lobe are those of float64 at the same directions, a few of its widths from the mirror's.

    A cosine near 1 is off by 6e-8, which times 1e8 is more than the lobe.
    """
    width = np.sqrt(2 / exponent) if make in ROUGHNESSES else exponent
    material = make(0.0, 0.5, width) if make is not dmis.ashikhmin_shirley else make(0.0, 0.5, width, 2 * width)
    normal = unit(0.3, -0.5, 0.8)
    mirrored = (2 * normal[:, None] @ normal[None] - np.eye(3)) @ (wo := polar(30.0))
    slopes = np.random.default_rng(1).normal(size=(3, 64)) * 2 / np.sqrt(exponent)
    wi = mirrored[:, None] + slopes
    wi /= np.linalg.norm(wi, axis=0)
    single, double = (
        _lobe(material, *(np.asarray(v, dtype) for v in (columns(wo, 64), columns(normal, 64), wi.astype(np.float32))))
        for dtype in (np.float32, np.float64)
    )
    assert double[0].max() > 1
    for one, two in zip(single, double):
        np.testing.assert_allclose(one, two, rtol=2e-6 * np.sqrt(exponent), atol=1e-6 * two.max())


def _lobe(material: dmis.Material, wo: Array, n: Array, wi: Array) -> tuple[Array, Array]:
    """``f`` and density of the first glossy lobe at unit vectors of either type, brought to unit length in it."""
    wo, n, wi = (v / np.sqrt((v * v).sum(axis=0)) for v in (wo, n, wi))
    at = surface(material, polar(30.0), wo.shape[1])
    vars(at).update(n=n, ng=n, wo=wo, cos_o=(n * wo).sum(axis=0), dpdu=np.broadcast_to(polar(80.0)[:, None], wo.shape))
    lobe = at.reflection[-1]
    return np.broadcast_to(lobe.eval(Directions(at, wi)), wo.shape)[0], lobe.pdf(Directions(at, wi))


def test_a_pixel_that_is_no_number_is_no_image(monkeypatch) -> None:
    """Values of shipped code are not checked sample by sample; what is not finite is refused in the pixel's mean."""
    monkeypatch.setattr(dmis.brdf.lobe.Lambert, "eval", lambda self, directions: np.full((1, 1), np.inf, np.float32))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(ValueError, match=r"pixel at row \d+, column \d+ must be finite"):
            dmis.render(box_scene(), "balance", 2, parallel=1)
