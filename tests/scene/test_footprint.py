"""Footprints: steps against neighbouring rays, and images that a filter must not change on average."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT

import dmis
from dmis.geometry.shapes import quad
from dmis.scene.camera import Camera
from dmis.scene.footprint import texture_steps
from dmis.scene.groups import Part
from dmis.scene.scene import Scene

CHECKS = (np.indices((64, 64)).sum(axis=0) % 2).astype(np.float32)[..., None]


def floor_scene(**camera: Any) -> Scene:
    """A large checked floor under an even sky, seen at a slant."""
    part = Part(quad((-20, -20, 0), (40, 0, 0), (0, 40, 0)), dmis.matte(dmis.Image(CHECKS, scale=(9.0, 15.0))))
    view = Camera.look_at((0, -6, 2), (0, 2, 0), fov=50, resolution=(24, 20))
    return Scene(replace(view, **camera), [part], [dmis.EnvironmentLight(np.ones((4, 8, 3)))])


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_steps_are_those_to_the_rays_of_a_pixel_beside(projection: Any) -> None:
    """Steps of 0.01 pixels against hits of the plane z = 0 half a pixel away, to 10 %; u and v are sheared."""
    camera = replace(floor_scene().camera, projection=projection, texture_filter=0.01)
    x, y = (np.float32(a.ravel()) for a in np.meshgrid(np.arange(1.0, 24, 5), np.arange(14.0, 20)))

    def at(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        origin, direction = (a.astype(float) for a in camera.lens_rays(x, y))
        return origin - direction * (origin[2] / direction[2])

    p, normal = at(x, y).astype(np.float32), np.repeat(np.float32([[0], [0], [1]]), len(x), axis=1)
    dpdu, dpdv = (np.repeat(np.float32(v).reshape(3, 1), len(x), axis=1) for v in ((2, 0, 0), (1, 3, 0)))
    got = texture_steps(camera, p, normal, dpdu, dpdv)
    for step, beside in zip(got, (at(x + 0.5, y), at(x, y + 0.5)), strict=True):
        moved = np.stack([dpdu, dpdv])[..., 0].T[:2] @ step
        np.testing.assert_allclose(moved, (beside - p)[:2] * 0.02, rtol=0.1, atol=2e-4)


def test_filtered_images_are_right_on_average_and_less_noisy() -> None:
    """Checks smaller than pixels become grey: the mean is the same, the variance a fifth at most."""
    sharp, smooth = (
        [dmis.render(floor_scene(texture_filter=f), "balance", 4, seed=k).image[10:] for k in range(12)]
        for f in (0.0, 1.0)
    )
    means = [np.mean(images, axis=(1, 2, 3)) for images in (sharp, smooth)]
    difference = means[0].mean() - means[1].mean()
    assert abs(difference) <= Z_LIMIT * np.hypot(*(m.std(ddof=1) / np.sqrt(len(m)) for m in means))
    assert np.var(smooth, axis=0).mean() < np.var(sharp, axis=0).mean() / 5


def test_without_a_filter_nothing_changes() -> None:
    """A scene without images has the same bits with a filter; so has one seen in a mirror by camera rays alone."""
    plain = floor_scene()
    plain = replace(plain, parts=[replace(plain.parts[0], material=dmis.matte(0.5))])
    filtered = replace(plain, camera=replace(plain.camera, texture_filter=1.0))
    np.testing.assert_array_equal(*(dmis.render(scene, "balance", 4).image for scene in (plain, filtered)))


def test_a_spherical_camera_has_no_filter() -> None:
    with pytest.raises(ValueError, match="texture_filter must be 0 for a spherical camera; got 1"):
        replace(floor_scene().camera, projection="spherical", texture_filter=1.0)
