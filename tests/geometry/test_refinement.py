"""Huge triangles beside small bodies: split without a gap, and shadows are what they are on a small ground."""

import numpy as np
import pytest

import dmis
from dmis.geometry.mesh import Mesh
from dmis.geometry.refinement import MAX_DIAGONALS, SMALL_RATIO, bodies, diagonals, refine_near_bodies
from dmis.geometry.shapes import quad, sphere
from dmis.geometry.transforms import translate
from dmis.scene.groups import Part
from dmis.scene.rescale import RAY_OFFSET
from dmis.scene.scene import Scene, SceneWarning
from dmis.testing.scenes import FLOOR

TURN = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
RADIUS = 1.0
SMALL = 100.0
"""Half of a side of a ground whose offset is small beside the sphere: less than 3e-4."""


def ball_on_ground(
    extent: float, turned: bool = False, joined: bool = False, at: tuple[float, ...] = (0, 0, 0)
) -> Scene:
    """A sphere on a square ground of +-`extent`, which is not centred on it, under a lamp; from 6 away."""
    matrix = np.eye(4)
    matrix[:3, :3] = TURN if turned else np.eye(3)
    matrix[:3, 3] = at

    def vector(v: tuple[float, ...]) -> tuple[float, float, float]:
        x, y, z = matrix[:3, :3] @ v
        return float(x), float(y), float(z)

    def point(p: tuple[float, ...]) -> tuple[float, float, float]:
        x, y, z = vector(p) + matrix[:3, 3]
        return float(x), float(y), float(z)

    ground = quad((-0.9 * extent, -extent, 0), (2 * extent, 0, 0), (0, 2 * extent, 0)).transformed(matrix)
    ball = sphere(RADIUS, segments=64).transformed(matrix @ translate((0, 0, RADIUS)))
    meshes = [Mesh(mesh.vertices, mesh.faces) for mesh in (ground, ball)]
    if joined:
        meshes = [dmis.geometry.mesh.concatenate(meshes)]
    lamp = dmis.QuadLight(point((-3, -1, 5)), vector((0, 2, 0)), vector((2, 0, 0)), (10, 10, 10))
    # downwards, so that no ray passes over the ground's far end
    camera = dmis.Camera.look_at(
        point((1, -4, 5)), point((0.5, 0, 0.3)), vector((0, 0, 1)), fov=30, resolution=(16, 16)
    )
    return Scene(camera, tuple(Part(mesh, dmis.matte(0.5)) for mesh in meshes), (lamp,))


def test_the_same_samples_give_the_same_image() -> None:
    """Grounds of 10^2 and more differ by rounding alone, in one mesh with the sphere or not, and wherever it is."""
    grounds = (1e2, False), (1e4, False), (1e5, True), (1e7, False), (1e7, True)
    scenes = [ball_on_ground(extent, True, joined) for extent, joined in grounds]
    scenes.append(ball_on_ground(1e7, True, at=(3e6, -2e6, 4e6)))
    images = [dmis.render(scene, "balance", 16, seed=1).image for scene in scenes]
    for image in images[1:]:
        assert np.sqrt(((image - images[0]) ** 2).mean()) < 2e-3 * images[0].mean()


@pytest.mark.parametrize("power", [3, 7])
def test_the_surface_stays(power: int) -> None:
    """Its area, side, texture coordinates and normals; at bodies triangles are fine, and none exceeds its distance."""
    extent = 10.0**power
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * extent
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]), np.tile([0.0, 0, 1], (4, 1)), vertices[:, :2] / extent)
    boxes = np.array([[[-1, -1, 0], [1, 1, 2]], [[0.3 * extent, 0, 0], [0.3 * extent + 1, 2, 1]]])
    fine = refine_near_bodies(mesh, boxes)
    assert mesh.triangles < fine.triangles < 5000
    corners = fine.vertices[fine.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (cross[:, 2] > 0).all() and cross[:, 2].sum() / 2 == pytest.approx(4 * extent**2, rel=1e-12)
    np.testing.assert_allclose(fine.uv, fine.vertices[:, :2] / extent, atol=1e-12)
    np.testing.assert_array_equal(fine.normals, np.tile([0.0, 0, 1], (len(fine.vertices), 1)))
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    for box, diagonal in zip(boxes, diagonals(boxes), strict=True):
        gap = np.maximum(np.maximum(box[0] - corners.max(axis=1), corners.min(axis=1) - box[1]), 0)
        assert (size <= np.maximum(MAX_DIAGONALS * diagonal, np.linalg.norm(gap, axis=1))).all()


def test_ordinary_scenes_are_not_touched() -> None:
    """A body of more than 1 / `SMALL_RATIO` of the scene: the same scene, the same offsets."""
    side = np.sqrt(2) * SMALL * 2 / SMALL_RATIO
    for scene in (ball_on_ground(SMALL), ball_on_ground(SMALL, joined=True)):
        assert scene.in_float32[0] is scene and scene.epsilon.ndim == 0
    assert np.sqrt(12) * RADIUS > side
    mesh = FLOOR
    assert refine_near_bodies(mesh, bodies(mesh)) is mesh
    # A ground and a sphere in one mesh are two bodies, by what shares corners; alone a mesh is one, whatever it is
    (part,) = ball_on_ground(1e4, joined=True).parts
    boxes = bodies(part.mesh)
    np.testing.assert_allclose(sorted(diagonals(boxes)), [np.sqrt(12), np.sqrt(8) * 1e4], rtol=1e-2)
    assert bodies(ball_on_ground(1e4).parts[1].mesh).shape == (1, 2, 3)


def test_offsets_follow_the_triangles() -> None:
    """Rays begin 1e-6 of the larger of a triangle's size and coordinates above it, on the sphere of the sphere's."""
    scene = ball_on_ground(1e5).in_float32[0]
    ground, ball = (part.mesh for part in scene.parts)
    epsilon = scene.epsilon
    corners = ground.vertices[ground.faces]
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    reach = np.maximum(size, np.abs(corners).max(axis=(1, 2)))
    np.testing.assert_allclose(epsilon[: ground.triangles], RAY_OFFSET * reach, rtol=1e-6)
    np.testing.assert_allclose(epsilon[ground.triangles :], RAY_OFFSET * np.sqrt(12) * RADIUS, rtol=1e-2)
    nearest = np.abs(corners).max(axis=2).min(axis=1).argmin()
    assert epsilon[nearest] < 3e-4 * RADIUS and epsilon.max() <= RAY_OFFSET * np.sqrt(8) * 1e5
    assert ball.triangles == len(epsilon) - ground.triangles


def test_a_lamp_at_the_camera_is_one_that_is_there() -> None:
    """On a large ground a point light a fifth away from the camera has shadows of its own."""
    scene = ball_on_ground(1e7)
    eye = scene.camera.origin[:, 0] + np.float32([0.2, 0, 0])
    lamp = dmis.PointLight((float(eye[0]), float(eye[1]), float(eye[2])), (5, 5, 5))
    assert not Scene(scene.camera, scene.parts, (lamp,)).plan.headlights


def test_what_float32_does_not_resolve_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two spheres, each of 1e-6 of their distance: wherever the origin is, one has no digits left for its shadow.

    And a ground that would have to be split into more triangles than there may be.
    """
    scene = ball_on_ground(1e7)
    other = sphere(RADIUS, segments=16).transformed(translate((3e6, 0, RADIUS)))
    two = Scene(scene.camera, (*scene.parts, Part(other, dmis.matte(0.5))), scene.lights)
    with pytest.warns(SceneWarning, match=r"scene: rays begin 0\.87 times the size of a body off .* \(part 2\)"):
        two.in_float32[0].prepare()
    scene.in_float32[0].prepare()
    monkeypatch.setattr("dmis.geometry.refinement.MAX_SPLIT_TRIANGLES", 20)
    with pytest.warns(SceneWarning, match=r"rays begin .* the size of a body off the surfaces around it \(part 1\)"):
        dmis.render(ball_on_ground(1e6), "balance", 1)
