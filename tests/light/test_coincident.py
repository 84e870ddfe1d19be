"""Lights whose triangles overlap in one plane: which pairs are found, and that all ways to see them agree."""

import warnings
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from helpers import LEVEL, Z_LIMIT, means, pickled, tile_of

from dmis import Camera, render
from dmis.base.vectors import Array
from dmis.brdf.materials import glass, matte, plastic
from dmis.formats.load_scene import light_part
from dmis.formats.pbrt.notes import PbrtWarning
from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.tokens import PbrtError
from dmis.geometry.shapes import quad
from dmis.intersect import BruteForce, Hits, Intersector
from dmis.light.area import DiskLight, QuadLight
from dmis.light.coincident import coincident_lights, find_coincident
from dmis.light.mesh_light import MeshLight
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.testing.density import DensityView
from dmis.testing.scenes import FLOOR, box_scene
from dmis.testing.sphere import columns, uniforms
from dmis.testing.statistics import z_score

CORNERS = np.array([[-0.7, -0.7, 1.6], [-0.7, 0.7, 1.6], [0.7, 0.7, 1.6], [0.7, -0.7, 1.6]])
"""Of a quad 1.4 on a side, wound so that (0, 1, 2) looks down, onto the floor."""
DOWN, DOWN_OTHER = [[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]
UP, UP_OTHER = [[2, 1, 0], [3, 2, 0]], [[3, 1, 0], [3, 2, 1]]
RED, BLUE = (4.0, 1.0, 0.5), (0.5, 1.0, 4.0)
CEILING = quad((-2, -2, 2.6), (0, 4, 0), (4, 0, 0))
"""Above the lamp, looking down: what shines upwards lights it."""


# The search ---------------------------------------------------------------------------------------------------------


def pairs_of(triangles: Array, **options: Array) -> set[tuple[int, int, bool]]:
    found = find_coincident(np.asarray(triangles, float), **options)
    return (
        set()
        if found is None
        else set(zip(*(a.tolist() for a in (found.triangle, found.other, found.same)), strict=True))
    )


def test_overlaps_are_those_of_the_areas() -> None:
    """Random triangles of a few planes, against points that are drawn in one and looked for in the other.

    Triangles that overlap by less than 1 % of both areas are left out of the comparison: 4096 points may miss them.
    """
    rng = np.random.default_rng(3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    flat = rng.uniform(-1, 1, (60, 3, 2))
    height = rng.integers(3, size=60)
    triangles = (np.concatenate([flat, np.broadcast_to(0.1 * height[:, None, None], (60, 3, 1))], axis=2)) @ turn.T
    found = pairs_of(triangles.astype(np.float32))
    a, b = np.sqrt(rng.random(4096)), rng.random(4096)
    weights = np.stack([1 - a, a * (1 - b), a * b])
    for i in range(60):
        points = flat[i].T @ weights
        for j in range(60):
            p, (e, f) = flat[j, 0], flat[j, 1:] - flat[j, 0]
            s, t = np.linalg.solve(np.stack([e, f], axis=1), points - p[:, None])
            share = ((s >= 0) & (t >= 0) & (s + t <= 1)).mean() if height[i] == height[j] and i != j else 0.0
            sides = [np.linalg.det(flat[k, 1:] - flat[k, 0]) > 0 for k in (i, j)]
            if share > 0.01:
                assert (i, j, sides[0] == sides[1]) in found
            elif height[i] != height[j] or i == j:
                assert not {(i, j, True), (i, j, False)} & found


@pytest.mark.parametrize("far", [0.0, 50.0])
def test_neighbours_do_not_overlap(far: float) -> None:
    """Triangles that share an edge or a corner, of a grid that is turned and rounded, far from the origin too."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.linspace(0, 3, 12), np.linspace(0, 1, 12), indexing="ij")
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points = (np.stack([x, y, 0 * x], axis=-1) @ turn.T + far).astype(np.float32)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    grid = np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])
    assert not pairs_of(grid)
    twice = pairs_of(np.concatenate([grid, grid[:, ::-1]]))
    assert twice == {(i, (i + 242) % 484, False) for i in range(484)}


def test_any_order_of_corners_is_found() -> None:
    """A triangle listed a second time: the even permutations of its corners face the same side, the odd ones do not."""
    triangle = np.array([[5.0, 1, 2], [5.1, 1.3, 2], [5.2, 1, 2.4]])
    for order in permutations(range(3)):
        same = order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        assert pairs_of(np.stack([triangle, triangle[list(order)]])) == {(0, 1, same), (1, 0, same)}


def test_slivers_and_points_are_no_obstacle() -> None:
    """Triangles without an area overlap nothing; very thin ones overlap themselves if they are listed twice."""
    point, line = np.ones((3, 3)), np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2]])
    thin = np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2 + 1e-7]])
    assert pairs_of(np.stack([point, line, thin, point, line])) == set()
    assert pairs_of(np.stack([point, thin, thin])) == {(1, 2, True), (2, 1, True)}


def test_hits_are_found_in_the_other_triangle() -> None:
    """Barycentrics on one triangle map to those on the other: half of (0, 1, 2) is in a triangle of half its size."""
    triangle = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]])
    found = find_coincident(np.stack([triangle, triangle * [0.5, 1, 1]]))
    assert found is not None
    prim, u, v = np.zeros(4, np.int32), np.array([0.1, 0.4, 0.6, 0.3]), np.array([0.1, 0.1, 0.1, 0.6])
    hit, pair = found.at(np.append(prim, -1), np.append(u, 0.1), np.append(v, 0.1))  # the last one is a miss
    assert hit.tolist() == [0, 1] and found.other[pair].tolist() == [1, 1]  # 2 u + v <= 1


# Lamps --------------------------------------------------------------------------------------------------------------


def scene_of(lamps: tuple, parts: tuple[Part, ...] = (), **camera: object) -> Scene:
    """A glossy floor and a white ceiling, with lamps in between that reflect nothing."""
    extra = (*parts, Part(CEILING, matte(0.8)), *(light_part(lamp) for lamp in lamps))
    return box_scene(plastic(0.3, 0.4, 0.02), lamps, extra, **camera)


ABOVE = QuadLight((-0.7, -0.7, 1.6), (1.4, 0, 0), (0, 1.4, 0), BLUE)
BELOW = QuadLight((-0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0), RED)
PANEL = np.array(
    [[-0.7, -0.7, 1.6], [-0.7, 0.9, 1.6], [0.9, 0.5, 1.6], [0.3, 0.8, 1.6], [-0.6, -0.2, 1.6], [0.8, -0.9, 1.6]]
)
BOX = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (1.2, 1.9)])
BOX_FACES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
)
SCENES = {
    "doubled quad": scene_of((MeshLight(CORNERS, np.array(DOWN + DOWN), RED),)),
    "doubled quad, other diagonal": scene_of((MeshLight(CORNERS, np.array(DOWN + DOWN_OTHER), RED),)),
    "reverse twins": scene_of((MeshLight(CORNERS, np.array(DOWN + UP), RED),)),
    "reverse twins, listed first": scene_of((MeshLight(CORNERS, np.array(UP + DOWN), RED),)),
    "reverse, other diagonal": scene_of((MeshLight(CORNERS, np.array(UP_OTHER + DOWN), RED),)),
    "overlapping triangles": scene_of((MeshLight(PANEL, np.array([[0, 1, 2], [3, 4, 5], [3, 2, 0], [1, 5, 4]]), RED),)),
    "box listed twice": scene_of((MeshLight(BOX, np.concatenate([BOX_FACES, BOX_FACES]), RED),)),
    "box with reverse": scene_of((MeshLight(BOX, np.concatenate([BOX_FACES[:, ::-1], BOX_FACES]), RED),)),
    "two quads, back to back": scene_of((ABOVE, BELOW)),
    "two disks, back to back": scene_of(
        (DiskLight((0, 0, 1.6), (0, 0, 1), 0.8, BLUE), DiskLight((0, 0, 1.6), (0, 0, -1), 0.8, RED))
    ),
    "two quads, one on the other": scene_of((BELOW, QuadLight((-0.3, -0.9, 1.6), (0, 1.4, 0), (1.4, 0, 0), BLUE))),
}
each_scene = pytest.mark.parametrize("name", SCENES)


@each_scene
@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_techniques_agree(name: str, integrator: str) -> None:
    """Light sampling, BRDF sampling and the balance heuristic of both have one mean, over floor and ceiling.

    The camera is at the floor's height and sees the undersides of lamp and ceiling, and the floor; the lamp itself is
    without noise, and the same in all.
    """
    for eye in ((0.0, -3.0, 0.4), (0.0, -2.5, 2.3)):
        scene = seen_from(SCENES[name], eye)
        light, both, brdf = (
            means(scene, range(15), 16, w=w, integrator=integrator, max_depth=2) for w in (1.0, 0.5, 0.0)
        )
        assert abs(z_score(light, both)) < Z_LIMIT and abs(z_score(light, brdf)) < Z_LIMIT


def seen_from(scene: Scene, eye: tuple[float, float, float], fov: float = 60.0) -> Scene:
    camera = Camera.look_at(eye, (0.0, 0.0, 1.4), fov=fov, resolution=(16, 16))
    return Scene(camera, scene.parts, scene.lights)


def test_a_doubled_quad_is_twice_as_bright() -> None:
    """All that it lights, and the quad itself, as one quad of twice the radiance; reverse twins as two quads."""
    twice = scene_of((QuadLight(BELOW.corner, BELOW.edge_u, BELOW.edge_v, (8.0, 2.0, 1.0)),))
    red = scene_of((BELOW, QuadLight(ABOVE.corner, ABOVE.edge_u, ABOVE.edge_v, RED)))
    for name, expected in (("doubled quad, other diagonal", twice), ("reverse twins", red)):
        for eye in ((0.0, -3.0, 0.4), (0.0, -2.5, 2.3)):
            two = means(seen_from(expected, eye), range(15, 30), 16)
            for w in (0.0, 1.0):
                assert abs(z_score(means(seen_from(SCENES[name], eye), range(15), 16, w=w), two)) < Z_LIMIT


@pytest.mark.parametrize(
    ("name", "below", "above"),
    [
        ("doubled quad", (8.0, 2.0, 1.0), (0, 0, 0)),
        ("doubled quad, other diagonal", (8.0, 2.0, 1.0), (0, 0, 0)),
        ("reverse twins", RED, RED),
        ("reverse twins, listed first", RED, RED),
        ("reverse, other diagonal", RED, RED),
        ("box listed twice", (8.0, 2.0, 1.0), (8.0, 2.0, 1.0)),
        ("box with reverse", RED, RED),
        ("two quads, back to back", RED, BLUE),
        ("two disks, back to back", RED, BLUE),
    ],
)
def test_the_lamp_itself(name: str, below: tuple[float, ...], above: tuple[float, ...]) -> None:
    """Camera rays at the middle of the lamp, from either side: the sum of what faces them, without noise."""
    for height, expected in ((0.2, below), (2.4, above)):
        scene = seen_from(SCENES[name], (0.1, -0.4, height), 10.0)
        image = tile_of(scene, spp=4)[0]
        np.testing.assert_array_equal(image, np.broadcast_to(np.float32(expected), image.shape))


def test_parts_of_two_lamps_add_up_where_they_overlap() -> None:
    """Two quads of one plane that overlap in part, seen from below: red, blue, and in between their sum."""
    scene = seen_from(SCENES["two quads, one on the other"], (0.0, -0.1, 0.3), 60)
    image = tile_of(scene, spp=1)[0].reshape(-1, 3)
    colours = {tuple(np.round(c, 4).tolist()) for c in image[image.max(axis=1) > 3]}
    assert colours == {RED, BLUE, (4.5, 2.0, 4.5)}


@pytest.mark.parametrize("first", [True, False])
def test_a_lamp_on_a_wall_is_seen(first: bool) -> None:
    """A lamp in the plane of a ceiling that is larger, whichever of them the scene lists first."""
    wall = Part(quad((-2, -2, 1.6), (0, 4, 0), (4, 0, 0)), matte(0.0))
    lamp = light_part(BELOW)
    parts = (wall, lamp) if first else (lamp, wall)
    camera = Camera.look_at((0.1, -0.2, 0.1), (0.0, 0.0, 1.6), fov=20, resolution=(8, 8))
    scene = Scene(camera, (Part(FLOOR, matte(0.5)), *parts), (BELOW,))
    np.testing.assert_array_equal(tile_of(scene, spp=4)[0], np.broadcast_to(np.float32(RED), (8, 8, 3)))


def test_a_mirror_and_a_pane_show_both_sides() -> None:
    """Rays that go on through glass meet the lamp with a throughput; both sides shine as one by one."""
    pane = Part(quad((-3, -1.2, -1), (6, 0, 0), (0, 0, 6)), glass())
    for lamps, other in (((ABOVE, BELOW), BELOW), ((BELOW, ABOVE), BELOW)):
        two, one = (seen_from(scene_of(chosen, (pane,)), (0.0, -3.0, 1.0), 12) for chosen in (lamps, (other,)))
        np.testing.assert_array_equal(tile_of(two, spp=4, w=1.0)[0].max(), tile_of(one, spp=4, w=1.0)[0].max())


class Other:
    """A ray caster that reports the last of several triangles at one distance, where another reports the first."""

    def __init__(self, vertices: Array, faces: Array) -> None:
        self._count, self._cast = len(faces), BruteForce(vertices, faces[::-1])

    def closest(self, origin: Array, direction: Array) -> Hits:
        hits = self._cast.closest(origin, direction)
        hits.prim[hits.prim >= 0] = self._count - 1 - hits.prim[hits.prim >= 0]
        return hits

    def occluded(self, origin: Array, direction: Array, distance: Array) -> Array:
        return self._cast.occluded(origin, direction, distance)


@pytest.mark.parametrize("name", ["doubled quad", "reverse, other diagonal", "two quads, back to back"])
def test_the_choice_of_the_ray_caster_does_not_matter(name: str) -> None:
    """Emission is the same, whichever of the triangles at one distance is reported: first, last, or Embree's."""
    scene = seen_from(SCENES[name], (0.1, -0.4, 0.3))
    vertices, start = np.concatenate([part.mesh.vertices for part in scene.parts]).astype(np.float32), 0
    faces = []
    for part in scene.parts:
        faces.append(part.mesh.faces + start)
        start += len(part.mesh.vertices)
    rays = uniforms(2000, 4)
    direction = np.stack([rays[0] - 0.5, rays[1] - 0.5, np.ones(2000, np.float32)])
    direction /= np.linalg.norm(direction, axis=0)
    origin = columns(np.array([0.05, 0.02, 0.4]), 2000)
    for sign in (1, -1):
        seen = []
        for cast in (Intersector, BruteForce, Other):
            way, start_ = np.ascontiguousarray(direction * [[1], [1], [sign]], np.float32), origin.copy()
            if sign < 0:
                start_[2] = 2.4
            hits = cast(vertices, np.concatenate(faces)).closest(start_, way)
            total = np.zeros((3, 2000), np.float32)
            for group_number, group in enumerate(scene.plan.groups):
                index = np.flatnonzero(scene.plan.face_group[hits.prim] == group_number)
                if group.emission is not None and len(index):
                    emission = scene.shading_points(group, hits, index, way)[1]
                    assert emission is not None
                    total[:, index] += emission
            radiance, ray = scene.overlapping_emission(hits, way)
            for row, values in zip(total, radiance, strict=True):
                np.add.at(row, ray, values)
            seen.append(total)
        for other in seen[1:]:
            differ = (other != seen[0]).any(axis=0)
            assert differ.mean() < 0.005  # at an edge, where rounding decides


# Densities ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("faces", [DOWN + DOWN, DOWN + UP, UP_OTHER + DOWN, DOWN + DOWN_OTHER[:1]])
@pytest.mark.parametrize("height", [0.0, 3.0])
def test_samples_follow_the_density(faces: list[list[int]], height: float) -> None:
    """Chi-square of sampled directions against `hit`'s density, also of points that only the reverse faces."""
    light = MeshLight(CORNERS, np.array(faces), RED)
    p = np.array([0.2, -0.1, height])
    seen = light.sample(columns(p, 2**16), uniforms(2**16))
    again = light.hit(columns(p, 2**16), seen.wi)
    same = np.isclose(again.pdf, seen.pdf, rtol=1e-3) & (again.emits == seen.emits)
    assert same.mean() > 0.999
    np.testing.assert_allclose(again.radiance[:, same], seen.radiance[:, same])
    assert (
        DensityView(seen.wi, lambda w: light.hit(columns(p, w.shape[1]), w).pdf, np.ones(seen.wi.shape[1], bool)).p
        > LEVEL
    )


def test_a_two_sided_lamp_wastes_no_samples() -> None:
    """Every sample of reverse twins emits, above and below, as every sample of a quad does on its bright side."""
    light = MeshLight(CORNERS, np.array(DOWN + UP), RED)
    for height in (0.0, 3.0):
        assert light.sample(columns(np.array([0.2, -0.1, height]), 4096), uniforms(4096)).emits.mean() > 0.999


# What it costs ------------------------------------------------------------------------------------------------------


def test_scenes_without_overlaps_pay_nothing() -> None:
    """No table, and no additional work for the rays: the plan and the light say that there is none."""
    light = MeshLight(CORNERS, np.array(DOWN), RED)
    scene = scene_of((light, DiskLight((0, 0, 1.2), (0, 0, -1), 0.3, RED)))
    assert light.overlaps is None and scene.plan.coincident is None
    assert coincident_lights([Part(FLOOR, matte(0.5))]) is None


def test_overlaps_survive_pickling() -> None:
    """They are found once, and sent to other processes with the light."""
    scene = scene_of((MeshLight(CORNERS, np.array(DOWN + UP), RED),))
    one, two = (render(s, "balance", 16, seed=1).image for s in (scene, pickled(scene)))
    np.testing.assert_array_equal(one, two)
    assert "overlaps" in vars(pickled(scene.lights[0]))


# pbrt files ---------------------------------------------------------------------------------------------------------

LAMPS = {
    "disk": 'Shape "disk" "float radius" 2',
    "quad": 'Shape "trianglemesh" "point3 P" [-2 -2 0  2 -2 0  2 2 0  -2 2 0] "integer indices" [0 1 2 0 2 3]',
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
def test_the_advice_for_twosided_works(tmp_path: Path, dialect: str, shape: str) -> None:
    """The error says: repeat the Shape lines after ReverseOrientation. Both sides are then as bright as one was."""
    with pytest.raises(PbrtError, match=r"lamp\.pbrt:5: .*repeat the light's Shape lines after ReverseOrientation"):
        read_lamp(
            tmp_path, dialect, LAMPS[shape], twosided='"bool twosided" ' + ("true" if dialect == "v4" else '"true"')
        )
    both = f"{LAMPS[shape]}\nReverseOrientation\n{LAMPS[shape]}"
    for height in (3, -3):
        scene = read_lamp(tmp_path, dialect, both, height)
        alone = read_lamp(tmp_path, dialect, LAMPS[shape] if height > 0 else both.partition("\n")[2], height)
        image = tile_of(scene, spp=4, integrator="direct")[0]
        np.testing.assert_array_equal(image, tile_of(alone, spp=4, integrator="direct")[0])
        assert image.min() > 1


@pytest.mark.parametrize("indices", ["0 1 2  0 2 3  1 2 0", "0 1 2  0 2 3  0 1 3"])
def test_a_doubled_triangle_is_named(tmp_path: Path, indices: str) -> None:
    """A warning with the line and the numbers; triangles of both windings are a lamp of two sides, and no mistake."""
    shape = LAMPS["trapezium"].replace("0 1 2 0 2 3", indices)
    with pytest.warns(
        PbrtWarning, match=r"lamp\.pbrt:6: triangles 0 and 2 of this light overlap and face the same side"
    ):
        read_lamp(tmp_path, "v3", shape)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = read_lamp(tmp_path, "v3", shape.replace(indices, "0 1 2  0 2 3  2 1 0"))
    assert "2 triangles of lights overlap others in one plane" in scene.describe()
