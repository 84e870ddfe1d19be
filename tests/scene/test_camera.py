"""Cameras: field of view, corners, handedness, lenses and other projections, bad input."""

import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, grid_uniforms

import dmis
from dmis.base.vectors import Array, dot
from dmis.geometry.mesh import Mesh
from dmis.geometry.shapes import quad
from dmis.samplers.warp import square_to_disk
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.testing.scenes import box_scene

IDENTITY = np.eye(4)


def ray(camera: Camera, x: float, y: float) -> Array:
    return camera.rays(np.float32([x]), np.float32([y]))[:, 0]


@pytest.mark.parametrize("resolution", [(100, 100), (200, 100), (100, 200), (640, 480), (1, 1), (7, 3)])
@pytest.mark.parametrize("fov", [1.0, 45.0, 90.0, 170.0])
def test_fov_spans_the_shorter_side(resolution: tuple[int, int], fov: float) -> None:
    """The angle between the middles of the two long edges is fov; pixels are square."""
    width, height = resolution
    camera = Camera(IDENTITY, fov, resolution)
    if width >= height:
        a, b = ray(camera, width / 2, 0), ray(camera, width / 2, height)
    else:
        a, b = ray(camera, 0, height / 2), ray(camera, width, height / 2)
    angle = np.degrees(2 * np.arcsin(np.linalg.norm(a.astype(float) - b) / 2))
    assert angle == pytest.approx(fov, rel=1e-5)
    across, down = ray(camera, width / 2 + 0.5, height / 2), ray(camera, width / 2, height / 2 + 0.5)
    # sums of terms up to tan(fov / 2) times the aspect, each rounded at 6e-8 of itself
    assert across[0] / across[2] == pytest.approx(-down[1] / down[2], abs=3e-7 * np.tan(np.radians(fov / 2)))


def test_rays_by_hand() -> None:
    """(0, 0) is the top left: x to the left, y up; the middle looks along z; by hand for 90 degrees at 2:1."""
    camera = Camera(IDENTITY, 90.0, (200, 100))
    for x, y, expected in ((0, 0, (-2, 1, 1)), (200, 0, (2, 1, 1)), (0, 100, (-2, -1, 1)), (100, 50, (0, 0, 1))):
        np.testing.assert_allclose(ray(camera, x, y), np.array(expected) / np.linalg.norm(expected), atol=1e-6)
    # all over the image, for a camera matrix with scale too: its rows are directions, not lengths
    matrix = np.diag([3.0, 3.0, 3.0, 1.0])
    x, y = np.random.default_rng(1).random((2, 1000), dtype=np.float32) * 64
    out = Camera(matrix, 60.0, (64, 64)).rays(x, y)
    assert out.dtype == np.float32 and out.flags.c_contiguous
    np.testing.assert_allclose(dot(out, out), 1, atol=1e-6)
    np.testing.assert_allclose(out, Camera(IDENTITY, 60.0, (64, 64)).rays(x, y), atol=1e-6)
    # a left-handed camera, pbrt's, is allowed: the image is mirrored left to right
    mirrored = Camera(np.diag([-1.0, 1, 1, 1]), 50.0, (10, 8))
    np.testing.assert_allclose(ray(mirrored, 2, 3), ray(Camera(IDENTITY, 50.0, (10, 8)), 8, 3), atol=1e-6)


def test_look_at_is_right_handed() -> None:
    """A photograph: looking north (+y) with z up, east (+x) is on the right and up is up."""
    camera = Camera.look_at((1, -5, 2), (1, 0, 2), (0, 0, 1), 60.0, (100, 100))
    np.testing.assert_allclose(camera.origin[:, 0], (1, -5, 2))
    np.testing.assert_allclose(ray(camera, 50, 50), (0, 1, 0), atol=1e-6)
    assert ray(camera, 99, 50)[0] > 0.3 and ray(camera, 50, 1)[2] > 0.3
    right, up, forward = camera.to_world[:3, :3].T
    np.testing.assert_allclose(np.cross(right, forward), up, atol=1e-12)
    np.testing.assert_allclose(camera.to_world[:3, :3] @ camera.to_world[:3, :3].T, np.eye(3), atol=1e-12)


def test_crop_sees_the_same_rays() -> None:
    """A ray through a crop, and through a crop of a crop, is that of the whole image, corner added."""
    whole = Camera(np.diag([-1.0, 1, 1, 1]), 50.0, (100, 60))
    crop = whole.crop((30, 10, 90, 40))
    inner = crop.crop((0, 5, 7, 6))
    assert crop.resolution == (60, 30) and inner.resolution == (7, 1)
    x, y = np.random.default_rng(2).random((2, 50), dtype=np.float32) * [[7], [1]]
    x, y = x.astype(np.float32), y.astype(np.float32)
    np.testing.assert_allclose(crop.rays(x, y), whole.rays(x + 30, y + 10), atol=3e-7)
    np.testing.assert_allclose(inner.rays(x, y), whole.rays(x + 30, y + 15), atol=3e-7)
    # So that a resolution can be written as JSON, and the same camera has the same hash
    camera = Camera(IDENTITY, 50.0, np.array([8, 6])).crop(np.array([2.0, 1, 4, 5]))  # type: ignore[arg-type]
    assert (camera.resolution, camera.corner, camera.frame) == ((2, 4), (2, 1), (8, 6))
    assert {type(n) for n in (*camera.resolution, *camera.corner, *(camera.frame or ()))} == {int}


@pytest.mark.parametrize("material, warned", [(dmis.glass(), True), (dmis.mirror(), True), (dmis.matte(0.5), False)])
@pytest.mark.parametrize("place", [(0.0, 0.0, 1.0), (0.0, 0.0, 1.6)])
def test_points_of_light_inside_of_glass_are_named(material: dmis.Material, warned: bool, place: Any) -> None:
    """And a spot that shines into it; not a point beside it, nor what is inside of a matte ball."""
    ball = dmis.Part(dmis.SphereLight((0, 0, 1), 0.5, (1, 1, 1)).mesh(), material)
    floor = dmis.Part(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), dmis.matte(0.5))
    lights = dmis.PointLight(place, (1, 1, 1)), dmis.SpotLight(place, (0, 0, -1), (1, 1, 1))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dmis.Scene(PLACE, (floor, ball), lights).prepare()
    named = [re.search(r"only smooth glass and mirrors are around a (\w+)", str(w.message)) for w in caught]
    assert [match[1] for match in named if match] == ["PointLight", "SpotLight"][place[2] > 1 :] * warned


# A lens, and other projections ------------------------------------------------------------------------------------

PLACE = Camera.look_at((1, -3, 2), (0, 0, 0.5), fov=50, resolution=(8, 8))
LENS = replace(PLACE, lens_radius=0.3, focal_distance=2.5)


def spread(camera: Camera, count: int = 64) -> tuple[Array, Array, Array]:
    """Origins and directions through one raster point, ``(3, N)`` each, and the raster point."""
    u = np.random.default_rng(3).random((2, count), np.float32)
    x, y = np.full(count, 5.25, np.float32), np.full(count, 1.75, np.float32)
    return *camera.lens_rays(x, y, u), np.array([x[0], y[0]])


def test_rays_of_a_lens_meet_at_the_focal_distance() -> None:
    origin, direction, raster = spread(LENS)
    inverse = np.linalg.inv(np.asarray(LENS.to_world))
    local, along = inverse[:3, :3] @ origin + inverse[:3, 3:], inverse[:3, :3] @ direction
    np.testing.assert_allclose(local[2], 0, atol=1e-6)
    assert 0.25 < np.hypot(*local[:2]).max() <= 0.3 + 1e-6 and np.abs(local.mean(axis=1)).max() < 0.08
    focus = local + along * (2.5 - local[2]) / along[2]
    np.testing.assert_allclose(focus, np.repeat(focus[:, :1], 64, axis=1), atol=2e-6)
    middle = ray(PLACE, *raster)
    np.testing.assert_allclose(inverse[:3, :3] @ middle, focus[:, 0] / np.linalg.norm(focus[:, 0]), atol=1e-6)


def test_a_lens_is_the_mean_of_pinholes() -> None:
    """The image of a lens is the mean of those of pinholes on it, each sheared so that the focal plane stays."""
    scene = box_scene(extra=(Part(quad((-0.6, -0.5, 0.5), (0.5, 0, 0), (0, 0.3, 0.4)), dmis.matte((0.9, 0.2, 0.1))),))
    options: dict[str, Any] = {"integrator": "direct", "parallel": 1}
    lens = dmis.render(replace(scene, camera=LENS), "balance", 512, seed=1, **options)
    right, up, forward, eye = np.asarray(PLACE.to_world)[:3].T
    images, variances = [], []
    for k, (x, y) in enumerate(square_to_disk(grid_uniforms(9, np.float32, 0.5 / 9, 1 - 0.5 / 9)).T * 0.3):
        matrix = np.eye(4)
        offset = x * right + y * up
        matrix[:3] = np.stack([right, up, forward - offset / 2.5, eye + offset], axis=1)
        result = dmis.render(replace(scene, camera=replace(PLACE, to_world=matrix)), "balance", 8, seed=k, **options)
        images.append(result.image)
        variances.append(result.variance)
    error = np.sqrt((lens.variance.mean() + np.mean(variances) / len(images)) / lens.image[..., 0].size)
    assert abs(lens.image.mean() - np.mean(images)) < Z_LIMIT * error
    sharp = dmis.render(replace(scene, camera=PLACE), "balance", 64, **options).image
    blurred = np.abs(lens.image - np.mean(images, axis=0)).mean()
    assert blurred < 0.5 * np.abs(lens.image - sharp).mean()


def test_rays_of_other_projections() -> None:
    camera = replace(PLACE, projection="orthographic", fov=90.0, resolution=(8, 4))
    x, y = np.float32([0, 8, 4, 1.5]), np.float32([0, 4, 2, 3])
    origin, direction = camera.lens_rays(x, y)
    right, up, forward, eye = np.asarray(camera.to_world)[:3].T
    expected = eye + np.outer(x / 2 - 2, right) + np.outer(1 - y / 2, up)
    np.testing.assert_allclose(origin.T, expected, atol=1e-6)
    np.testing.assert_allclose(direction, np.repeat(forward[:, None], 4, axis=1), atol=1e-6)
    part = camera.crop((2, 1, 6, 3))
    np.testing.assert_allclose(part.lens_rays(x, y)[0], camera.lens_rays(x + 2, y + 1)[0], atol=1e-6)
    # spherical rays go all around
    camera = replace(PLACE, projection="spherical", resolution=(8, 4))
    right, up, forward, eye = np.asarray(camera.to_world)[:3].T
    x, y, axes = np.float32([0, 2, 4, 6, 3]), np.float32([2, 2, 2, 2, 0]), [right, forward, -right, -forward, up]
    origin, direction = camera.lens_rays(x, y)
    np.testing.assert_allclose(direction.T, axes, atol=1e-6)
    np.testing.assert_allclose(origin, np.repeat(eye[:, None], 5, axis=1), atol=1e-6)
    np.testing.assert_allclose(
        camera.crop((3, 1, 8, 4)).lens_rays(x, y)[1], camera.lens_rays(x + 3, y + 1)[1], atol=1e-6
    )


def test_other_cameras_see_all_pixels_and_are_rescaled() -> None:
    """Coverage and headlights are of a pinhole; far from the origin and in other units the image stays the same."""
    lamp = dmis.PointLight(tuple(np.asarray(PLACE.to_world)[:3, 3].tolist()), (5, 5, 5))
    for camera in (LENS, replace(PLACE, projection="orthographic"), replace(PLACE, projection="spherical")):
        scene = replace(box_scene(lights=(lamp,)), camera=camera)
        assert scene.covered_pixels is None and not scene.plan.headlights
        large = np.diag([1e8, 1e8, 1e8, 1]) @ np.asarray(camera.to_world)
        parts = tuple(replace(p, mesh=Mesh(p.mesh.vertices * 1e8, p.mesh.faces, None, p.mesh.uv)) for p in scene.parts)
        light = dmis.PointLight(tuple(large[:3, 3].tolist()), (5e16,) * 3)
        far = replace(scene, camera=replace(camera, to_world=large), parts=parts, lights=(light,))
        images = [dmis.render(one, "balance", 4, seed=1, integrator="direct", parallel=1).image for one in (scene, far)]
        np.testing.assert_allclose(images[1], images[0], rtol=2e-2, atol=1e-3)


MATRIX, FOV = "to_world must be a finite invertible 4x4", "fov must be between 0 and 180"
SIZE, WINDOW = "resolution must be ", r"a window must be \(x0, y0, x1, y1\) in pixels with 0 <= x0 < x1 <= 100 "
WIDE = Camera(IDENTITY, 50.0, (100, 60))


@pytest.mark.parametrize(
    "make, arguments, message",
    [
        *((Camera, (matrix, 45, (4, 4)), MATRIX) for matrix in (np.eye(3), IDENTITY * np.nan, np.zeros((4, 4)))),
        (Camera, (np.diag([1, 1, 1e19, 1]), 45, (4, 4)), r"to_world must not have elements above 1e\+18"),
        *((Camera, (IDENTITY, fov, (4, 4)), FOV) for fov in (0, 180, np.nan)),
        *((Camera, (IDENTITY, 45, size), SIZE) for size in ((0, 4), (70000, 1), (65535, 65535), (6.5, 5), 5)),
        (Camera, (IDENTITY, 50.0, (4, 4), (8, 0), (10, 10)), "a crop must lie inside its frame of 10x10"),
        (Camera.look_at, ((0, np.nan, 0), (0, 0, 1), (0, 1, 0)), "eye must be three finite numbers"),
        *((WIDE.crop, (window,), WINDOW) for window in ((0, 0, 1, 61), (0, 5, 1, 5), (-1, 0, 3, 1), (99, 0, 101, 1))),
        *((WIDE.crop, (window,), WINDOW) for window in ((0, 0, 2.5, 2), (0, 0, 2, np.nan), 2)),
        (WIDE.crop, ((0, 8), (0, 8)), WINDOW),
        (partial(WIDE.crop, rows=(0, 8), columns=(0, 8)), (), WINDOW),
        (partial(replace, PLACE, projection="fisheye"), (), "projection must be .* or spherical; got 'fisheye'"),
        (partial(replace, PLACE, lens_radius=-1), (), "lens_radius must be a number"),
        (partial(replace, LENS, focal_distance=0), (), "focal_distance must be a number"),
        (partial(replace, LENS, projection="spherical"), (), "lens_radius must be 0 for a spherical camera"),
        (LENS.rays, np.zeros((2, 1), np.float32), "rays needs a pinhole; lens_rays returns"),
    ],
)
def test_what_is_no_camera_is_refused(make: Callable[..., Any], arguments: Any, message: str) -> None:
    """The message names the argument, the constraint and the value."""
    with pytest.raises(ValueError, match=message):
        make(*arguments)
