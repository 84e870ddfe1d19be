"""Pixel filters: samples against profiles, images against convolutions of larger ones, pixels that see nothing."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from helpers import LEVEL, Z_LIMIT, image_tile, pixel_shares, z_score
from scipy.integrate import quad

import dmis
from dmis.estimator.settings import Settings
from dmis.fit.round import Round
from dmis.geometry.shapes import sphere
from dmis.light.area import QuadLight
from dmis.light.environment import EnvironmentLight
from dmis.pipeline.tile import render_tile
from dmis.samplers.pixel_filter import PixelFilter
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.testing.scenes import box_scene
from dmis.testing.sphere import uniforms
from dmis.testing.statistics import chi2_p

FILTERS = {
    "box": PixelFilter("box", (1.2, 0.3)),
    "triangle": PixelFilter("triangle", (2.0, 0.7)),
    "gaussian": PixelFilter("gaussian", (1.5, 2.0), 0.5),
    "cut off": PixelFilter("gaussian", (0.5, 1.0), 3.0),
    "narrow": PixelFilter("gaussian", (2.0, 64.0), 0.01),
}
each_filter = pytest.mark.parametrize("name", FILTERS)


def profile(x: float, filter: PixelFilter, radius: float) -> float:
    """The filter along one axis, not normalised."""
    if abs(x) > radius:
        return 0.0
    if filter.kind == "gaussian":
        return float(np.exp(-(x**2) / (2 * filter.sigma**2)) - np.exp(-(radius**2) / (2 * filter.sigma**2)))
    return 1.0 if filter.kind == "box" else radius - abs(x)


@each_filter
def test_samples_follow_the_filter(name: str) -> None:
    """Chi-square along both axes, and no correlation between them."""
    filter, count = FILTERS[name], 2**16
    offsets = filter.offsets(uniforms(count)).astype(float) - 0.5
    assert (np.abs(offsets) <= np.array(filter.radius)[:, None] * (1 + 1e-6)).all()
    for x, radius in zip(offsets, filter.radius, strict=True):
        reach = min(radius, 4 * filter.sigma) if filter.kind == "gaussian" else radius
        edges = np.concatenate([[-radius], np.linspace(-reach, reach, 33)[1:-1], [radius]])
        mass = np.array([quad(profile, a, b, args=(filter, radius))[0] for a, b in itertools.pairwise(edges)])
        assert chi2_p(np.histogram(x, edges)[0], mass / mass.sum() * count) > LEVEL
    assert abs(np.corrcoef(offsets)[0, 1]) < 4 / np.sqrt(count)


@each_filter
def test_the_ends_of_u_are_finite_and_inside(name: str) -> None:
    u = np.array([[0, 1 - 2**-24, 0.5], [1 - 2**-24, 0, 0.5]], np.float32)
    offsets = FILTERS[name].offsets(u)
    assert offsets.dtype == np.float32 and np.isfinite(offsets).all()
    assert (np.abs(offsets - 0.5) <= np.array(FILTERS[name].radius, np.float32)[:, None] + 1e-6).all()
    np.testing.assert_allclose(offsets[:, 2], 0.5, atol=1e-6)


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "mitchell"}, {"radius": (0, 1)}, {"radius": (1, 65)}, {"radius": 3}, {"radius": (1, "1")},
        {"radius": (1, 1, 1)}, {"sigma": 0}, {"sigma": np.nan}, {"sigma": None},
    ],
)  # fmt: skip
def test_parameters_out_of_range_are_refused(change: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        PixelFilter(**change)


@pytest.mark.parametrize("name", ["box", "gaussian"])
def test_pixels_are_means_of_the_image_around_them(name: str) -> None:
    """An edge across the image: a bright half and a dark one, against the integral of the filter over them."""
    filter = replace(FILTERS[name], radius=(FILTERS[name].radius[0], 1.0))
    camera = Camera(np.eye(4), 1.0, (9, 3), filter=filter)
    light = EnvironmentLight(np.ones((2, 4, 3), np.float32))
    wall = dmis.geometry.shapes.quad(
        (0.0, -9.0, 5.0), (0.0, 18.0, 0.0), (9.0, 0.0, 0.0)
    )  # black, before the right half
    scene = Scene(camera, (Part(wall, dmis.matte(0)),), (light,))
    round_ = Round(64, pixel_shares(0.5), Settings(sampler="independent"))
    images = [render_tile(scene, image_tile(scene, seed, round_)).mean for seed in range(30)]
    radius = filter.radius[0]
    for column in range(9):
        edge = np.clip(4.5 - (column + 0.5), -radius, radius)  # of the wall, from the pixel's middle
        bright, dark = (quad(profile, *ends, args=(filter, radius))[0] for ends in ((-radius, edge), (edge, radius)))
        exact = bright / (bright + dark)
        values = np.array([image[:, column].mean() for image in images])
        if values.std() < 1e-6:  # beside the edge, but for rounding
            assert values[0] == pytest.approx(exact, abs=1e-6)
        else:
            assert abs(z_score(values, exact)) < Z_LIMIT


def test_pixels_within_reach_of_something_are_sampled() -> None:
    """A filter carries the light of a small ball to pixels that its bounds do not touch; those left out are black."""
    box = box_scene(lights=(QuadLight((-1, -1, 3), (0, 2, 0), (2, 0, 0), (1, 1, 1)),))
    masks = []
    for filter in (None, PixelFilter("box", (3.0, 3.0))):
        ball = Part(sphere(0.2, segments=16), dmis.matte())
        scene = Scene(replace(box.camera, filter=filter), (ball,), box.lights)
        assert scene.covered_pixels is not None
        masks.append(scene.covered_pixels)
        whole = replace(scene)
        vars(whole)["covered_pixels"] = None
        np.testing.assert_array_equal(dmis.render(whole, "balance", 256, parallel=1).image[~scene.covered_pixels], 0)
    assert masks[1].sum() > masks[0].sum() and masks[1][masks[0]].all()
