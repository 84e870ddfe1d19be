"""Bodies of meshes, and the warning of a scene beside whose smallest body rays begin too far off."""

import warnings

import numpy as np
import pytest

import dmis
from dmis.geometry.bodies import bodies
from dmis.geometry.mesh import Mesh, concatenate
from dmis.geometry.shapes import quad, sphere
from dmis.geometry.transforms import translate
from dmis.scene.groups import Part
from dmis.scene.scene import Scene, SceneWarning


def meshes(extent: float) -> list[Mesh]:
    """A ground of +-`extent`, and a sphere of radius 1 on it."""
    ground, ball = quad((-extent, -extent, 0), (2 * extent, 0, 0), (0, 2 * extent, 0)), sphere(1.0, segments=32)
    return [Mesh(mesh.vertices, mesh.faces) for mesh in (ground, ball.transformed(translate((0, 0, 1))))]


def test_bodies_of_a_joined_mesh() -> None:
    """A ground and a sphere in one mesh are two bodies, by what shares corners; alone a mesh is one, whatever it is."""
    boxes = bodies(concatenate(meshes(1e4)))
    diagonals = np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1)
    np.testing.assert_allclose(sorted(diagonals), [np.sqrt(12), np.sqrt(8) * 1e4], rtol=1e-2)
    assert bodies(meshes(1e4)[1]).shape == (1, 2, 3)


@pytest.mark.parametrize("joined", [False, True])
@pytest.mark.parametrize(("extent", "times"), [(1e3, None), (1e5, "0.082")])
def test_a_body_that_is_too_small_is_named(joined: bool, extent: float, times: str | None) -> None:
    """The warning has the measured ray offset, in sizes of the body; none for a ground 1,000 times as large."""
    parts = [concatenate(meshes(extent))] if joined else meshes(extent)
    camera = dmis.Camera.look_at((1, -4, 5), (0.5, 0, 0.3), resolution=(4, 4))
    lamp = dmis.QuadLight((-3, -1, 5), (0, 2, 0), (2, 0, 0), (10, 10, 10))
    scene = Scene(camera, tuple(Part(mesh, dmis.matte(0.5)) for mesh in parts), (lamp,))
    if times is None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scene.prepare()
    else:
        with pytest.warns(SceneWarning, match=f"rays begin {times} times the size of a body.* .part {1 - joined}."):
            scene.prepare()
