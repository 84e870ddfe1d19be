"""Scenes by name, from mesh files, and from meshes in memory."""

import pickle
import warnings

import numpy as np
import pytest
import trimesh
from gltf_file import CORNERS, FACES, File
from helpers import triangle_ply
from PIL import Image as PIL

import dmis
from dmis.brdf.materials import matte, mirror, plastic
from dmis.brdf.texture import Image
from dmis.cli.commands import main
from dmis.formats.load_scene import load_scene
from dmis.formats.mesh_files import from_trimesh
from dmis.formats.model import DEFAULT_MATERIAL
from dmis.formats.model_lights import LIT, SKY, SOFT_SKY, lit_share
from dmis.geometry.mesh import Mesh
from dmis.geometry.shapes import quad
from dmis.light.area import SphereLight
from dmis.light.delta import PointLight
from dmis.light.environment import EnvironmentLight
from dmis.light.mesh_light import MeshLight
from dmis.pipeline.render import render
from dmis.scene.camera import Camera
from dmis.scene.groups import Part, light_part
from dmis.scene.scene import Scene, SceneWarning

BOX = trimesh.creation.box()


@pytest.fixture
def pbrt_file(tmp_path):
    path = tmp_path / "scene.pbrt"
    path.write_text('SurfaceIntegrator "directlighting" WorldBegin Shape "sphere" WorldEnd')
    return path


def test_scenes_by_name(pbrt_file, monkeypatch):
    for source in (pbrt_file, str(pbrt_file)):
        scene = load_scene(source, (40, 30))
        assert (scene.name, scene.camera.resolution) == ("scene", (40, 30))
    # error lists known names
    monkeypatch.setattr("dmis.formats.load_scene.SCENE_FOLDER", pbrt_file.parent)
    monkeypatch.setattr("dmis.formats.load_scene.SHIPPED", ("scene",))
    assert load_scene("scene").parts
    with pytest.raises(ValueError, match=r"one of the scenes that come with dmis: scene; got 'teapot'$"):
        load_scene("teapot")
    with pytest.raises(ValueError, match=r"got 'scenes', did you mean 'scene'\?"):
        load_scene("scenes")


@pytest.mark.parametrize("suffix", ["ply", "obj", "glb", "stl"])
def test_mesh_files(tmp_path, capsys, suffix):
    """What is given is taken; a file without materials loads without a warning, and info names nothing unread."""
    path = tmp_path / f"box.{suffix}"
    BOX.export(path)
    gloss, light = plastic(), PointLight((1, 2, 3), (4, 4, 4))
    camera = Camera.look_at((3, 0, 0), (0, 0, 0), resolution=(8, 8))
    scene = load_scene(path, camera=camera, material=gloss, lights=[light])
    (part,) = scene.parts
    assert (part.material, part.mesh.triangles, scene.lights, scene.name) == (gloss, 12, (light,), "box")
    assert scene.camera is camera
    assert load_scene(path, (4, 2), camera=camera).camera.resolution == (4, 2)
    assert "unread" not in load_scene(path, (8, 8)).source
    assert main(["info", str(path), "--resolution", "8x8"]) == 0
    output = capsys.readouterr()
    assert "needs interpolated normals" not in output.out and "not read" not in output.out and output.err == ""


@pytest.mark.parametrize("source", [BOX, Mesh(BOX.vertices, BOX.faces), trimesh.Scene(BOX)])
def test_defaults(source):
    scene = load_scene(source)
    part, lamp_part = scene.parts
    assert part.material.name == "matte"
    sky, lamp = scene.lights
    assert isinstance(sky, EnvironmentLight) and lamp_part.light is lamp
    wi = np.random.default_rng(1).normal(size=(3, 100)).astype(np.float32)
    wi /= np.linalg.norm(wi, axis=0)
    np.testing.assert_allclose(sky.radiance(wi), SKY, rtol=1e-6)
    # the camera sees every vertex, well inside the picture
    x, y, z = (np.linalg.inv(scene.camera.to_world) @ np.c_[BOX.vertices, np.ones(8)].T)[:3]
    slope = np.tan(np.radians(scene.camera.fov / 2))
    assert (z > 0).all()
    assert np.abs(np.stack([x, y]) / z).max() < slope
    assert np.abs(np.stack([x, y]) / z).max() > slope / 2
    assert np.linalg.det(scene.camera.to_world[:3, :3]) < 0  # a photograph, not a mirror image


def test_default_lamp_shows_the_shape():
    """No camera sees it, whatever its angle and the shape of its image; white that faces it has radiance 1."""
    ball = trimesh.creation.icosphere(3, 2.0)
    for camera in (None, Camera.look_at((3, -1, 0), (0, 0, 0), fov=170, resolution=(64, 8))):
        scene = load_scene(ball, camera=camera)
        _, lamp = scene.lights
        eye, forward = scene.camera.origin[:, 0], scene.camera.to_world[:3, 2]
        assert ((lamp.mesh().vertices - eye) @ forward < 0).all()
    sky, lamp = load_scene(ball).lights
    normal = np.cross(lamp.edge_u, lamp.edge_v)
    towards = -normal / np.linalg.norm(normal)
    across = np.cross(towards, (0, 0, 1))
    edges = 0.01 * across, 0.01 * np.cross(towards, across)
    small = quad(tuple(-sum(edges) / 2), *map(tuple, edges))
    camera = Camera.look_at(tuple(towards), (0, 0, 0), fov=0.1, resolution=(4, 4))
    white = render(load_scene(small, camera=camera, material=matte(1), lights=(sky, lamp)), "balance", 64).image
    assert white.mean() == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, 0, 0)])
def test_a_camera_that_sees_all(up):
    """In the middle of the image, and 0.9 of its shorter side; what is nearer does not reach beyond."""
    balls = ((1, (0, 3, 0)), (3, (9, 0, 1)))
    meshes = [from_trimesh(trimesh.creation.icosphere(2, r).apply_translation(p)) for r, p in balls]
    camera = Camera.fit(meshes, up, resolution=(300, 200))
    x, y, depth, _ = camera.raster(np.concatenate([mesh.vertices for mesh in meshes]))
    spans = np.array([[x.min() - 50, y.min()], [x.max() - 50, y.max()]]) / 200
    np.testing.assert_allclose(spans.sum(axis=0), 1, atol=0.01)
    assert np.ptp(spans, axis=0).max() == pytest.approx(0.9, abs=0.01) and (depth > 0).all()


def test_materials_by_name():
    scene = trimesh.Scene()
    scene.add_geometry(BOX, geom_name="a")
    scene.add_geometry(BOX, geom_name="b", transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    red, glossy = matte((1, 0, 0)), mirror()
    scene.graph.update("again", matrix=trimesh.transformations.translation_matrix([0, 3, 0]), geometry="a")
    parts = load_scene(scene, material={"a": red, "b": glossy}, lights=()).parts
    centres = {tuple(part.mesh.vertices.mean(axis=0).round(9)): part.material for part in parts}
    assert centres == {(0, 0, 0): red, (5, 0, 0): glossy, (0, 3, 0): red}
    parts = load_scene(scene, material={"a": red}, lights=()).parts
    assert sorted(part.material is DEFAULT_MATERIAL for part in parts) == [False, False, True]


@pytest.mark.parametrize("kind", ["faces", "vertices", "material", "image"])
def test_colours_and_materials_of_trimesh(tmp_path, kind):
    """They are those of the same GLB file, at the places of a scene; one material for all replaces them."""
    thing = trimesh.creation.box()
    if kind == "faces":
        thing.visual.face_colors = (200, 50, 50, 255)
    elif kind == "vertices":
        thing.visual.vertex_colors = np.random.default_rng(1).integers(0, 256, (8, 4))
    else:
        image = PIL.fromarray(np.full((2, 2, 3), (9, 200, 50), np.uint8)) if kind == "image" else None
        surface = {"baseColorFactor": (255, 0, 0, 255)} if image is None else {"baseColorTexture": image}
        material = trimesh.visual.material.PBRMaterial(**surface, metallicFactor=0.0, roughnessFactor=0.5)
        thing.visual = trimesh.visual.TextureVisuals(uv=thing.vertices[:, :2], material=material)
    scene = trimesh.Scene({"a": thing})
    scene.apply_transform(trimesh.transformations.translation_matrix([0, 3, 0]) @ np.diag([-1, 1, 1, 1]))
    scene.export(tmp_path / "a.glb")
    of_file, memory = load_scene(tmp_path / "a.glb").parts[0], load_scene(scene).parts[0]
    assert repr(memory.material) == repr(of_file.material) and memory.material.name != "matte"
    corners = [np.sort(part.mesh.vertices[part.mesh.faces], axis=1) for part in (memory, of_file)]
    np.testing.assert_allclose(*corners, atol=1e-6)
    assert load_scene(scene, material={"a": mirror()}).parts[0].material.name == "mirror"
    assert load_scene(scene, material=mirror()).parts[0].material.name == "mirror"
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False, vertex_colors=[[9] * 3] * 3)
    with pytest.warns(SceneWarning, match="1 of .* triangles have no area"):
        assert load_scene(trimesh.Scene({"flat": flat, "a": thing}), material={"a": mirror()}).parts[0].mesh.triangles


def test_lights_get_a_surface_and_flat_ones_need_none():
    light = SphereLight((0, 0, 4), 0.5, (1, 1, 1))
    *_, part = load_scene(BOX, lights=[light]).parts
    assert part.light is light and part.material.lobes == ()
    floor = Part(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), matte(0.5))
    camera = Camera.look_at((5, -5, 4), (0, 0, 0), fov=35, resolution=(12, 9))
    corners = [[-1, -1, 3], [-1, 1, 3], [1, 1, 3], [1, -1, 3]]
    flat = MeshLight(corners, [[0, 1, 2], [0, 2, 3]], (5, 5, 5))
    two = [*corners, *([x, y, z + 0.5] for x, y, z in corners)]
    lamp = MeshLight(two, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], (5, 5, 5))
    assert flat.flat and not lamp.flat
    Scene(camera, (floor,), (flat,))
    with pytest.raises(ValueError, match="a MeshLight that is not flat must be a part of the scene too"):
        Scene(camera, (floor,), (lamp,))
    Scene(camera, (floor, light_part(lamp)), (lamp,))


@pytest.mark.parametrize(
    "source, arguments, kind, message",
    [
        ("no-such-scene", {}, ValueError, r"ending in \.pbrt, .*or one of the scenes .*: .*got 'no-such-scene'"),
        ("../scenes/tt", {}, ValueError, "a scene must be a file ending in"),
        ("scenes/ttt.pbrt", {}, FileNotFoundError, r"ttt\.pbrt, did you mean 'tt\.pbrt'\?"),
        ("none.ply", {}, FileNotFoundError, r"none\.ply"),
        ("", {}, ValueError, "got '.'"),
        (7, {}, ValueError, "source must be a path, a name, a Mesh, or triangles of trimesh; got int"),
        (trimesh.Scene(), {}, ValueError, "must hold triangles"),
        (BOX, {"material": "matte"}, ValueError, "material must be a Material, or a dict of them by name; got str"),
        (BOX, {"lights": EnvironmentLight(np.ones((1, 2, 3)))}, ValueError, "lights must be a list; got one Env"),
        ("teapot-area-light", {"resolution": (6.5, 5)}, ValueError, "resolution must be a whole number; got 6.5"),
        (BOX, {"fov": "x"}, ValueError, "fov must be a number; got 'x'"),
        (BOX, {"material": {"a": matte()}}, ValueError, r"or geometries of the source, \[''\]; got 'a'"),
    ],
)
def test_bad_input(source, arguments, kind, message):
    with pytest.raises(kind, match=message):
        load_scene(source, **arguments)


@pytest.mark.parametrize(
    "name, value", [("camera", 1), ("lights", []), ("material", matte()), ("fov", 30.0), ("up", "y")]
)
def test_a_pbrt_scene_has_its_own(pbrt_file, name, value):
    with pytest.raises(ValueError, match=f"{name} must not be given for .*because a pbrt scene has its own"):
        load_scene(pbrt_file, **{name: value})


def test_up_of_the_default_camera(tmp_path) -> None:
    """It may be named in place of the format's."""
    BOX.export(tmp_path / "a.obj")
    for up, axis in ((None, 1), ("z", 2), ("y", 1)):
        right = load_scene(tmp_path / "a.obj", up=up).camera.to_world[:3, 0]
        assert abs(right[axis]) < 1e-6 < abs(right[3 - axis])
    with pytest.raises(ValueError, match="up must be y or z, the axis of the default camera; got 'x'"):
        load_scene(BOX, up="x")
    assert main(["info", str(tmp_path / "a.obj"), "--up", "y"]) == 0
    # brighter above than below, whichever axis is up; it is the same all around
    BOX.export(tmp_path / "a.obj")
    for up in ("y", "z"):
        sky, _ = load_scene(tmp_path / "a.obj", up=up).lights
        axis = np.eye(3, dtype=np.float32)["xyz".index(up)]
        level = np.roll(axis, 1)  # and not quite at the poles, about which the map is interpolated
        values = [sky.radiance(np.float32(w)[:, None])[0, 0] for w in (axis + 0.1 * level, level, 0.1 * level - axis)]
        np.testing.assert_allclose(values, SOFT_SKY[::-1], atol=0.02)


def test_triangles_that_warn(tmp_path) -> None:
    """Points and lines, also by rounding; a warning has their number. Nothing but them is an error."""
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.1 0.2 0.3\nv 0.3 0.6 0.9\nv 0.7 1.4 2.1\n"
    (tmp_path / "a.obj").write_text(f"{corners}f 1 2 3\nf 2 2 3\nf 4 5 6\nf 1 1 1\n")
    with pytest.warns(SceneWarning, match=r"a\.obj: 3 of 4 triangles have no area and are left out") as caught:
        scene = load_scene(tmp_path / "a.obj")
    assert scene.parts[0].mesh.triangles == 1 and caught[0].filename == __file__
    (tmp_path / "b.obj").write_text(f"{corners}f 4 5 6\n")
    with pytest.raises(ValueError, match=r"mesh must have a triangle with an area .*; got 1 without an area"):
        load_scene(tmp_path / "b.obj")
    # Once, when the scene is made: not by its crops and renders in other units
    image = Image(np.random.default_rng(1).random((4, 4, 3)))
    bare = Mesh(1e6 * BOX.vertices, BOX.faces)
    for material in (matte(image), plastic(roughness=Image(np.array([[[0.1], [0.2]]])))):
        with pytest.warns(SceneWarning, match="1 of 2 parts have an image texture and no texture coord") as caught:
            scene = load_scene(bare, (4, 4), material=material)
        assert len(caught) == 1 and f"(the first: {material.name}, 12 triangles)" in str(caught[0].message)
    render(scene.crop((0, 0, 4, 2)), "balance", 2, parallel=1)
    assert scene.plan.groups
    pickle.loads(pickle.dumps(scene))
    with pytest.warns(SceneWarning, match="texture coordinates"):
        Scene(scene.camera, scene.parts, scene.lights)
    # what has coordinates, or the same colour everywhere
    load_scene(quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), material=matte(image))
    load_scene(bare, material=matte(Image(np.full((2, 2, 3), 0.5))))
    load_scene(bare, material=matte(0.5))


# What is not read, or not as it may be meant


def unread_files(folder):
    """Files by what they hold beside triangles."""
    red = trimesh.Trimesh(BOX.vertices, BOX.faces, vertex_colors=np.full((8, 4), 255, np.uint8), process=False)
    for suffix in ("ply", "obj"):
        red.export(folder / f"red.{suffix}")
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl wood\nf 1 2 3\nusemtl glass\nf 1 3 2\nusemtl wood\nf 2 1 3\n"
    (folder / "two.obj").write_text(text)
    (folder / "grain.ply").write_text(triangle_ply(comment="TextureFile wood grain.png"))
    file = File().mesh()
    file.json |= {"animations": [{}, {}], "extensionsUsed": ["KHR_materials_sheen"]}
    return {
        file.write(folder / "moved.glb"): "animation (2), extension KHR_materials_sheen",
        folder / "two.obj": "material 'wood' without a definition, material 'glass' without a definition",
        folder / "grain.ply": "texture",
        **dict.fromkeys((folder / "red.ply", folder / "red.obj"), "vertex colours"),
    }


def test_materials_of_mesh_files_that_are_not_read_are_named(tmp_path, capsys):
    """In a warning if none is given in their place, and by info."""
    for path, named in unread_files(tmp_path).items():
        with pytest.warns(SceneWarning) as caught:
            scene = load_scene(path, (8, 8))
        assert [str(one.message) for one in caught] == [f"{path}: left out: {named}"]
        assert caught[0].filename == __file__
        assert ", ".join(scene.source["unread"]) == named
        with warnings.catch_warnings(record=True, action="always") as caught:
            unread = load_scene(path, (8, 8), material=matte(0.2)).source.get("unread", [])
        assert unread == ["animation (2)"] * (path.suffix == ".glb") and len(caught) == len(unread)
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            assert main(["info", str(path), "--resolution", "8x8"]) == 0
        output = capsys.readouterr()
        assert f"not read from the file: {named}\n" in output.out and f"left out: {named}" in output.err


# Models that emit -----------------------------------------------------------------------------------------------------

GREY = {"pbrMetallicRoughness": {"metallicFactor": 0}}
FLOOR = np.float32([[-4, -1, 4], [4, -1, 4], [4, -1, -4], [-4, -1, -4]])
SMALL = np.float32([0.02, 0.02, 1]) * CORNERS
DOWN = np.float32([[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]])


def glowing(*colour):
    return {"emissiveFactor": colour}


def test_emission_that_lights_nothing(tmp_path, capsys):
    """Sky and lamp stay, whatever the brightness, and why is said; the surface emits beside them."""
    wall = File().mesh(glowing(1, 1, 1), SMALL, uv=None).mesh(GREY, FLOOR, uv=None)
    for file, colour in ((File().mesh(glowing(0.002, 0, 0), uv=None), (0.002, 0, 0)), (wall, (1, 1, 1))):
        scene = file.load(tmp_path, resolution=(12, 8))
        sky, _, light = scene.lights
        assert isinstance(sky, EnvironmentLight) and scene.parts[0].light is light and light.radiance == colour
        assert scene.suggested.integrator is None and "lit" not in scene.source
        assert np.median(dmis.render(scene, "balance", 4, parallel=1).image) > 0.05
        assert main(["info", str(tmp_path / "a.glb")]) == 0
        assert "a sky and a lamp, because its emission reaches only 0.0% of the image" in capsys.readouterr().out


def test_what_lights_a_model(tmp_path, capsys):
    """Nothing is added, and what lights it is said; lights that are given replace nothing of it."""
    file = File().mesh(GREY, FLOOR, uv=None).mesh(glowing(1e-4, 1e-4, 1e-4), DOWN, uv=None)
    scene = file.load(tmp_path)
    assert len(scene.lights) == 1 and scene.suggested.integrator == "path"
    assert scene.source["lit"].startswith("its emission, which reaches ")
    assert main(["info", str(tmp_path / "a.glb")]) == 0
    assert "  lit by its emission, which reaches " in capsys.readouterr().out
    sun = dmis.DistantLight((0, 1, 0), (1, 1, 1))
    assert file.load(tmp_path, lights=[sun]).lights[0] is sun and len(file.load(tmp_path, lights=[sun]).lights) == 2
    # lights of the file light it
    file = File().mesh(glowing(0.002, 0, 0), uv=None)
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    file.json["nodes"].append({"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 0, 3]})
    scene = file.load(tmp_path)
    assert len(scene.lights) == 2 and scene.source["lit"] == "its lights"
    assert scene.source["added"] == ["a camera that sees all of it, because it has none"]


def test_lit_share_of_a_small_lamp():
    """The radiance rho / pi L A h^2 / (h^2 + r^2)^2 of a floor is above 1/1000 L within a circle."""
    albedo, side, height = 0.8, 0.2, 1.0
    half = np.sqrt(np.sqrt(albedo * side**2 * height**2 / (np.pi * LIT)) - height**2)
    corners = [(x * side / 2, y * side / 2, height) for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    lamp = MeshLight(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), (7, 7, 7))
    floor = dmis.Part(quad((-9, -9, 0), (18, 0, 0), (0, 18, 0)), dmis.matte(albedo))
    camera = dmis.Camera.look_at((0, 0, 50), (0, 0, 0), (0, 1, 0), fov=2 * np.degrees(np.arctan(3 / 50)))
    scene = dmis.Scene(camera, (floor, dmis.light_part(lamp)), (lamp,))
    assert lit_share(scene) == pytest.approx(np.pi * half**2 / 48, abs=0.012)


def test_lamps_that_overlap_across_meshes(tmp_path):
    """The second one, in part in the place of the first, loses its emission with a warning, and renders."""
    file = File()
    for x, z, colour in ((0, 0, (1, 0, 0)), (0.5, 3e-6, (0, 1, 0)), (2.6, 0, (0, 0, 1))):  # rays tell 1e-5 apart
        file.mesh(glowing(*colour), uv=None, node={"translation": [x, 0, z]})
    with pytest.warns(SceneWarning, match="left out: emission of a surface that overlaps another lamp$"):
        scene = file.load(tmp_path, lights=[])
    assert [light.radiance for light in scene.lights] == [(1, 0, 0), (0, 0, 1)]
    assert scene.parts[1].light is None and scene.parts[1].material.lobes
    with pytest.warns(SceneWarning, match="is nearer to"):  # and not an error
        scene.in_float32[0].prepare()
    back_to_back = File().mesh(glowing(1, 1, 1)).mesh(glowing(1, 1, 1), faces=FACES[::-1])
    assert len(back_to_back.load(tmp_path, lights=[]).lights) == 2
