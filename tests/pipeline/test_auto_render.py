"""Renders in two rounds at the extremes: finite, within the budget, without warnings, and unbiased in few pixels."""

from __future__ import annotations

import warnings
from functools import cache
from itertools import product

import numpy as np
import pytest

import dmis
from dmis.brdf.materials import matte, plastic
from dmis.geometry.shapes import quad
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
    # numbers are whole and even in every camera sample
    result = checked(glossy((16, 12)), "auto:error=absolute", 32, sampler="sobol", shading_samples=4)
    total, n = np.array([result.light_samples, result.brdf_samples]), result.samples
    halves = total / n / 2
    assert np.abs(halves - np.round(halves)).max() < 1e-4 and (total >= 2 * n - 1e-3).any()


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


def test_provenance_has_what_was_decided(box: dmis.Scene) -> None:
    """The predicted errors, as the rule's maps have them; nothing of a rule that decides nothing for the image."""
    result = dmis.render(box, "auto", 32, seed=1, integrator="path", max_depth=2)
    decided = result.provenance["decided"]
    assert {"pattern_error", "number_error"} <= decided.keys()
    for name, values in decided.items():
        np.testing.assert_allclose(values, result.maps[name], atol=5e-4)
    assert "decided" not in dmis.render(box, "balance", 4).provenance


# Images of 1 to 16 pixels --------------------------------------------------------------------------------------------


LAMP = np.array([(-0.5, -0.5, 3.0), (0.7, -0.5, 3.0), (0.7, 0.5, 3.0), (-0.5, 0.5, 3.0)])
Z_LIMIT = 4.5


def lit_floor(resolution: tuple[int, int], fov: float = 1e-3, width: float = 8) -> dmis.Scene:
    """Return a matte floor under a lamp of radiance 1; with a small `fov` all pixels see the point (0, 0, 0)."""
    floor = dmis.Part(quad((-4, -4, 0), (width, 0, 0), (0, 8, 0)), dmis.matte(0.5))
    lamp = dmis.QuadLight(LAMP[0], LAMP[3] - LAMP[0], LAMP[1] - LAMP[0], (1, 1, 1))
    camera = dmis.Camera.look_at((0, 0.01, 2), (0, 0, 0), fov=fov, resolution=resolution)
    return dmis.Scene(camera, (floor,), (lamp,), "floor", dmis.Suggestions("direct"))


def radiance_of_floor() -> float:
    """Return the reflected radiance at (0, 0, 0): Lambert's formula for the irradiance of a polygon, over pi."""
    corners = LAMP / np.linalg.norm(LAMP, axis=1)[:, None]
    edges = [(np.cross(a, b), np.arccos(a @ b)) for a, b in zip(corners, np.roll(corners, -1, axis=0))]
    return 0.5 / np.pi * abs(sum(angle * normal[2] / np.linalg.norm(normal) for normal, angle in edges)) / 2


def z_of_mean(scene: dmis.Scene, exact: float, rule: str, spp: int, sampler: str, seeds: int) -> float:
    """Return by how many standard errors the mean of so many renders is off."""
    means = [
        dmis.render(scene, rule, spp, seed=k, parallel=1, sampler=sampler).image.mean(dtype=float) for k in range(seeds)
    ]
    return (np.mean(means) - exact) / (np.std(means, ddof=1) / np.sqrt(seeds))


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["auto", "counts", "second-moment", "thesis"])
def test_means_agree_with_the_closed_form(rule: str) -> None:
    """Single pixels, strips of odd length and blocks, at budgets that are no powers of two."""
    exact = radiance_of_floor()
    resolutions, samplers = ((1, 1), (2, 1), (1, 3), (5, 3), (16, 1)), ("independent", "sobol")
    for resolution, sampler, spp in product(resolutions, samplers, (24, 50)):
        z = z_of_mean(lit_floor(resolution), exact, rule, spp, sampler, seeds=60)
        assert abs(z) < Z_LIMIT, (resolution, sampler, spp, z)


@pytest.mark.slow
def test_rays_of_a_pixel_do_not_decide_its_samples() -> None:
    """A pixel half of which sees the floor, at budgets where few rays more make half the samples: z 5 if they did."""
    scene = lit_floor((1, 1), fov=30, width=3.75)
    exact = np.mean([dmis.render(scene, "balance", 2**14, seed=k).image.mean(dtype=float) for k in range(4)])
    for spp in (22, 45, 90):
        assert abs(z_of_mean(scene, exact, "auto", spp, "independent", seeds=1500)) < Z_LIMIT
