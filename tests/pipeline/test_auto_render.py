"""Renders in two rounds at the extremes: finite, within the budget, without warnings."""

import warnings
from functools import cache

import numpy as np
import pytest

import dmis
from dmis.brdf.materials import matte, plastic
from dmis.testing.scenes import box_scene


def glossy(resolution: tuple[int, int]) -> dmis.Scene:
    """Return a glossy floor that reflects a light."""
    return box_scene(plastic(0.3, 0.3, 0.02), resolution=resolution)


def black() -> dmis.Scene:
    """Return a scene that reflects nothing."""
    return box_scene(matte(0.0), resolution=(8, 8))


def half_black() -> dmis.Scene:
    """Return a scene of several tiles, some of which see nothing."""
    return box_scene(plastic(0.3, 0.3, 0.02), resolution=(96, 40), eye=(0, -9, 0.6), target=(-14, 0, 4), fov=90)


def one_pixel() -> dmis.Scene:
    """Return an image with nearly all power in few pixels: a small lamp that is in the picture."""
    quad = dmis.QuadLight((-0.02, -0.02, 0.5), (0, 0.04, 0), (0.04, 0, 0), (1e6,) * 3)
    return box_scene(matte(1e-4), (quad,), resolution=(16, 12))


def checked(scene: dmis.Scene, rule: str, spp: int, **options: object) -> dmis.Result:
    """Render without warnings, twice, and check what every image must be."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result, again = (dmis.render(scene, rule, spp, seed=3, parallel=n, **options) for n in (1, 2))
    np.testing.assert_array_equal(result.image, again.image)
    np.testing.assert_array_equal(result.deviation, again.deviation)
    assert np.isfinite(result.image).all() and (result.image >= 0).all()
    assert np.isfinite(result.deviation).all() or spp == 1 or (result.samples == 1).any()
    assert (result.samples >= 1).all()
    np.testing.assert_allclose(
        result.light_samples + result.brdf_samples, result.samples * result.shading_samples, rtol=1e-6
    )
    return result


@pytest.mark.parametrize("rule", ["auto", "counts"])
@pytest.mark.parametrize("spp", [1, 2, 3, 7, 16, 17, 33])
@pytest.mark.parametrize("resolution", [(1, 1), (2, 3), (3, 2), (9, 7)])
def test_few_samples_and_pixels(rule: str, spp: int, resolution: tuple[int, int]) -> None:
    checked(glossy(resolution), rule, spp, sampler="sobol")


@pytest.mark.parametrize("scene", [black, half_black, one_pixel])
@pytest.mark.parametrize("spp", [16, 64])
def test_extreme_images(scene, spp: int) -> None:
    result = checked(scene(), "auto", spp, sampler="sobol")
    assert (result.image == 0).any() or scene is one_pixel


def test_many_samples() -> None:
    result = checked(glossy((2, 2)), "auto", 4096, sampler="sobol")
    n = result.samples.astype(int)
    assert (n & (n - 1) == 0).all() and n.max() >= 1024


@cache
def converged_mean(integrator: str) -> float:
    """Mean of the glossy scene by the balance heuristic with many samples."""
    return dmis.render(glossy((16, 12)), "balance", 2048, integrator=integrator, sampler="sobol").image.mean()


@pytest.mark.parametrize("sampler", ["independent", "stratified", "lowdiscrepancy", "sobol"])
@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_samplers_and_integrators(sampler: str, integrator: str) -> None:
    """The mean of each is that of balance."""
    scene = glossy((16, 12))
    images = [checked(scene, "auto", 32, sampler=sampler, integrator=integrator)]
    images += [dmis.render(scene, "auto", 32, seed=s, sampler=sampler, integrator=integrator) for s in range(10, 20)]
    expected = converged_mean(integrator)
    means = np.array([result.image.mean() for result in images])
    assert abs(means.mean() - expected) < 5 * means.std(ddof=1) / np.sqrt(len(means)) + 2e-3 * expected
    assert images[0].deviation_of == ("sub-blocks" if sampler == "sobol" else "samples")
    assert images[0].provenance["deviation_of"] == images[0].deviation_of


def test_more_shading_samples() -> None:
    """Numbers are whole and even in every camera sample."""
    result = checked(glossy((16, 12)), "auto:error=absolute", 32, sampler="sobol", shading_samples=4)
    total, n = np.array([result.light_samples, result.brdf_samples]), result.samples
    halves = total / n / 2
    assert np.abs(halves - np.round(halves)).max() < 1e-4 and (total >= 2 * n - 1e-3).any()


def test_provenance_has_what_was_decided(box: dmis.Scene) -> None:
    """The predicted errors, as the rule's maps have them; nothing of a rule that decides nothing for the image."""
    result = dmis.render(box, "auto", 32, seed=1, integrator="path", max_depth=2)
    decided = result.provenance["decided"]
    assert {"pattern_error", "number_error"} <= decided.keys()
    for name, values in decided.items():
        np.testing.assert_allclose(values, result.maps[name], atol=5e-4)
    assert "decided" not in dmis.render(box, "balance", 4).provenance
