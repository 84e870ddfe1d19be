"""The pinhole camera: field of view, corners, handedness, bad input."""

import warnings
from typing import Any

import numpy as np
import pytest

import dmis
from dmis.base.vectors import Array, dot
from dmis.geometry.shapes import quad
from dmis.scene.camera import Camera

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


def test_corners() -> None:
    """(0, 0) is the top left: x to the left, y up; the middle looks along z; by hand for 90 degrees at 2:1."""
    camera = Camera(IDENTITY, 90.0, (200, 100))
    for x, y, expected in ((0, 0, (-2, 1, 1)), (200, 0, (2, 1, 1)), (0, 100, (-2, -1, 1)), (100, 50, (0, 0, 1))):
        np.testing.assert_allclose(ray(camera, x, y), np.array(expected) / np.linalg.norm(expected), atol=1e-6)


def test_rays_are_unit_and_float32() -> None:
    """All over the image, for a camera matrix with scale too: its rows are directions, not lengths."""
    matrix = np.diag([3.0, 3.0, 3.0, 1.0])
    x, y = np.random.default_rng(1).random((2, 1000), dtype=np.float32) * 64
    out = Camera(matrix, 60.0, (64, 64)).rays(x, y)
    assert out.dtype == np.float32 and out.flags.c_contiguous
    np.testing.assert_allclose(dot(out, out), 1, atol=1e-6)
    np.testing.assert_allclose(out, Camera(IDENTITY, 60.0, (64, 64)).rays(x, y), atol=1e-6)


def test_look_at_is_right_handed() -> None:
    """A photograph: looking north (+y) with z up, east (+x) is on the right and up is up."""
    camera = Camera.look_at((1, -5, 2), (1, 0, 2), (0, 0, 1), 60.0, (100, 100))
    np.testing.assert_allclose(camera.origin[:, 0], (1, -5, 2))
    np.testing.assert_allclose(ray(camera, 50, 50), (0, 1, 0), atol=1e-6)
    assert ray(camera, 99, 50)[0] > 0.3 and ray(camera, 50, 1)[2] > 0.3
    right, up, forward = camera.to_world[:3, :3].T
    np.testing.assert_allclose(np.cross(right, forward), up, atol=1e-12)
    np.testing.assert_allclose(camera.to_world[:3, :3] @ camera.to_world[:3, :3].T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    "eye, target, up", [((1, 2, 3), (4, -1, 0.5), (0.2, 0.1, 1)), ((0, 0, 1e-6), (0, 1e-7, 0), (0, 1, 0))]
)
def test_look_at_centres_its_target(eye: Any, target: Any, up: Any) -> None:
    """The middle of the image is the target, for tilted ups and for tiny scenes."""
    camera = Camera.look_at(eye, target, up, resolution=(31, 17))
    to = np.subtract(target, eye)
    np.testing.assert_allclose(ray(camera, 15.5, 8.5), to / np.linalg.norm(to), atol=1e-6)


def test_mirrored_matrix_mirrors_the_image() -> None:
    """A left-handed camera, pbrt's, is allowed: the image is mirrored left to right."""
    mirrored = Camera(np.diag([-1.0, 1, 1, 1]), 50.0, (10, 8))
    np.testing.assert_allclose(ray(mirrored, 2, 3), ray(Camera(IDENTITY, 50.0, (10, 8)), 8, 3), atol=1e-6)


@pytest.mark.parametrize(
    "to_world, fov, resolution, message",
    [
        (np.eye(3), 45, (4, 4), "to_world must be a finite invertible 4x4"),
        (np.full((4, 4), np.nan), 45, (4, 4), "to_world must be a finite"),
        (np.zeros((4, 4)), 45, (4, 4), "to_world must be a finite invertible"),
        (IDENTITY, 0, (4, 4), "fov must be between 0 and 180"),
        (IDENTITY, 180, (4, 4), "fov must be between 0 and 180"),
        (IDENTITY, np.nan, (4, 4), "fov must be between 0 and 180"),
        (IDENTITY, -10, (4, 4), "fov must be between 0 and 180"),
        (IDENTITY, 45, (0, 4), "resolution must be 1 to 65535"),
        (IDENTITY, 45, (4, -1), "resolution must be 1 to 65535"),
        (IDENTITY, 45, (70000, 1), "resolution must be 1 to 65535"),
        (IDENTITY, 45, (65535, 65535), "resolution must be"),
        (IDENTITY, 45, (6.5, 5), "resolution must be a whole number; got 6.5"),
        (IDENTITY, 45, ("6", 5), "resolution must be a whole number; got '6'"),
        (IDENTITY, 45, 5, "resolution must be two numbers; got 5"),
        (IDENTITY, 45, (5, 5, 3), "resolution must be two numbers"),
    ],
)
def test_bad_cameras(to_world: Array, fov: float, resolution: tuple[int, int], message: str) -> None:
    """Errors name the argument, the constraint and the value."""
    with pytest.raises(ValueError, match=message):
        Camera(to_world, fov, resolution)


@pytest.mark.parametrize(
    "eye, target, up, message",
    [
        ((0, 0, 0), (0, 0, 1), (0, 0, 2), "up must not be parallel"),
        ((1, 1, 1), (1, 1, 1), (0, 0, 1), r"eye and target must differ, .*; got \(1, 1, 1\)"),
        ((0, np.nan, 0), (0, 0, 1), (0, 1, 0), "eye must be three finite numbers"),
        ((0, 0, 0), (0, 0, np.nan), (0, 1, 0), "target must be three finite numbers"),
        ((0, 0, 0), (0, 0, 1), (0, np.inf, 0), "up must be three finite numbers"),
        ((0, 0, 0), (0, 0, 1), (0, 0, 0), "up must not be zero"),
    ],
)
def test_look_at_without_a_direction(eye: Any, target: Any, up: Any, message: str) -> None:
    """`up` along the line of sight, no line of sight at all, or numbers that are none."""
    with pytest.raises(ValueError, match=message):
        Camera.look_at(eye, target, up)


def test_numbers_of_numpy_become_pythons() -> None:
    """So that a resolution can be written as JSON, and the same camera has the same hash."""
    camera = Camera(IDENTITY, 50.0, np.array([8, 6])).crop(np.array([1, 5]), (np.int64(2), 4.0))  # type: ignore[arg-type]
    assert (camera.resolution, camera.corner, camera.frame) == ((2, 4), (2, 1), (8, 6))
    assert {type(n) for n in (*camera.resolution, *camera.corner, *(camera.frame or ()))} == {int}


def test_crop_sees_the_same_rays() -> None:
    """A ray through a crop, and through a crop of a crop, is that of the whole image, corner added."""
    whole = Camera(np.diag([-1.0, 1, 1, 1]), 50.0, (100, 60))
    crop = whole.crop((10, 40), (30, 90))
    inner = crop.crop((5, 6), (0, 7))
    assert crop.resolution == (60, 30) and inner.resolution == (7, 1)
    x, y = np.random.default_rng(2).random((2, 50), dtype=np.float32) * [[7], [1]]
    x, y = x.astype(np.float32), y.astype(np.float32)
    np.testing.assert_allclose(crop.rays(x, y), whole.rays(x + 30, y + 10), atol=3e-7)
    np.testing.assert_allclose(inner.rays(x, y), whole.rays(x + 30, y + 15), atol=3e-7)


@pytest.mark.parametrize("rows, columns", [((0, 61), (0, 1)), ((5, 5), (0, 1)), ((0, 1), (-1, 3)), ((0, 1), (99, 101))])
def test_bad_crops(rows: tuple[int, int], columns: tuple[int, int]) -> None:
    """A crop has pixels and lies inside."""
    with pytest.raises(ValueError, match="a crop must have pixels and lie inside the image of 100x60"):
        Camera(IDENTITY, 50.0, (100, 60)).crop(rows, columns)


@pytest.mark.parametrize(
    "rows, columns, message",
    [
        ((0, 2.5), (0, 2), "rows must be a whole number; got 2.5"),
        ((0, 2), (0, np.nan), "columns must be a whole number; got nan"),
        (2, (0, 2), "rows must be two numbers; got 2"),
    ],
)
def test_crops_that_are_none(rows: Any, columns: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Camera(IDENTITY, 50.0, (100, 60)).crop(rows, columns)


def test_bad_frame() -> None:
    """A camera made by hand with a corner outside its frame is refused."""
    with pytest.raises(ValueError, match="a crop must lie inside its frame of 10x10"):
        Camera(IDENTITY, 50.0, (4, 4), (8, 0), (10, 10))


def test_a_camera_on_a_surface_is_named() -> None:
    """It sees that surface alone; a little above it no warning."""
    floor = dmis.Part(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), dmis.matte(0.5))
    lamp = dmis.QuadLight((-0.5, -0.5, 3), (0, 1, 0), (1, 0, 0), (1, 1, 1))
    for height, warned in ((0.0, True), (0.01, False)):
        camera = dmis.Camera.look_at((0, 0, height), (1, 0, height), fov=60, resolution=(8, 8))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            dmis.Scene(camera, (floor,), (lamp,)).prepare()
        assert any("camera is on a surface" in str(w.message) for w in caught) == warned
