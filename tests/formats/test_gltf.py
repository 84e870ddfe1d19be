"""glTF files: each feature and each habit of exporters against the same scene made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from gltf_file import CORNERS, FACES, File
from helpers import script

import dmis
from dmis.brdf.lobe import Lambert
from dmis.formats.gltf.gltf_file import EXTENSIONS
from dmis.formats.mesh_files import load_mesh
from dmis.image import encode_png
from dmis.scene.scene import SceneWarning

pytest.importorskip("OpenImageIO")
room = script("scenes/make_room.py")

DIRECT = {"settings": dmis.Settings(integrator="direct"), "parallel": 1}


def triangles(scene, part=0):
    mesh = scene.parts[part].mesh
    return mesh.vertices[mesh.faces]


EXPECTED = CORNERS[FACES.reshape(-1, 3)].astype(float)


# The room ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    """The room by hand, as GLB and as OBJ, of few pixels."""
    folder = tmp_path_factory.mktemp("room")
    contents = room.things()
    room.write_glb(folder / "room.glb", contents)
    room.write_obj(folder / "room.obj", contents)
    hand = room.by_hand(contents)
    small = replace(hand.camera, resolution=(16, 12))
    return {
        "hand": replace(hand, camera=small),
        "faded": replace(room.by_hand(contents, None), camera=small),
        "glb": dmis.load_scene(folder / "room.glb", (16, 12)),
        "obj": dmis.load_scene(folder / "room.obj", camera=small),
    }


def test_rooms_with_one_seed_are_nearly_equal(rooms):
    """Parts and lights are in one order, so that samples are the same: what differs is rounding."""
    settings = dmis.Settings(integrator="path", max_depth=3)
    images = {
        name: dmis.render(scene, "balance", 16, seed=1, settings=settings, parallel=1).image
        for name, scene in rooms.items()
    }
    assert all(part.material.name == thing.name for part, thing in zip(rooms["glb"].parts, room.things(), strict=False))
    for name, hand in (("glb", "hand"), ("obj", "faded")):
        off = np.abs(images[name] - images[hand]) / (images[hand].mean() + images[hand])
        assert np.median(off) < 1e-3 and (off < 0.02).mean() > 0.9
        np.testing.assert_allclose(images[name].mean(axis=(0, 1)), images[hand].mean(axis=(0, 1)), rtol=1e-3)
    np.testing.assert_allclose(rooms["glb"].camera.to_world, rooms["hand"].camera.to_world, atol=1e-6)
    assert rooms["glb"].camera.fov == pytest.approx(rooms["hand"].camera.fov)


# Geometry ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a.glb", "a.gltf"])
def test_arrays_and_images_in_the_file(tmp_path, name):
    scene = File().mesh({}).load(tmp_path, name)
    np.testing.assert_array_equal(triangles(scene), EXPECTED)
    np.testing.assert_array_equal(scene.parts[0].mesh.uv, [[0, 0], [1, 0], [1, 1], [0, 1]])
    assert "unread" not in scene.source and load_mesh(tmp_path / name).triangles == 2


def test_forms_of_arrays(tmp_path):
    """Positions, normals and bytes of padding in one view of a stride."""
    file = File()
    rows = np.concatenate([CORNERS, np.tile(np.float32([0, 0, 1]), (4, 1)), np.full((4, 1), 9, np.float32)], axis=1)
    view = file.view(rows.tobytes(), byteStride=28)
    names = {"POSITION": file.accessor(view, CORNERS), "NORMAL": file.accessor(view, CORNERS, byteOffset=12)}
    file.primitives([{"attributes": names, "indices": file.array(FACES.astype(np.uint8))}])
    scene = file.load(tmp_path)
    np.testing.assert_array_equal(triangles(scene), EXPECTED)
    np.testing.assert_array_equal(scene.parts[0].mesh.normals, [[0, 0, 1]] * 4)
    # Whole numbers, fractions of their largest value if they are normalized
    file = File()
    corners = np.array([[0, 0, 0, 0], [127, 0, 0, 0], [0, 127, 0, 0]], np.int8)
    view = file.view(corners.tobytes(), byteStride=4)
    position = file.accessor(view, corners[:, :3], normalized=True)
    uv = file.array(np.array([[0, 65535], [65535, 65535], [0, 0]], np.uint16), normalized=True)
    file.primitives([{"attributes": {"POSITION": position, "TEXCOORD_0": uv}}])
    mesh = file.load(tmp_path).parts[0].mesh
    np.testing.assert_allclose(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(mesh.uv, [[0, 0], [1, 0], [0, 1]])


def test_several_primitives_and_instances(tmp_path, monkeypatch):
    """Primitives of one material are one part, wherever the nodes stand."""
    file = File().mesh({"name": "a"}, node={"translation": [5, 0, 0]})
    file.json["materials"].append({"name": "b"})
    file.json["meshes"][0]["primitives"].append({**file.json["meshes"][0]["primitives"][0], "material": 1})
    file.json["nodes"].append({"mesh": 0, "scale": [1, 2, 1]})
    scene = file.load(tmp_path, lights=[])
    assert [(part.material.name, part.mesh.triangles) for part in scene.parts] == [("a", 4), ("b", 4)]
    np.testing.assert_allclose(triangles(scene), np.concatenate([EXPECTED + [5, 0, 0], EXPECTED * [1, 2, 1]]))
    # instances beyond the limit
    monkeypatch.setattr("dmis.formats.gltf.gltf_file.MAX_FACES", 5)
    file = File().mesh()
    file.json["nodes"] *= 3
    with pytest.raises(ValueError, match="at most 5 triangles, and 15 vertices, because instances are copied"):
        file.load(tmp_path)


@pytest.mark.parametrize("scale", [[-1, 1, 1], [1, 1, -1], [-2, -1, -3]])
def test_mirrored_nodes_keep_their_outside(tmp_path, scale):
    """The side that faces outward stays so, for the winding and for normals."""
    normal = np.float32([0.6, 0, 0.8])
    file = File().mesh(node={"scale": scale}, NORMAL=np.tile(normal, (4, 1)))
    mesh = file.load(tmp_path).parts[0].mesh
    corners = mesh.vertices[mesh.faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (outward[:, 2] * scale[2] > 0).all()
    np.testing.assert_allclose(mesh.normals[0], normal / scale / np.linalg.norm(normal / scale), rtol=1e-6)


def test_nodes_below_nodes(tmp_path):
    """A matrix, and below it rotation, scale and translation; other scenes are named."""
    file = File().mesh(node={"rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)], "translation": [1, 0, 0]})
    matrix = np.diag([2.0, 2, 2, 1])
    matrix[:3, 3] = 0, 0, 7
    file.json["nodes"].append({"children": [0], "matrix": matrix.T.ravel().tolist()})
    file.json |= {"scenes": [{"nodes": []}, {"nodes": [1]}], "scene": 1}
    with pytest.warns(SceneWarning, match="left out: other scene$"):
        scene = file.load(tmp_path)
    turned = np.stack([-EXPECTED[..., 1] + 1, EXPECTED[..., 0], EXPECTED[..., 2]], axis=-1)
    np.testing.assert_allclose(triangles(scene), 2 * turned + [0, 0, 7], atol=1e-6)


# Materials --------------------------------------------------------------------------------------------------------

PIXELS = np.random.default_rng(1).integers(0, 256, (4, 6, 3)).astype(np.uint8)
MATTE = {"KHR_materials_specular": {"specularFactor": 0}}


def linear(pixels):
    s = pixels / 255
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)


WRAPS = {33071: lambda x: np.clip(x, 0, 1), 33648: lambda x: 1 - abs(x % 2 - 1), 10497: lambda x: x % 1}


@pytest.mark.parametrize("wraps", [(33071, 10497), (33648, 33071), (10497, 33648), (33648, 33648)])
def test_textures_that_are_placed(tmp_path, wraps):
    """By a second set of coordinates, and wrapped along each axis, looked up from the formulas again.

    The top row of an image is at t = 0; a factor multiplies it.
    """
    file = File()
    place = {"scale": [2, 3], "offset": [0.1, 0.2]}
    sampler = {"wrapS": wraps[0], "wrapT": wraps[1], "magFilter": 9728}
    texture = {"index": file.texture(PIXELS, sampler=0), "texCoord": 1}
    file.json["samplers"] = [sampler]
    texture["extensions"] = {"KHR_texture_transform": place}
    second = np.float32([[0.3, 0.9], [0.9, 0.8], [1.3, 0.2], [-0.2, 0.45]])
    surface = {"baseColorTexture": texture, "metallicFactor": 0, "baseColorFactor": [1, 0.5, 0.25, 1]}
    scene = file.mesh({"pbrMetallicRoughness": surface, "extensions": MATTE}, TEXCOORD_1=second).load(tmp_path)
    part = scene.parts[0]
    got = part.material.lobes[0].reflectance(np.float32(part.mesh.uv.T)).T
    for (x, y), colour in zip(second * [2, 3] + [0.1, 0.2], got, strict=True):
        column, row = (int(min(WRAPS[wrap](z) * n, n - 1)) for wrap, z, n in zip(wraps, (x, y), (6, 4), strict=True))
        np.testing.assert_allclose(colour, linear(PIXELS)[row, column] * [1, 0.5, 0.25], rtol=1e-5)
    assert "unread" not in scene.source


def test_metal_and_roughness(tmp_path):
    """Roughness is in the green channel, metalness in the blue, neither is sRGB; both have factors."""
    file = File()
    surface = {"roughnessFactor": 0.5, "metallicFactor": 0.6}
    surface["metallicRoughnessTexture"] = {"index": file.texture(PIXELS)}
    scene = file.mesh({"pbrMetallicRoughness": surface}).load(tmp_path)
    base, facets = scene.parts[0].material.lobes
    pixels = PIXELS[::-1] / 255
    np.testing.assert_allclose(base.reflectance.texels, 1 - 0.6 * pixels[..., 2:], atol=1e-6)
    expected = np.maximum(0.5 * pixels[..., 1:2], 0.03) ** 2
    np.testing.assert_allclose(facets.roughness.alpha.texels, expected, atol=1e-6)
    copper = {"pbrMetallicRoughness": {"baseColorFactor": [0.9, 0.6, 0.2, 1]}}
    (metal,) = File().mesh(copper).load(tmp_path).parts[0].material.lobes
    assert metal.fresnel.f0 == pytest.approx((0.9, 0.6, 0.2))
    dielectric = {"pbrMetallicRoughness": {"metallicFactor": 0}, "extensions": {"KHR_materials_ior": {"ior": 2}}}
    assert File().mesh(dielectric).load(tmp_path).parts[0].material.lobes[1].fresnel.f0 == pytest.approx(1 / 9)


def test_normal_maps(tmp_path):
    """Red leans to the right in the image and green to its top; scale makes it steeper."""
    file = File()
    for colour, lean in (((255, 128, 255), (1, 0)), ((128, 255, 255), (0, 1))):
        texture = file.texture(np.full((2, 2, 3), colour, np.uint8))
        file.mesh({"normalTexture": {"index": texture, "scale": 0.5}}, node={"translation": [0, 3 * lean[1], 0]})
    scene = file.load(tmp_path, camera=dmis.Camera.look_at((1, 2, 9), (1, 2, 0), (0, 1, 0), 40, (8, 8)))
    origin = np.float32([[1, 1], [0.5, 3.5], [9, 9]])
    down = np.float32([[0, 0], [0, 0], [-1, -1]])
    hits = scene.intersector.closest(origin, down)
    normals = []
    for k in range(2):
        group = scene.plan.groups[scene.plan.face_group[hits.prim[k]]]
        points, _ = scene.shading_points(group, hits, np.array([k]), down)
        normals.append(points.n[:, 0])
    leaning = np.array([0.5, 0.002, 1]) / np.linalg.norm([0.5, 0.002, 1])
    np.testing.assert_allclose(normals, [leaning, leaning[[1, 0, 2]]], atol=3e-3)


def test_images_that_are_placed_apart(tmp_path):
    """Metalness and roughness are their factors then, and emission that cannot be placed is none."""
    file = File()
    texture = file.texture(PIXELS)
    moved = {"index": texture, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
    surface = {"baseColorTexture": {"index": texture}, "metallicRoughnessTexture": moved, "metallicFactor": 0}
    glow = {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0, "texCoord": 1}}
    file.mesh({"pbrMetallicRoughness": surface, **glow})
    with pytest.warns(SceneWarning, match="metalness and roughness placed apart"):
        scene = file.load(tmp_path)
    assert scene.parts[0].light is None and scene.parts[0].material.lobes[1].roughness.alpha == 1


def test_emission(tmp_path):
    """On both sides if the material is double-sided."""
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 5}}
    lamp = {"emissiveFactor": [1, 0.5, 0], "extensions": strength}
    (light,) = File().mesh(lamp).load(tmp_path, lights=[]).lights
    assert light.radiance == (5, 2.5, 0) and len(light.faces) == 2
    scene = File().mesh({**lamp, "doubleSided": True}).load(tmp_path, lights=[])
    assert len(scene.lights[0].faces) == 4 and scene.parts[0].mesh.triangles == 4
    p = np.float32([[1], [0.4], [-1]])
    assert scene.lights[0].hit(p, np.float32([[0], [0], [1]])).emits.all()
    # camera rays see the image
    file = File()
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:3, 4:] = 255, 200, 80
    lamp = {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": file.texture(pixels)}}
    file.mesh(lamp)
    front = dmis.Camera.look_at((1, 0.5, 5), (1, 0.5, 0), (0, 1, 0), fov=9, resolution=(8, 8))
    image = dmis.render(file.load(tmp_path, camera=front, lights=[]), "balance", 16, **DIRECT).image
    assert image[:3, 5:7].min() > 0.05 and image[5:].max() == 0 and image[:, :2].max() == 0
    # normal maps of two sided lamps are named
    file = File()
    glowing = {"emissiveFactor": [1, 1, 1], "doubleSided": True, "normalTexture": {"index": file.texture(PIXELS)}}
    with pytest.warns(SceneWarning, match="left out: normal map of a surface that emits on both sides$"):
        assert file.mesh(glowing).load(tmp_path).parts[0].material.relief is None


GREY = np.float32([[0.1], [0.9], [0.5], [0.3]]).repeat(3, axis=1)
TINTED = {"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [0.5, 1, 1, 1]}, "extensions": MATTE}


@pytest.mark.parametrize("colours, pieces", [(GREY, 1), (np.float32([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]), 4)])
def test_vertex_colours(tmp_path, colours, pieces):
    """They are interpolated along triangles; where the fourth texel would have no colour, triangles are split."""
    (part, *_) = File().mesh(TINTED, uv=None, COLOR_0=colours).load(tmp_path, lights=[]).parts
    mesh, (lobe,) = part.mesh, part.material.lobes
    weights = np.random.default_rng(1).dirichlet((1, 1, 1), (20, len(mesh.faces)))[..., None]
    points, uv = ((values[mesh.faces] * weights).sum(axis=2) for values in (mesh.vertices, mesh.uv))
    for k, face in enumerate(FACES.reshape(-1, 3)):
        affine = np.linalg.solve(np.c_[CORNERS[face][:, :2], np.ones(3)], colours[face] * [0.5, 1, 1])
        xy, st = (values[:, pieces * k :][:, :pieces].reshape(-1, values.shape[2])[:, :2] for values in (points, uv))
        np.testing.assert_allclose(lobe.reflectance(np.float32(st.T)).T, xy @ affine[:2] + affine[2], atol=1e-5)


def test_even_vertex_colours(tmp_path):
    """White ones cost nothing, constant ones are a factor."""
    for value, expected in ((1.0, (0.5, 1, 1)), (0.5, (0.25, 0.5, 0.5))):
        same = np.full((4, 3), value, np.float32)
        (lobe,) = File().mesh(TINTED, uv=None, COLOR_0=same).load(tmp_path).parts[0].material.lobes
        assert lobe.reflectance == pytest.approx(expected)


def test_opacity_of_a_factor_or_vertices(tmp_path):
    """A surface below the cutoff is not there; the opacity of vertices is named, colours above 1 are clipped."""
    surface = {"baseColorFactor": [2, 1, 1, 0.3]}
    clear = {"alphaMode": "MASK", "pbrMetallicRoughness": surface}
    fading = {"alphaMode": "BLEND", "name": "a", "pbrMetallicRoughness": surface}
    file = File().mesh(clear).mesh(fading, COLOR_0=np.float32([[1, 1, 1, 0.5]]).repeat(4, axis=0))
    with pytest.warns(SceneWarning, match="left out: opacity of vertex colours, base colour above 1 of 'a'$"):
        scene = file.load(tmp_path, lights=[])
    assert len(scene.parts) == 1
    file.json["materials"][0]["alphaCutoff"] = 0.3
    with pytest.warns(SceneWarning):
        assert len(file.load(tmp_path, lights=[]).parts) == 2
    # opacity
    glass = {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.25], "metallicFactor": 0}}
    clear, base, _ = File().mesh(glass).load(tmp_path).parts[0].material.lobes
    assert clear.transmittance == (0.75,) and base.reflectance == (0.25, 0.25, 0.25)


OPAQUE = np.full((4, 6, 1), 255, np.uint8)


@pytest.mark.parametrize(
    "mode, cutoff, alpha, parts, masked",
    [
        *(("MASK", 0.25, PIXELS[..., :1], 1, True), ("MASK", 0.25, OPAQUE, 1, False)),
        *(("MASK", 0, 0 * OPAQUE, 1, False), ("MASK", 0.5, 0 * OPAQUE, 1, True), ("MASK", 1.5, 0 * OPAQUE, 0, False)),
        *(("BLEND", None, PIXELS[..., :1], 1, True), ("BLEND", None, OPAQUE, 1, True)),
        *(("OPAQUE", None, PIXELS[..., :1], 1, False), ("OPAQUE", None, OPAQUE, 1, False)),
    ],
)
def test_masks(tmp_path, mode, cutoff, alpha, parts, masked):
    """The opacity of the base colour, times its factor, at least the cutoff: at 0 all is there, above 1 nothing."""
    file = File()
    texture = file.texture(np.concatenate([PIXELS, alpha], axis=2))
    surface = {"baseColorFactor": [1, 1, 1, 0.8], "baseColorTexture": {"index": texture}}
    file.mesh({"pbrMetallicRoughness": surface, "alphaMode": mode, "alphaCutoff": cutoff or 0}).mesh()
    loaded = file.load(tmp_path, lights=[]).parts
    masks = [part.mask for part in loaded if part.mask is not None]
    assert (len(loaded), len(masks)) == (parts + 1, masked)
    for mask in masks:
        np.testing.assert_allclose(mask.image.texels, 0.8 * alpha[::-1] / 255, rtol=1e-6)
        assert mask.cutoff == cutoff


# Lights and cameras -----------------------------------------------------------------------------------------------


def test_lights(tmp_path):
    file = File().mesh()
    turn = {"rotation": [-np.sqrt(0.5), 0, 0, np.sqrt(0.5)]}  # -z becomes -y
    kinds = [{"type": "directional", "intensity": 3}, {"type": "point", "color": [1, 0.5, 0], "intensity": 4}]
    kinds.append({"type": "spot", "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}})
    kinds += [{"type": "spot", "spot": {}}, {"type": "spot"}]
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": kinds}}
    for k in range(5):
        node = {"extensions": {"KHR_lights_punctual": {"light": k}}, "translation": [0, 2, k], **turn}
        file.json["nodes"].append(node)
    sun, point, spot, wide, default = file.load(tmp_path).lights
    np.testing.assert_allclose(sun.direction, [0, 1, 0], atol=1e-6)
    assert sun.radiance == (3, 3, 3) and point.intensity == (4, 2, 0) and point.position == pytest.approx((0, 2, 1))
    np.testing.assert_allclose(spot.direction, [0, -1, 0], atol=1e-6)
    assert (spot.inner, spot.outer, wide.inner, wide.outer) == pytest.approx((*np.degrees([0.1, 0.2]), 0, 45))
    assert (default.inner, default.outer) == pytest.approx((0, 45))


def test_cameras(tmp_path):
    """By name; the first one is the default, unless an axis is up for one that sees all."""
    file = File().mesh()
    lens = {"yfov": 1.0, "aspectRatio": 2.0, "znear": 0.1}
    lenses = lens, {**lens, "aspectRatio": 0.5}
    file.json["cameras"] = [{"type": "perspective", "perspective": each} for each in lenses]
    front = {"camera": 0, "name": "front", "translation": [1, 0.5, 4], "scale": [2, 2, 2]}
    file.json["nodes"] += [front, {"camera": 1}]
    camera = file.load(tmp_path).camera
    assert camera.resolution == (960, 480) and camera.fov == pytest.approx(np.degrees(1))
    x, y, depth, _ = camera.raster(np.array([[1, 0.5, 0], [2, 0.5, 0], [1, 1, 0]]))
    np.testing.assert_allclose(depth, 4)
    assert x[1] > x[0] and y[2] < y[0]
    upright = file.load(tmp_path, camera="camera 1").camera
    assert file.load(tmp_path, camera="1").camera.resolution == upright.resolution
    assert upright.resolution == (240, 480) and upright.fov == pytest.approx(np.degrees(2 * np.arctan(np.tan(0.5) / 2)))
    file.json["cameras"][1] = {"type": "orthographic", "orthographic": {"xmag": 1.5, "ymag": 3, "znear": 0, "zfar": 9}}
    flat = file.load(tmp_path, camera="camera 1").camera
    assert (flat.projection, flat.resolution) == ("orthographic", (240, 480))
    assert np.tan(np.radians(flat.fov / 2)) == pytest.approx(1.5)
    assert file.load(tmp_path, up="y").camera.resolution == (640, 480)
    assert "cameras of the file, the default first: front, camera 1" in file.load(tmp_path).describe()
    with pytest.raises(ValueError, match=r"name or number of one in .*a\.glb: 'front', 'camera 1'; got 'back'"):
        file.load(tmp_path, camera="back")


# What is left out, and what is refused ----------------------------------------------------------------------------


def test_what_is_left_out_is_named(tmp_path):
    file = File()
    clear = np.full((2, 2), 255, np.uint8)
    texture = file.texture(clear, sampler=0)
    file.json |= {"animations": [{}], "extensionsUsed": [*EXTENSIONS, "KHR_materials_sheen"]}
    file.json["samplers"] = [{"wrapS": 33648}]  # which is read
    material = {"emissiveTexture": {"index": 0, "texCoord": 1}, "emissiveFactor": [1] * 3}
    material["normalTexture"] = {"index": 0, "extensions": {"KHR_texture_transform": {"rotation": 1}}}
    material["extensions"] = {"KHR_materials_specular": {"specularTexture": {"index": 0}}}
    file.mesh({**material, "pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    path = file.write(tmp_path / "a.glb")
    with pytest.warns(SceneWarning) as caught:
        scene = dmis.load_scene(path)
    assert set(scene.source["unread"]) == {
        "texture of a coat",
        "emissiveTexture with other coordinates than baseColorTexture",
        "normalTexture that is rotated",
        "animation",
        "extension KHR_materials_sheen",
    }
    assert len(caught) == 1 and caught[0].filename == __file__
    file.json["extensionsRequired"] = ["KHR_texture_transform"]
    with pytest.raises(ValueError, match=r"a\.glb.*requires normalTexture to be rotated"):
        file.load(tmp_path)
    file = File().mesh()
    file.json["meshes"][0]["primitives"] += [{"attributes": {"POSITION": 0}, "mode": mode} for mode in (0, 1, 3)]
    file.json["meshes"][0]["weights"] = [0, 1]
    with pytest.warns(SceneWarning, match=r"out: morphed mesh .*as it is modelled\), set of points or lines \(3\)$"):
        assert len(file.load(tmp_path).parts) == 2  # with the default lamp's
    # an unlit surface is matte, and named; a hidden node and its children are left out, as they should be
    unlit = {"KHR_materials_unlit": {}}
    file = File().mesh({"extensions": unlit, "pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.6, 1]}})
    file.json["nodes"].append({"children": [2], "extensions": {"KHR_node_visibility": {"visible": False}}})
    file.json["nodes"].append({"mesh": 0})
    file.json["extensionsUsed"] = ["KHR_materials_unlit", "KHR_node_visibility"]
    with pytest.warns(SceneWarning, match="left out: extension KHR_materials_unlit$"):
        (part, _) = file.load(tmp_path).parts  # and the lamp
    (lobe,) = part.material.lobes
    assert part.mesh.triangles == 2
    assert isinstance(lobe, Lambert) and lobe.reflectance == pytest.approx((0.2, 0.4, 0.6))


HUGE = {"componentType": 5126, "count": 10**7, "type": "VEC3"}


@pytest.mark.parametrize(
    "change, message",
    [
        ({"accessors": [{"bufferView": 0, **HUGE}]}, "more elements than"),
        ({"accessors": [{"bufferView": 0, **HUGE, "sparse": {}}]}, "accessor 0 must not be sparse or without data"),
        ({"accessors": [HUGE]}, "accessor 0 must not be sparse or without data; export it without"),
        ({"meshes": [{"primitives": [{"attributes": {}, "mode": 5}]}]}, "mesh 0 must be a list of triangles; export"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 10**9}]}, "must be within the .* bytes of its buffer"),
        ({"buffers": [{"byteLength": 4, "uri": "../outside.bin"}]}, "is outside of the folder .*--allow-outside"),
        ({"buffers": [{"byteLength": 4, "uri": "no.bin"}]}, "there is no file 'no.bin' in its folder"),
        ({"nodes": [{"mesh": 0, "children": [1]}, {"children": [2]}, {"children": [1]}]}, "has several parents"),
        ({"nodes": [{"mesh": 5}]}, "names number 5 of its meshes, of which it has 1"),
        ({"extensionsRequired": ["EXT_meshopt_compression"]}, "requires EXT_meshopt_compression, which is not read"),
        ({"asset": {"version": "1.0"}}, "must be glTF of version 2; got version '1.0'"),
        ({"nodes": [{"mesh": 0, "scale": [1e400, 1, 1]}]}, "matrix of a node must be finite"),
        ({"nodes": [{"mesh": 0, "matrix": [*[0] * 15, 2]}]}, "must be finite and affine"),
        ({"meshes": [{"primitives": [{"attributes": {}}]}]}, "is empty, damaged, or of a form that is not read"),
    ],
)
def test_bad_files(tmp_path, change, message):
    (tmp_path / "outside.bin").write_bytes(bytes(100))
    (tmp_path / "model").mkdir()
    file = File().mesh(uv=None, faces=None, corners=CORNERS[:3])
    file.json |= change
    with pytest.raises(ValueError, match=r"a\.glb.*" + message):
        file.load(tmp_path / "model")


def test_extensions_of_materials_that_are_replaced(tmp_path):
    """What a file requires of materials or textures matters only where they are used; its fields are its own."""
    volume = {"KHR_materials_volume": {"scale": {}, "mode": "x"}}
    file = File().mesh({"extensions": volume, "extras": {"count": "many"}})
    file.json["extensionsUsed"] = file.json["extensionsRequired"] = ["KHR_materials_volume", "KHR_texture_basisu"]
    assert file.load(tmp_path, material=dmis.matte()).parts
    assert load_mesh(tmp_path / "a.glb").triangles == 2
    with pytest.raises(ValueError, match="requires KHR_materials_volume, KHR_texture_basisu, which is not read"):
        dmis.load_scene(tmp_path / "a.glb")


def test_files_beside_it(tmp_path):
    """A .gltf file with a .bin and a picture, whose names are percent-encoded."""
    file = File()
    (tmp_path / "my picture.png").write_bytes(encode_png(PIXELS))
    (tmp_path / "a.bin").write_bytes(CORNERS.tobytes())
    file.json |= {
        "buffers": [{"byteLength": 48, "uri": "a.bin"}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}],
        "images": [{"uri": "my%20picture.png"}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "extensions": MATTE}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "nodes": [{"mesh": 0}],
    }
    with pytest.warns(SceneWarning, match="no texture coordinates"):
        scene = file.load(tmp_path, "a.gltf")
    np.testing.assert_array_equal(triangles(scene), EXPECTED[:1])
    (metal,) = scene.parts[0].material.lobes
    assert metal.fresnel.f0.texels.shape == (4, 6, 3)
    (tmp_path / "my picture.png").unlink()
    with pytest.warns(SceneWarning, match="left out: missing file 'my picture.png'$"):
        scene = dmis.load_scene(tmp_path / "a.gltf")
    assert scene.parts[0].material.lobes[0].fresnel.f0 == (1, 1, 1)
