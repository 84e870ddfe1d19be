"""A camera that stands on a surface sees what is beyond it, as in pbrt: a hit at distance 0 is no hit."""

import numpy as np
import pytest
import scipy.stats
from helpers import LEVEL, z_score

import dmis
from dmis.base.vectors import Array
from dmis.geometry.shapes import quad
from dmis.scene.groups import Part
from dmis.scene.pinhole import offsets, ray_origins
from dmis.scene.scene import Scene
from dmis.testing.scenes import box_scene

TURN = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
WALLS = (
    ((-2, -2, 0), (4, 0, 0), (0, 4, 0)),
    ((-2, -2, 4), (0, 4, 0), (4, 0, 0)),
    ((-2, -2, 0), (0, 0, 4), (4, 0, 0)),
    ((-2, 2, 0), (4, 0, 0), (0, 0, 4)),
    ((-2, -2, 0), (0, 4, 0), (0, 0, 4)),
    ((2, -2, 0), (0, 0, 4), (0, 4, 0)),
)
"""A room 4 on a side, about (0, 0, 2)."""
PLACES = {
    "origin": (0, 0, 0),
    "floor": (0.3, 0.2, 0),
    "wall": (-2, 0.3, 0.7),
    "edge": (-2, 0.3, 0),
    "corner": (-2, -2, 0),
}
"""On the edge of two triangles; within one; on a wall; where two walls meet; where three do."""


def room(
    eye: Array, target: Array, turned: bool = False, shift: float = 0.0, lamp: dmis.light.light.Light | None = None
) -> Scene:
    """The room, turned and moved, under a point light."""
    matrix = np.eye(4)
    matrix[:3, :3] = TURN if turned else np.eye(3)
    matrix[:3, 3] = shift

    def world(p: Array) -> tuple[float, float, float]:
        x, y, z = matrix[:3, :3] @ np.asarray(p, float) + shift
        return float(x), float(y), float(z)

    parts = tuple(Part(quad(*wall).transformed(matrix), dmis.matte(0.5)) for wall in WALLS)
    up = tuple((matrix[:3, :3] @ (0.1, 0.2, 1.0)).tolist())
    camera = dmis.Camera.look_at(world(eye), world(target), up, fov=50, resolution=(16, 16))
    return Scene(camera, parts, (lamp or dmis.PointLight(world((0, 0, 2.6)), (5, 5, 5)),))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("shift", [0.0, 3.0, 12.0])
def test_a_camera_on_a_surface_sees_the_room(place: str, turned: bool, shift: float) -> None:
    """The image is that of a camera 1e-4 further inside, and no pixel is black.

    The same rays from a point 1e-4 away: a wall at the distance 1 or more moves by 1e-4 of a radian, and so does the
    cosine; 1 % of difference in a pixel is an edge of the room that passes through it.
    """
    eye = np.array(PLACES[place], float)
    inwards = np.array([0.1, 0.05, 2.0]) - eye
    images = [
        dmis.render(room(at, at + inwards, turned, shift), "balance", 4, seed=1, parallel=1).image
        for at in (eye, eye + 1e-4 * inwards)
    ]
    assert images[0].min() > 0
    assert images[0].mean() == pytest.approx(images[1].mean(), rel=1e-3)
    assert (np.abs(images[0] / images[1] - 1) > 1e-2).mean() < 0.05


def test_rays_leave_to_both_sides() -> None:
    """From a floor half of a wide view goes up, where there is a lamp, and half down, where there is another one."""
    floor = quad((-4, -4, 0), (8, 0, 0), (0, 8, 0))
    lamps = (
        dmis.QuadLight((-50, -50, 3), (0, 100, 0), (100, 0, 0), (7, 7, 7)),
        dmis.QuadLight((-50, -50, -3), (100, 0, 0), (0, 100, 0), (2, 2, 2)),
    )
    camera = dmis.Camera.look_at((0.3, 0.2, 0), (1.3, 0.2, 0), fov=120, resolution=(8, 8))
    parts = (Part(floor, dmis.matte(0.5)), *(dmis.light_part(lamp) for lamp in lamps))
    image = dmis.render(Scene(camera, parts, lamps), "balance", 4).image
    np.testing.assert_array_equal(image[:3], 7)  # rays of the rows between them pass beside the lamps
    np.testing.assert_array_equal(image[5:], 2)


def test_rules_agree() -> None:
    """Of a room lit by a lamp, from its floor: BRDF samples, light samples and both have one mean."""
    lamp = dmis.QuadLight((-0.5, -0.5, 3.9), (0, 1, 0), (1, 0, 0), (5, 4, 3))
    scene = room(np.array([0.3, 0.2, 0]), np.array([0.1, 0.9, 1.0]), lamp=lamp)
    means = {
        rule: [dmis.render(scene, rule, 64, seed=seed, parallel=1).image.mean(dtype=float) for seed in range(8)]
        for rule in ("fixed:0", "balance", "fixed:1")
    }
    assert min(means["balance"]) > 0
    for rule in ("fixed:0", "fixed:1"):
        assert abs(z_score(means[rule], means["balance"])) < scipy.stats.t.isf(LEVEL / 2, 14)


@pytest.mark.parametrize("height", [1e-6, -1e-6, 1e-3])
def test_a_camera_above_a_surface_is_not_moved(height: float) -> None:
    """A floor through 0 has no rounding: however near, the camera is above it or below it, and sees it so."""
    scene = box_scene(eye=(0.3, 0.2, height), target=(0.9, 0.9, -1.0))
    assert scene.plan.pinhole_offsets.shape == (0, 3) and "the camera lies" not in scene.describe()
    direction = scene.camera.rays(np.float32([3, 5, 9]), np.float32([2, 7, 11]))
    np.testing.assert_array_equal(
        ray_origins(scene.camera.origin, scene.plan.pinhole_offsets, direction),
        np.repeat(scene.camera.origin, 3, axis=1),
    )


@pytest.mark.parametrize("size", [1.0, 1e4])
def test_offsets_are_units_in_the_last_place(size: float) -> None:
    """Of the coordinates of camera and triangle along the normal: 8 of them, however large the floor is.

    A floor at height 3 along the axes: n = z, |o| = 3, and v - o is 0 along z: 2 * 4 * 2^-24 * 3.
    """
    floor = quad((-size, -0.9 * size, 3), (2 * size, 0, 0), (0, 2 * size, 0))
    np.testing.assert_allclose(offsets(np.array([0.3, 0.2, 3.0]), [floor]), [[0, 0, 24 * 2.0**-24]], rtol=1e-6)
    assert len(offsets(np.array([2.1 * size, 0.2, 3.0]), [floor])) == 0, "in the plane, beside the floor"


def test_planes_count_once() -> None:
    """A point on the edge of two triangles of one plane is off it by one offset; in a corner there are three planes."""
    eyes = [np.array(place, float) for place in PLACES.values()]
    scenes = [room(eye, np.array([0.1, 0.05, 2.0]), turned=True) for eye in eyes]
    assert [len(scene.plan.pinhole_offsets) for scene in scenes] == [1, 1, 1, 2, 3]
    assert all("the camera lies in the plane of triangles around it" in scene.describe() for scene in scenes)
