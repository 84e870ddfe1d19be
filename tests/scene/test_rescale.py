"""Units that suit float32: extreme scenes give the image of the tame one, ordinary scenes are not touched."""

import gc
import pickle
import weakref
from dataclasses import fields, replace

import numpy as np
import pytest
import trimesh

import dmis
from dmis.geometry.transforms import scale, translate
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.testing.scenes import FLOOR, box_scene

LIGHTS = (
    dmis.DiskLight((1.0, 0.5, 2.0), (-0.2, 0.1, -1.0), 0.5, (3.0, 2.0, 1.0)),
    dmis.QuadLight((-0.5, -0.5, 2.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (5.0, 4.0, 3.0)),
    dmis.SphereLight((-1.0, 1.0, 1.5), 0.25, (9.0, 9.0, 9.0)),
    dmis.MeshLight(np.array([[0, 0, 3.0], [0, 1, 3], [1, 0, 3]]), np.array([[0, 1, 2]]), (4.0, 4.0, 4.0)),
    dmis.MeshLight(
        np.array([[0, 2, 3.0], [0, 3, 3], [1, 2, 3]]),
        np.array([[0, 1, 2]]),
        dmis.Image(np.array([[[0.5, 1.0, 2.0], [4.0, 2.0, 1.0]]], np.float32)),
        np.eye(3)[:, :2],
    ),
    dmis.PointLight((1.0, -1.0, 2.0), (1.0, 2.0, 3.0)),
    dmis.SpotLight((0.0, 0.0, 3.0), (0.1, 0.2, -1.0), (5.0, 5.0, 5.0)),
    dmis.DistantLight((1.0, 1.0, 2.0), (0.5, 0.4, 0.3)),
    dmis.EnvironmentLight(np.ones((4, 8, 3), np.float32), scale=(0.3, 0.2, 0.1)),
)
VISIBLE = dmis.Mesh(np.array([[-0.5, -0.5, 2], [-0.5, 0.5, 2], [0.5, 0.5, 2.0]]), np.array([[0, 1, 2]]))


def zoo(length: float = 1.0, offset: float = 0.0, gain: float = 1.0) -> Scene:
    """All lights over a floor, one of them visible; every length, position and radiance in other units."""
    matrix = translate((offset,) * 3) @ scale(length)
    lights = []
    for light in LIGHTS:
        changes = {}
        for name in ("centre", "corner", "position", "vertices"):
            if hasattr(light, name):
                changes[name] = np.asarray(getattr(light, name)) * length + offset
        for name in ("radius", "edge_u", "edge_v"):
            if hasattr(light, name):
                changes[name] = np.asarray(getattr(light, name)) * length
        for name, factor in (("radiance", gain), ("scale", gain), ("intensity", gain * length**2)):
            if name in light.__dataclass_fields__:
                value = getattr(light, name)
                changes[name] = np.asarray(value.texels if isinstance(value, dmis.Image) else value) * factor
        changes = {k: v if v.ndim else float(v) for k, v in changes.items()}
        if isinstance(getattr(light, "radiance", None), dmis.Image):
            changes["radiance"] = dmis.Image(changes["radiance"])
        lights.append(replace(light, **changes))
    tame = box_scene(resolution=(4, 4), fov=60.0)
    to_world = np.array(tame.camera.to_world)
    to_world[:3, 3] = to_world[:3, 3] * length + offset
    parts = (
        Part(FLOOR.transformed(matrix), dmis.plastic(0.5, 0.3, 0.05)),
        Part(VISIBLE.transformed(matrix), dmis.matte(0.0), lights[1]),
    )
    return Scene(replace(tame.camera, to_world=to_world), parts, tuple(lights))


@pytest.mark.parametrize(
    "length, gain, rule", [(2.0**-40, 1.0, "balance"), (2.0**30, 2.0**60, "auto"), (2.0**-25, 2.0**-90, "thesis")]
)
def test_extreme_units_give_the_same_bits(length: float, gain: float, rule: str) -> None:
    """Powers of two change no digit: the image is that of the tame scene times the gain, to the last bit."""
    tame, extreme = (dmis.render(s, rule, 16, seed=3, parallel=1) for s in (zoo(), zoo(length, 0.0, gain)))
    np.testing.assert_array_equal(extreme.image, tame.image * gain)
    np.testing.assert_array_equal(extreme.variance, tame.variance * gain**2)
    np.testing.assert_array_equal(extreme.weight, tame.weight)
    assert tame.image.min() > 0


@pytest.mark.parametrize("offset", [2.0**10, 2.0**20, -(2.0**30)])
def test_far_from_the_origin(offset: float) -> None:
    """Positions are moved before they are rounded, so a scene a billion away has the digits that it has at home."""
    tame, far = (dmis.render(s, "balance", 64, seed=3, parallel=1).image for s in (zoo(), zoo(offset=offset)))
    np.testing.assert_allclose(far, tame, rtol=2e-3)  # a few samples cross an edge
    np.testing.assert_allclose(far.mean(), tame.mean(), rtol=2e-5)


def test_ordinary_scenes_are_not_touched(box: Scene) -> None:
    """No copy, no factor."""
    for scene in (box, zoo(), zoo(1e-3, 0.05, 1e3)):
        same, gain = scene.in_float32
        assert same is scene and gain == 1
    # a visible light stays the light of its part, and one light
    scene, gain = zoo(gain=2.0**70).in_float32
    assert gain == 2.0**73 and scene.parts[1].light is scene.lights[1]
    np.testing.assert_array_equal(scene.lights[1].radiance, np.array((5.0, 4.0, 3.0)) / 8)
    # it shines twice, in the units of the scene as in others
    sky = dmis.EnvironmentLight(np.full((2, 2, 3), 1e30, np.float32))
    one, two = (dmis.render(box_scene(lights=(sky,) * n, resolution=(2, 2)), "balance", 64).image for n in (1, 2))
    assert two.astype(float).mean() == pytest.approx(2 * one.astype(float).mean(), rel=0.05)


def test_beyond_float32() -> None:
    """An image that would be infinite is an error."""
    skies = tuple(dmis.EnvironmentLight(np.full((2, 2, 3), 3e38, np.float32)) for _ in range(2))
    with pytest.raises(ValueError, match=r"below 3\.4e38"):
        dmis.render(box_scene(dmis.matte(0.9), skies, resolution=(2, 2)), "fixed:1", 4)
    with pytest.raises(ValueError, match=r"radiance must be .* got \(1.0, 1.0, 1e\+39\)"):
        dmis.SphereLight((0, 0, 0), 1.0, (1.0, 1.0, 1e39))
    # what even float64 cannot hold is refused
    with pytest.raises(ValueError, match="further from the origin than 1e9 times its size"):
        dmis.render(zoo(offset=1e12), "balance", 2)


@pytest.mark.parametrize(
    "light",
    [
        dmis.SphereLight((0, 0, 2), 1e-13, (1, 1, 1)),
        dmis.DiskLight((0, 0, 2), (0, 0, -1), 1e14, (1, 1, 1)),
        dmis.QuadLight((0, 0, 2), (0, 1e-30, 0), (1, 0, 0), (1, 1, 1)),
        dmis.MeshLight(np.eye(3) * 1e-20, np.array([[0, 1, 2]]), (1, 1, 1)),
    ],
)
def test_lights_whose_area_float32_does_not_hold(light: dmis.light.light.AreaLight) -> None:
    """Refused: they would come out with another area."""
    with pytest.raises(ValueError, match="a light must have 1e-12 to 1e\\+12 times the size of the scene"):
        dmis.render(box_scene(lights=(light,)), "balance", 1)


@pytest.mark.parametrize("far", [1e3, 1e8])
def test_vertices_of_no_triangle_do_not_count(far: float) -> None:
    """Nothing is there: the scene is as large as without them, and rays begin where they began."""
    scene = box_scene(dmis.matte(0.5), (dmis.PointLight((0, 0, 2), (3, 3, 3)),))
    (floor,) = scene.parts
    mesh = dmis.Mesh(np.vstack([floor.mesh.vertices, [[far, 0, 0]]]), floor.mesh.faces)
    other = replace(scene, parts=(replace(floor, mesh=mesh),))
    assert other.epsilon == scene.epsilon and other.in_float32[0] is other
    np.testing.assert_array_equal(*(dmis.render(s, "balance", 4).image for s in (scene, other)))


def test_the_next_render_finds_the_scene_that_was_rescaled() -> None:
    """Its tables are built once; a pickled scene has neither, and an ordinary scene is freed when it is let go."""
    extreme, ordinary = zoo(length=2.0**30), zoo()
    assert extreme.in_float32[0] is extreme.in_float32[0] is not extreme and ordinary.in_float32 == (ordinary, 1.0)
    assert vars(pickle.loads(pickle.dumps(extreme))).keys() == {field.name for field in fields(Scene)}
    alive = weakref.ref(ordinary)
    gc.disable()
    try:
        del ordinary
        assert alive() is None
    finally:
        gc.enable()


def sunlit(distance: float, surface: bool = True, ground: float = 6.0, name: str = "box") -> Scene:
    """A box of a fifth on a floor under a sun that looks the same from anywhere."""
    centre = np.array([0.5, -0.5, np.sqrt(0.5)]) * distance
    sun = dmis.SphereLight(tuple(centre.tolist()), distance * 0.02, (1 / (np.pi * 0.02**2),) * 3)
    box = trimesh.creation.box((0.2, 0.2, 0.05), transform=translate((0, 0, 0.025)))
    floor = dmis.geometry.shapes.quad((-ground / 2, -ground / 2, 0), (ground, 0, 0), (0, ground, 0))
    parts = (Part(floor, dmis.matte(0.8)), Part(dmis.formats.mesh_files.from_trimesh(box), dmis.matte(0.5)))
    camera = dmis.Camera.look_at((0, -1.5, 1), (0, 0, 0), fov=20, resolution=(32, 32))
    return Scene(camera, parts + ((dmis.light_part(sun),) if surface else ()), (sun,), name)


def test_a_far_sun_and_a_large_ground_leave_shadows_where_they_are() -> None:
    """Rays begin above a surface by what is right for the scene that they leave, however far a lamp is.

    Each part has an offset of its own where they differ a lot: light inside of a small box stays there.
    """
    near, far, large = sunlit(100.0), sunlit(1e6), sunlit(100.0, ground=2e3)
    assert far.epsilon == near.epsilon and far.in_float32[0] is far
    offset = large.epsilon
    assert offset.max() == offset[0] > 1e-3 and offset[2] < 1e-6
    assert near.epsilon.ndim == 0 and sunlit(1e6, ground=2e3).epsilon.max() == offset.max()
    expected, distant, small = (dmis.render(s, "balance", 64, seed=k).image for k, s in enumerate((near, far, large)))
    assert np.sqrt(((distant - expected) ** 2).mean() / (expected**2).mean()) < 0.03
    top = slice(14, 17), slice(14, 18)
    np.testing.assert_allclose(small[top].mean(), expected[top].mean(), rtol=0.02)
