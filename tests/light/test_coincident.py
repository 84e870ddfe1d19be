"""Lights in one place: copies are left out, back to back each side shows its own, overlaps in part are refused."""

from pathlib import Path

import numpy as np
import pytest
from brute_force import BruteForce
from helpers import Z_LIMIT, means, pickled, tile_of, z_score

from dmis import Camera, render
from dmis.base.vectors import Array
from dmis.brdf.materials import matte, plastic
from dmis.formats.pbrt.read import read_pbrt
from dmis.geometry.shapes import quad
from dmis.intersect import Hits, Intersector
from dmis.light.area import DiskLight, QuadLight
from dmis.light.coincident import find_twins, lamp_triangles, two_sided
from dmis.light.mesh_light import MeshLight
from dmis.scene.groups import Part, light_part
from dmis.scene.scene import Scene, SceneWarning
from dmis.testing.scenes import FLOOR, box_scene
from dmis.testing.sphere import columns, uniforms

CORNERS = np.array([[-0.7, -0.7, 1.6], [-0.7, 0.7, 1.6], [0.7, 0.7, 1.6], [0.7, -0.7, 1.6]])
"""Of a quad 1.4 on a side, wound so that (0, 1, 2) looks down, onto the floor."""
DOWN, UP = [[0, 1, 2], [0, 2, 3]], [[2, 1, 0], [3, 2, 0]]
RED, BLUE = (4.0, 1.0, 0.5), (0.5, 1.0, 4.0)
CEILING = quad((-2, -2, 2.6), (0, 4, 0), (4, 0, 0))
"""Above the lamp, looking down: what shines upwards lights it."""
ABOVE = QuadLight((-0.7, -0.7, 1.6), (1.4, 0, 0), (0, 1.4, 0), BLUE)
BELOW = QuadLight((-0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0), RED)
BOX = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (1.2, 1.9)])
BOX_FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]])
BOX_FACES = np.concatenate([BOX_FACES, [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]])


def scene_of(lamps: tuple, parts: tuple[Part, ...] = ()) -> Scene:
    """A glossy floor and a white ceiling, with lamps in between that reflect nothing."""
    extra = (*parts, Part(CEILING, matte(0.8)), *(light_part(lamp) for lamp in lamps))
    return box_scene(plastic(0.3, 0.4, 0.02), lamps, extra)


def seen_from(scene: Scene, eye: tuple[float, float, float], fov: float = 60.0) -> Scene:
    return Scene(Camera.look_at(eye, (0.0, 0.0, 1.4), fov=fov, resolution=(16, 16)), scene.parts, scene.lights)


SCENES = {
    "one mesh": scene_of((MeshLight(CORNERS, np.array(UP + DOWN), RED),)),
    "box with reverse": scene_of((MeshLight(BOX, np.concatenate([BOX_FACES[:, ::-1], BOX_FACES]), RED),)),
    "two quads": scene_of((ABOVE, BELOW)),
    "two disks": scene_of((DiskLight((0, 0, 1.6), (0, 0, 1), 0.8, BLUE), DiskLight((0, 0, 1.6), (0, 0, -1), 0.8, RED))),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_techniques_agree_on_lamps_back_to_back(name: str, integrator: str) -> None:
    """Light sampling, BRDF sampling and the balance heuristic have one mean, over floor and ceiling."""
    for eye in ((0.0, -3.0, 0.4), (0.0, -2.5, 2.3)):
        scene = seen_from(SCENES[name], eye)
        light, both, brdf = (
            means(scene, range(15), 16, w=w, integrator=integrator, max_depth=2) for w in (1.0, 0.5, 0.0)
        )
        assert abs(z_score(light, both)) < Z_LIMIT and abs(z_score(light, brdf)) < Z_LIMIT


@pytest.mark.parametrize("name", SCENES)
def test_each_side_of_a_lamp_shows_its_own(name: str) -> None:
    """Camera rays at the middle of the lamp, from either side, without noise; in another process, too."""
    above = BLUE if name.startswith("two") else RED
    for height, expected in ((0.2, RED), (2.4, above)):
        scene = seen_from(SCENES[name], (0.1, -0.4, height), 10.0)
        scene.prepare()
        for copy in (scene, pickled(scene)):
            image = tile_of(copy, spp=4)[0]
            np.testing.assert_array_equal(image, np.broadcast_to(np.float32(expected), image.shape))


def test_the_caster_reports_the_triangle_that_faces_the_ray() -> None:
    """Whichever of two at one distance it would report; the barycentrics are those of the same point."""
    parts = scene_of((ABOVE, BELOW)).parts
    triangles = np.concatenate([part.mesh.vertices[part.mesh.faces] for part in parts])
    vertices, faces = triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)

    class Last(BruteForce):
        def closest(self, origin: Array, direction: Array) -> Hits:
            hits = super().closest(origin, direction)
            hits.prim[hits.prim >= 0] = len(faces) - 1 - hits.prim[hits.prim >= 0]
            return hits

    u = uniforms(2000, 4)
    for sign in (1, -1):
        direction = np.stack([u[0] - 0.5, u[1] - 0.5, np.full(2000, sign, np.float32)])
        origin = columns(np.array([0.05, 0.02, 1.6 - 0.9 * sign]), 2000)
        for caster in (Intersector(vertices, faces), BruteForce(vertices, faces), Last(vertices, faces[::-1])):
            hits = two_sided(caster, *lamp_triangles(parts)[:2]).closest(origin, direction)
            a, b, c = np.moveaxis(triangles[hits.prim], 1, 0)
            lamp = hits.prim >= 4
            assert lamp.mean() > 0.9 and ((np.cross(b - a, c - a)[lamp, 2] * sign) < 0).all()
            met = a + hits.u[:, None] * (b - a) + hits.v[:, None] * (c - a)
            np.testing.assert_allclose(met.T, origin + hits.distance * direction, atol=1e-5)


def test_twins_have_the_same_corners() -> None:
    """In any order: the even permutations face the same side. Neighbours and triangles of other sizes are no twins."""
    t = np.array([[5.0, 1, 2], [5.1, 1.3, 0], [5.2, 1, 2.4]])
    orders = [(0, 1, 2), (1, 2, 0), (2, 1, 0), (0, 2, 1)]
    same, reverse = find_twins(np.stack([*(t[list(order)] for order in orders), 2 * t, t + [1e-17, 0, -1e-17]]))
    assert same.tolist() == [0, 0, 2, 2, 4, 0] and reverse.tolist() == [2, 2, 0, 0, -1, 2]


def test_copies_and_overlaps() -> None:
    """Triangles that a mesh light lists twice count once; two lamps in one place would be twice as bright, or not."""
    doubled, single = (scene_of((MeshLight(CORNERS, np.array(faces), RED),)) for faces in (DOWN + DOWN, DOWN))
    images = [render(scene, "balance", 16, seed=1).image for scene in (doubled, single)]
    np.testing.assert_array_equal(*images)
    with pytest.raises(ValueError, match=r"got part \d \(QuadLight\) and part \d \(QuadLight\) in one place at"):
        scene_of((BELOW, QuadLight(BELOW.corner, BELOW.edge_u, BELOW.edge_v, BLUE))).prepare()
    # within a mesh, of two lamps, on one side or on two; neighbours in one plane do not overlap
    with pytest.raises(ValueError, match=r"triangles of a mesh light must not overlap in part.*about \[.*\] and \["):
        MeshLight(CORNERS, np.array([*DOWN, [0, 1, 3]]), RED)
    for u, v in (((0, 1.4, 0), (1.4, 0, 0)), ((1.4, 0, 0), (0, 1.4, 0))):
        other = QuadLight((-0.3, -0.9, 1.6), u, v, BLUE)
        with pytest.raises(ValueError, match=r"got part \d \(QuadLight\) and part \d \(QuadLight\) in one place at \("):
            scene_of((BELOW, other)).prepare()
    scene_of((BELOW, QuadLight((0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0), BLUE))).prepare()


@pytest.mark.parametrize("part", [True, False])
def test_a_lamp_on_a_surface_is_named(part: bool) -> None:
    """Nearer than the rounding of rays it gives no light; the warning names both. Farther away it gives all of it."""
    for height, warns in ((1e-7, True), (1e-3, False)):
        lamp = QuadLight((-3, -3, height), (0, 6, 0), (6, 0, 0), (1, 1, 1))
        scene = Scene(
            Camera.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), 30, (8, 8)),
            (Part(FLOOR, matte(0.5)), *((light_part(lamp),) if part else ())),
            (lamp,),
        )
        if warns:
            with pytest.warns(
                SceneWarning, match=r"QuadLight.* is nearer to part 0 \(matte\) than 2.3e-05.*rays begin above"
            ):
                render(scene, "balance", 4)
        elif not part:
            assert render(scene, "balance", 16).image.mean() == pytest.approx(0.5, rel=0.02)
            assert "no part has the surface of QuadLight: invisible to the camera" in scene.describe()


# pbrt files ---------------------------------------------------------------------------------------------------------

LAMPS = {
    "disk": 'Shape "disk" "float radius" 2',
    "trapezium": 'Shape "trianglemesh" "point3 P" [-2 -2 0  2 -2 0  1 2 0  -2 2 0] "integer indices" [0 1 2 0 2 3]',
}
WORLD = """LookAt 0.1 0.2 HEIGHT  0 0 0  0 1 0
Camera "perspective" "float fov" 20 Film "FILM" "integer xresolution" 4 "integer yresolution" 4
WorldBegin
AttributeBegin
AreaLightSource "diffuse" "rgb L" [4 4 4] TWOSIDED
SHAPES
AttributeEnd
"""


def read_lamp(folder: Path, dialect: str, shapes: str, height: float = 3, twosided: str = "") -> Scene:
    text = WORLD.replace("HEIGHT", str(height)).replace("SHAPES", shapes).replace("TWOSIDED", twosided)
    text = text.replace("FILM", "rgb" if dialect == "v4" else "image") + ("" if dialect == "v4" else "WorldEnd\n")
    path = folder / "lamp.pbrt"
    path.write_text(text)
    return read_pbrt(path, dialect=dialect)


@pytest.mark.parametrize("dialect", ["v3", "v4"])
@pytest.mark.parametrize("shape", LAMPS)
def test_shapes_listed_on_both_sides_are_as_bright_as_one(tmp_path: Path, dialect: str, shape: str) -> None:
    """Shape lines repeated after ReverseOrientation: both sides are then as bright as one was."""
    both = f"{LAMPS[shape]}\nReverseOrientation\n{LAMPS[shape]}"
    for height in (3, -3):
        scene = read_lamp(tmp_path, dialect, both, height)
        scene.prepare()
        alone = read_lamp(tmp_path, dialect, LAMPS[shape] if height > 0 else both.partition("\n")[2], height)
        image = tile_of(scene, spp=4, integrator="direct")[0]
        np.testing.assert_array_equal(image, tile_of(alone, spp=4, integrator="direct")[0])
        assert image.min() > 1
