"""Many lights as one: the composite against its densities, against its lights, and renders against brute force."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.stats
from helpers import LEVEL, script

import dmis
from dmis.base.vectors import Array
from dmis.brdf.materials import Material, matte, plastic, shiny_metal
from dmis.geometry.shapes import quad, sphere
from dmis.geometry.transforms import translate
from dmis.light import tree
from dmis.light.area import DiskLight, QuadLight, SphereLight
from dmis.light.light import AreaLight
from dmis.light.light_sample import LightSample
from dmis.light.mesh_light import MeshLight
from dmis.light.pieces import Pieces
from dmis.light.selection import SELECTIONS, SelectedLights
from dmis.light.tree import TreeSelection
from dmis.samplers.warp import square_to_sphere
from dmis.scene.camera import Camera
from dmis.scene.groups import Part, light_part
from dmis.scene.plan import DEEPER_LIGHTS, MANY_LIGHTS
from dmis.scene.scene import Scene
from dmis.testing.density import COUNT, DensityView, check_integral, check_pdf
from dmis.testing.sphere import columns, uniforms

DOWN = np.array([0.0, 0.0, -1.0])


def lamp(rng: np.random.Generator, kind: int, low: float = 0.03, high: float = 0.2) -> AreaLight:
    """A lamp of random place, size, direction and colour: a disk, sphere, quad, or a mesh of some kind."""
    centre, radius = rng.uniform([-1.5, -1.5, 0.3], [1.5, 1.5, 2.5]), rng.uniform(low, high)
    colour, normal = tuple(np.exp(rng.normal(size=3))), rng.normal(size=3) + DOWN
    if kind == 0:
        return DiskLight(tuple(centre), tuple(normal), radius, colour)
    if kind == 1:
        return SphereLight(tuple(centre), radius, colour)
    if kind == 2:
        along = np.cross(normal, rng.normal(size=3))
        along *= radius / np.linalg.norm(along)
        across = np.cross(normal, along)
        return QuadLight(tuple(centre), tuple(along), tuple(2 * across / np.linalg.norm(normal)), colour)
    if kind == 4:
        bent = centre + radius * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0.4], [0, -1, 0]])
        return MeshLight(bent, np.array([[0, 2, 1], [0, 3, 2]]), colour)
    if kind == 5:
        flat = centre + radius * np.cross(normal / np.linalg.norm(normal), np.eye(3))
        return MeshLight(flat, np.array([[0, 1, 2], [0, 2, 1]]), colour)
    mesh = sphere(radius, segments=6).transformed(translate(centre))
    return MeshLight(mesh.vertices, mesh.faces, colour)


def lamp_part(light: AreaLight) -> Part:
    """The visible surface of a lamp; that of a sphere has few triangles."""
    if not isinstance(light, SphereLight):
        return light_part(light)
    return Part(sphere(light.radius, segments=16).transformed(translate(light.centre)), matte(0), light)


WALL = plastic(0.4, 0.4, 0.05)
PATHS = {"integrator": "path", "max_depth": 4}


def random_scene(seed: int, count: int = 8, wall: Material = WALL) -> Scene:
    """A floor, a glossy wall and a ball between lamps of all kinds."""
    rng = np.random.default_rng(seed)
    lights = tuple(lamp(rng, k % 6) for k in range(count))
    ball = sphere(0.3, segments=12).transformed(translate((0.2, 0.1, 0.5)))
    parts = (
        *(lamp_part(light) for light in lights),
        Part(quad((-2, -2, 0), (4, 0, 0), (0, 4, 0)), matte(0.5)),
        Part(quad((-2, 2, 0), (4, 0, 0), (0, 0, 3)), wall),
        Part(ball, plastic(0.3, 0.3, 0.1)),
    )
    camera = Camera.look_at((0, -4, 2), (0, 0, 0.6), fov=50, resolution=(24, 16))
    return Scene(camera, parts, lights)


def composite(name: str, lights: tuple[AreaLight, ...]) -> SelectedLights:
    pieces = Pieces.joined([of for light in lights if (of := light.pieces()) is not None])
    return SelectedLights(pieces, SELECTIONS[name](pieces))


@pytest.mark.parametrize("name", SELECTIONS)
@pytest.mark.parametrize("kinds", [(0, 1, 2, 4), (2, 2, 2), (1, 1, 1, 1, 1), (0, 4)])
def test_samples_follow_the_density(name: str, kinds: tuple[int, ...]) -> None:
    """Samples follow the pdf of `hit` and are its light samples, from two places, with a normal and without."""
    rng = np.random.default_rng(sum(kinds))
    light = composite(name, tuple(lamp(rng, kind, 0.2, 0.4) for kind in kinds))
    floor = light.seen_from(columns(np.array([0.0, 0.0, 1.0]), COUNT))

    def view(p: Array, u: Array, of: SelectedLights, place: str) -> DensityView:
        def hit(w: Array) -> LightSample:
            return at(of, w.shape[1]).hit(columns(p, w.shape[1]), w)

        def pdf(w: Array) -> Array:
            sample = hit(w)
            return np.where(sample.emits, sample.pdf, 0)

        def radiance(w: Array) -> Array:
            sample = hit(w)
            return np.where(sample.emits, sample.radiance, 0)

        sample = at(of, u.shape[1]).sample(columns(p, u.shape[1]), u)
        met = hit(sample.wi)
        sample.emits &= np.isclose(met.distance, sample.distance, rtol=1e-3)  # others are hidden
        for a, b in ((sample.pdf, met.pdf), (sample.radiance[0], met.radiance[0])):
            assert np.isclose(a, b, rtol=2e-3)[sample.emits].mean() > 0.995
        return DensityView(sample.wi, pdf, sample.emits, place, radiance)

    def at(of: SelectedLights, count: int) -> SelectedLights:
        return of if of.ng is None else of.seen_from(of.ng[:, :1].repeat(count, axis=1))

    places = ((0.1, 0.2, -0.5), light, "below"), ((0.3, -0.2, 0.0), floor, "on a floor")
    views = [view(np.array(p), uniforms(COUNT, k), of, place) for k, (p, of, place) in enumerate(places)]
    check_pdf(views, LEVEL)
    check_integral(views, LEVEL, "radiance")
    for p, of, _ in places:
        least_and_largest = np.float32([[0, 0, 1, 1], [0, 1, 0, 1]]) * np.float32(1 - 2**-24)
        sample = at(of, 4).sample(columns(np.array(p), 4), least_and_largest)
        assert np.isfinite(sample.wi).all() and np.isfinite(sample.pdf).all()


@pytest.mark.parametrize("seed", range(3))
def test_hit_finds_the_nearest_light(seed: int) -> None:
    """Where the composite and its lights disagree, a dark side is nearer; radiance and density are that light's."""
    scene = random_scene(seed, 40)
    w, p = square_to_sphere(uniforms(2**14, seed)), columns(np.array([0.1, 0.2, 0.6]), 2**14)
    hit = composite("even", scene.lights).hit(p, w.copy())  # type: ignore[arg-type]
    nearest, radiance, pdf = np.full(2**14, np.inf), np.zeros((3, 2**14)), np.zeros(2**14)
    for light in scene.lights:
        own = light.hit(p, w)  # type: ignore[attr-defined]
        closer = own.emits & (own.distance < nearest)
        nearest[closer], pdf[closer] = own.distance[closer], own.pdf[closer] / 40
        radiance[:, closer] = np.broadcast_to(own.radiance, w.shape)[:, closer]
    assert 0.02 < hit.emits.mean() and not (hit.emits & ~np.isfinite(nearest)).any()
    hidden = np.isfinite(nearest) & ~hit.emits
    assert hidden.mean() < 0.003 and ((hit.distance < nearest) & (hit.distance > 0))[hidden].all()
    same = hit.emits
    np.testing.assert_allclose(hit.distance[same], nearest[same], rtol=1e-4)
    np.testing.assert_allclose(hit.radiance[:, same], radiance[:, same], rtol=1e-5)
    np.testing.assert_allclose(hit.pdf[same], pdf[same], rtol=2e-2)


def test_lamps_back_to_back() -> None:
    """Of two lamps in one place a ray meets the one that faces it."""
    front = QuadLight((-1, -1, 1), (2, 0, 0), (0, 2, 0), (1, 1, 1))
    mesh = front.mesh()
    assert mesh is not None
    back = MeshLight(mesh.vertices, mesh.faces[:, ::-1], (2, 2, 2))
    disks = DiskLight((0, 0, 3), (0, 0, 1), 1, (3, 3, 3)), DiskLight((0, 0, 3), (0, 0, -1), 1, (4, 4, 4))
    light = composite("even", (front, back, *disks))
    down, up = columns(DOWN, 1), columns(-DOWN, 1)
    for z, w, value in ((5, down, 3), (2, up, 4), (2, down, 1), (0, up, 2)):
        hit = light.hit(columns(np.array([0.1, 0.2, z]), 1), w.copy())
        assert hit.emits.all() and (hit.radiance == value).all()


@pytest.mark.parametrize("name", SELECTIONS)
@pytest.mark.parametrize("count", [1, 2, 37])
def test_select_agrees_with_probability(name: str, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Intervals of the uniform number have the probabilities of their pieces, and the rest goes through each evenly."""
    monkeypatch.setattr(tree, "NODES", 16)
    rng = np.random.default_rng(count)
    light = composite(name, tuple(lamp(rng, k % 5) for k in range(count)))
    p, up = columns(np.array([0.1, 0.2, -0.4]), 2**14), columns(-DOWN, 2**14)
    u = (np.arange(2**14) + 0.5) / 2**14
    piece, probability, rest = light.selection.select(p, up, u)
    every = np.arange(len(light.pieces.area))
    expected = light.selection.probability(p[:, : len(every)], up[:, : len(every)], every)
    assert abs(expected.sum() - 1) < 1e-5
    selected = probability > 0
    assert np.abs(np.bincount(piece[selected], minlength=len(every)) / 2**14 - expected).max() < 2**-13
    np.testing.assert_allclose(probability[selected], expected[piece[selected]], rtol=1e-4)
    number, at = np.diff(u)[0], np.flatnonzero((np.diff(piece) == 0) & (probability[1:] > 0))
    np.testing.assert_allclose(rest[at + 1] - rest[at], number / probability[at], rtol=1e-2)


def test_power_counts_areas_colours_and_sides() -> None:
    """Of a quad, another one of half its size and three times its light, all red, and half of it with two sides."""
    corners, faces = np.array([[0, 0, 1], [2, 0, 1], [0, 1, 1.0]]), np.array([[0, 1, 2], [0, 2, 1]])
    white = (1.0, 1.0, 1.0)
    lights = QuadLight((0, 0, 1), (2, 0, 0), (0, 1, 0), white), QuadLight((3, 0, 1), (1, 0, 0), (0, 1, 0), (3, 0, 0))
    light = composite("power", (*lights, MeshLight(corners + 5, faces, white)))
    probability = light.selection.probability(np.zeros((3, 3)), None, np.arange(3))
    np.testing.assert_allclose(probability / probability[0], [1, 1.5 * 0.212671, 1], rtol=1e-6)


def test_dim_lamps_beside_a_bright_one_are_sampled() -> None:
    """A hundred share 1.7 steps of the first number, 2^-24 each: the second number tells them apart."""
    places = [(float(k), 0.0, 1.0) for k in range(101)]
    lights = [QuadLight(at, (0, 0.1, 0), (0.1, 0, 0), (1e9 if at[0] == 100 else 1.0,) * 3) for at in places]
    u = np.stack([np.repeat([0, 2.0**-24], 2**12), np.tile(np.linspace(0, 1 - 2**-12, 2**12), 2)]).astype(np.float32)
    wi = composite("power", tuple(lights)).sample(np.zeros((3, 2**13), np.float32), u).wi
    assert set(np.floor(wi[0] / wi[2] + 1e-3).astype(int)) == set(range(101))


@pytest.mark.parametrize("nodes", [16, 4096])
def test_tree_selects_whatever_may_give_light(nodes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """No piece whose sample emits towards the upper side of a surface has the probability 0; all together have 1."""
    monkeypatch.setattr(tree, "NODES", nodes)
    rng = np.random.default_rng(5)
    light = composite("tree", tuple(lamp(rng, k % 6) for k in range(60)))
    count, total = len(light.pieces.area), 0
    for k in range(400):
        p, ng = columns(rng.uniform(-2, 2, 3) * 10 ** (k % 3), count), columns(rng.normal(size=3), count)
        ng /= np.linalg.norm(ng, axis=0)
        sample = light.pieces.sample(np.arange(count), p, rng.random((2, count), np.float32))
        lit = sample.emits & ((ng * sample.wi).sum(axis=0) > 1e-6)
        probability = light.selection.probability(p, ng, np.arange(count))
        assert (probability[lit] > 0).all() and abs(probability.sum() - probability.any()) < 1e-5
        total += np.count_nonzero(lit)
    assert total > 1000


def test_tables_are_made_again_after_they_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(6)
    light = composite("tree", tuple(lamp(rng, k % 5) for k in range(9)))
    p, ng = rng.normal(size=(2, 3, 2000)).astype(np.float32)
    piece = rng.integers(9, size=2000)
    probability = light.selection.probability(p, ng, piece)
    monkeypatch.setattr(tree, "MOST_TABLES", 300)
    monkeypatch.setattr(tree, "BLOCK", 200)
    selection = TreeSelection(light.pieces)
    assert np.array_equal(selection.probability(p, ng, piece), probability)
    assert len(selection._tables[0]) <= 300


def test_tree_prefers_what_is_near_and_faces_the_point() -> None:
    """Of equal lamps the near one is selected most, and one that faces away never; brighter ones more often."""

    def down(x: float, radiance: float = 1.0, height: float = 1.0) -> QuadLight:
        return QuadLight((x, 0, 1), (0, 0.1, 0), (0.1 * height, 0, 0), (radiance,) * 3)

    light = composite("tree", (down(0), down(3), down(3.2, 5), down(0.3, 1, -1)))
    p, up = columns(np.zeros(3), 4), columns(-DOWN, 4)
    near, far, bright, away = light.selection.probability(p, up, np.arange(4))
    assert near > 10 * far and 3 * far < bright < 6 * far and away == 0
    u = np.array([0, 0.3, 0.7, 1 - 2.0**-48])
    assert light.needs_normals and light.seen_from(up).ng is up  # and not from both sides
    below = np.minimum(np.stack([u, u]).astype(np.float32), np.float32(1 - 2**-24))
    assert not light.seen_from(-up).sample(p - 6 * up, below).emits.any()
    piece, nothing, rest = light.selection.select(p - 6 * up, -up, u)  # all lamps are far behind the surface
    assert (piece < 4).all() and not nothing.any() and ((rest >= 0) & (rest < 1)).all()


SCENES = script("scenes/make_many_lights.py")


def test_plan_decides_by_the_number_of_lights() -> None:
    """Few lights have samples of their own, the same bits as with ``all``; many are one light, and `info` says so."""
    few, many = (SCENES.many_lights(count=count, resolution=(8, 5)) for count in (MANY_LIGHTS - 1, MANY_LIGHTS))
    assert few.plan.selection("auto") is None and few.plan.sampled_lights("auto", 0) == few.plan.sampled
    assert few.plan.selection("power") == "power" and many.plan.selection("all") is None
    (light,) = many.plan.sampled_lights("auto", 0)
    assert isinstance(light.selection, TreeSelection)  # type: ignore[attr-defined]
    assert (
        f"  {MANY_LIGHTS} lights are sampled as one: a tree selects one of their {MANY_LIGHTS} pieces"
        in many.describe()
    )
    scene = random_scene(1)
    images = [dmis.render(scene, "balance", 4, lights=lights, parallel=1).image for lights in ("auto", "all")]
    assert np.array_equal(*images)


def test_skies_and_hidden_surfaces_are_sampled_by_themselves() -> None:
    """A lamp without a part does not hide what is behind it, so that rays may meet two; a sky is met where none is."""
    scene = random_scene(2)
    bare = QuadLight((0, 0, 1), (0.1, 0, 0), (0, 0.1, 0), (1, 1, 1))
    sky, sun = dmis.EnvironmentLight(np.ones((4, 8, 3))), dmis.DistantLight((0, 0, 1), (1, 1, 1))
    plan = replace(scene, lights=(*scene.lights, bare, sky, sun)).plan
    first, *others = plan.sampled_lights("tree", 0)
    assert isinstance(first, SelectedLights) and others == [bare, sky] and plan.deltas == (sun,)


def test_a_mesh_of_many_triangles_has_a_tree() -> None:
    """It has less noise than uniform samples of its area."""
    scene = SCENES.glowing_knot(100, 10, (16, 10))
    assert "MeshLight: two techniques, MIS, a tree selects the triangle of a sample" in scene.describe()
    tree, area = (dmis.render(scene, "fixed:1", 64, seed=1, lights=lights, parallel=1) for lights in ("auto", "all"))
    assert np.median(tree.variance) < 0.7 * np.median(area.variance)


def check_against_all_lights(seed: int, name: str, rule: str, wall: Material = WALL, **options: Any) -> None:
    """Paths are the same, whatever the lights, so the difference has the noise of their samples only."""
    scene = random_scene(seed, wall=wall)
    many, each = (
        dmis.render(scene, of, 64, seed=1, parallel=1, lights=lights, **options).image
        for of, lights in ((rule, name), ("balance", "all"))
    )
    assert scipy.stats.ttest_1samp((many - each).mean(axis=2).ravel(), 0).pvalue > LEVEL


@pytest.mark.parametrize("seed", range(12))
def test_renders_agree_with_all_lights(seed: int) -> None:
    """Light samples alone, and with BRDF samples, have the mean of sampling every light at every point."""
    name = tuple(SELECTIONS)[seed % len(SELECTIONS)]
    check_against_all_lights(seed, name, ("balance", "fixed:1")[seed % 2])


@pytest.mark.parametrize(
    ("rule", "options"),
    [
        ("auto", {}),
        ("thesis", {}),
        ("thesis", {"integrator": "path", "max_depth": 3}),
        ("fixed:light=0.5,brdf=0.2,uniform=0.3", {}),
        ("fixed:0.5,combiner=optimal", {"sampler": "independent"}),
    ],
)
def test_rules_and_paths_agree_with_all_lights(rule: str, options: dict[str, Any]) -> None:
    """Learned shares and counts, paths, three techniques and optimal weights see one light and have the same mean."""
    check_against_all_lights(3, "tree", rule, **options)


@pytest.mark.parametrize("rule", ["balance", "fixed:1", "fixed:0", "auto"])
def test_paths_that_select_deeper_agree_with_all_lights(rule: str) -> None:
    """The wall mirrors and scatters, so a batch has vertices that sample each light and others that select one."""
    check_against_all_lights(4, "auto", rule, shiny_metal(0.5, 0.5, 0.1), **PATHS)


def test_where_paths_select_a_light() -> None:
    """From four lamps on, where a path has scattered: not before, not with fewer; `info` says so."""
    few, enough = (random_scene(5, count, shiny_metal(0.5, 0.5, 0.1)) for count in (DEEPER_LIGHTS - 1, DEEPER_LIGHTS))

    def same(scene: Scene, **options: Any) -> bool:
        images = [dmis.render(scene, "balance", 4, parallel=1, lights=way, **options).image for way in ("auto", "all")]
        return np.array_equal(*images)

    assert same(few, **PATHS) and not same(enough, **PATHS)
    assert same(enough, integrator="path", max_depth=1) and same(enough, integrator="direct")
    line = f"  by paths, after the first scattering: a tree selects one of {DEEPER_LIGHTS} area lights"
    assert line in enough.describe() and line not in few.describe()
