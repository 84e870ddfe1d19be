"""The pbrt reader, on pbrt-v2: transforms, sides, defaults and quirks by hand, bad input by its message."""

import functools
import os
import warnings

import numpy as np
import pytest
from helpers import tga

import dmis
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.fresnel import Dielectric
from dmis.brdf.lobe import Lambert, OrenNayar
from dmis.brdf.materials import COPPER_ETA, COPPER_K
from dmis.brdf.microfacet import Microfacet
from dmis.brdf.specular import SpecularReflection, SpecularTransmission
from dmis.brdf.texture import Image
from dmis.formats.pbrt import reader
from dmis.formats.pbrt.notes import PbrtWarning
from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.tokens import PbrtError
from dmis.geometry.mesh import flat_normals
from dmis.image import write_exr
from dmis.light.area import DiskLight, QuadLight, SphereLight
from dmis.light.delta import DistantLight, PointLight, SpotLight
from dmis.light.environment import EnvironmentLight
from dmis.light.mesh_light import MeshLight
from dmis.scene.camera import Camera

POINTS = '"point P" [0 0 0  1 0 0  0 1 0]'
TRIANGLE = f'Shape "trianglemesh" "integer indices" [0 1 2] {POINTS}\n'
TEXTURED = TRIANGLE[:-1] + ' "float uv" [0 0 1 0 0 1]\n'
SQUARE = 'Shape "trianglemesh" "integer indices" [0 1 2  0 2 3] "point P" [0 0 0  2 0 0  2 1 0  0 1 0]\n'
TETRAHEDRON = '"point P" [0 0 0 1 0 0 0 1 0 0 0 1] "integer indices" [0 2 1 0 1 3 0 3 2 1 2 3]'


@pytest.fixture
def read(tmp_path):
    """Reads a scene with the given world and options; a triangle is added, so that there is something to see."""

    def read(world="", options="", add=TRIANGLE, **arguments):
        path = tmp_path / "scene.pbrt"
        v2 = "" if "Integrator" in options or "dialect" in arguments else 'SurfaceIntegrator "directlighting" '
        path.write_text(f"{v2}{options}\nWorldBegin\n{world}\n{add}WorldEnd\n")
        return read_pbrt(path, **arguments)

    return read


def points(scene, part=0):
    return scene.parts[part].mesh.vertices


def material(scene):
    return scene.parts[-1].material


def close(value, expected):
    np.testing.assert_allclose(value, expected, rtol=1e-6, atol=1e-9)


def exr(path, texels):
    write_exr(path, {"RGB": np.asarray(texels, np.float32)})
    return path


# Transforms -------------------------------------------------------------------------------------------------------

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)


@pytest.mark.parametrize(
    "text, expected",
    [
        ("Translate 1 2 3", CORNERS + [1, 2, 3]),
        ("Scale 2 3 4", CORNERS * [2, 3, 4]),
        ("Rotate 90 0 0 1", [[0, 0, 0], [0, 1, 0], [-1, 0, 0]]),
        ("Translate 1 0 0 Scale 2 2 2", CORNERS * 2 + [1, 0, 0]),
        ("Scale 2 2 2 Translate 1 0 0", CORNERS * 2 + [2, 0, 0]),
        ("Translate 9 9 9 Transform [1 0 0 0  0 1 0 0  0 0 1 0  4 5 6 1]", CORNERS + [4, 5, 6]),
        ("Translate 1 0 0 ConcatTransform [0 1 0 0  -1 0 0 0  0 0 1 0  4 5 6 1]", [[5, 5, 6], [5, 6, 6], [4, 5, 6]]),
        ("TransformBegin Translate 1 2 3 TransformEnd", CORNERS),
        ("AttributeBegin Translate 1 2 3 AttributeEnd", CORNERS),
        ('Translate 1 2 3 CoordinateSystem "a" Scale 9 9 9 CoordSysTransform "a"', CORNERS + [1, 2, 3]),
        ('Translate 1 2 3 CoordSysTransform "world"', CORNERS),
        ("LookAt 0 0 5  0 0 0  0 1 0", [[0, 0, 5], [-1, 0, 5], [0, 1, 5]]),
        ("Translate 1 # of a comment, 2\n 2 3", CORNERS + [1, 2, 3]),
    ],
)
def test_transforms(read, text, expected):
    close(points(read(text)), expected)


# Camera -----------------------------------------------------------------------------------------------------------


def test_camera(read):
    options = 'LookAt 1 2 3  1 7 3  0 0 1\nCamera "perspective" "float fov" [60]'
    camera = read(options=options).camera
    # x = up x d = z x y = -x: the image is the mirror image of a photograph of the same numbers
    close(camera.to_world, [[-1, 0, 0, 1], [0, 0, 1, 2], [0, 1, 0, 3], [0, 0, 0, 1]])
    photograph = Camera.look_at((1, 2, 3), (1, 7, 3), (0, 0, 1), 60.0).to_world
    close(camera.to_world, photograph @ np.diag([-1, 1, 1, 1]))
    assert camera.fov == 60
    assert camera.resolution == (640, 480)
    # half of 60 degrees to the top, the middle of the upper edge; the world's +x is on the left
    top = camera.rays(np.float32([320]), np.float32([0]))[:, 0]
    np.testing.assert_allclose(top, [0, np.cos(np.pi / 6), np.sin(np.pi / 6)], atol=1e-6)
    assert camera.rays(np.float32([0]), np.float32([240]))[0, 0] > 0.6
    # mirrored camera is right handed
    options = 'Scale -1 1 1\nLookAt 1 2 3  1 7 3  0 0 1\nCamera "perspective" "float halffov" 20'
    camera = read(options=options).camera
    close(camera.to_world[:3, 0], [1, 0, 0])
    assert camera.fov == 40
    # shares of the image become pixels as in pbrt, rounded up; a resolution given in its place scales them
    film = 'Film "image" "integer xresolution" 100 "integer yresolution" 50 "float cropwindow" [.25 .5 .1 .91]'
    camera = read(options=film).camera
    assert (camera.resolution, camera.corner, camera.frame) == ((25, 41), (25, 5), (100, 50))
    # transforms before the world do not move it
    close(points(read(options="Translate 1 2 3\nScale 2 2 2")), CORNERS)


# Lights -----------------------------------------------------------------------------------------------------------


def one_light(scene, kind):
    (light,) = scene.lights
    assert isinstance(light, kind)
    return light


def test_lights_without_a_shape(read):
    """Position, direction and strength; the `from` of a point light is added in world space."""
    point = 'LightSource "point" "color I" [1 2 3] "color scale" [2 2 2] "point from" [5 6 7]'
    light = one_light(read(f"Scale 2 2 2 Translate 1 0 0 {point}"), PointLight)
    close([light.position, light.intensity], [[7, 6, 7], [2, 4, 6]])
    spot = 'LightSource "spot" "point from" [1 0 0] "point to" [3 0 0] "float coneangle" 40'
    light = one_light(read(f"Rotate 90 0 0 1 {spot}"), SpotLight)
    close([light.position, light.direction], [[0, 1, 0], [0, 2, 0]])
    assert (light.outer, light.inner) == (40, 35)
    light = one_light(read('LightSource "spot"'), SpotLight)
    assert (light.outer, light.inner, light.direction, light.intensity) == (30, 25, (0, 0, 1), (1, 1, 1))
    distant = 'LightSource "distant" "point from" [0 0 2] "point to" [0 0 1] "color L" [3 3 3]'
    light = one_light(read(distant), DistantLight)
    close([light.direction, light.radiance], [[0, 0, 1], [3, 3, 3]])
    options = 'LookAt 1 2 3  1 7 3  0 0 1\nCamera "perspective"'  # a headlight
    light = one_light(read('CoordSysTransform "camera" LightSource "distant"', options), DistantLight)
    close(light.direction, [0, -1, 0])


@pytest.mark.parametrize("delta, inner", [(5, 1), (20, 4)])
def test_spot_whose_falloff_is_wider_than_its_cone(read, delta, inner):
    """Only the cosine of the inner angle counts: -1 degree is 1 degree, and more than the cone is all of it."""
    text = f'LightSource "spot" "float coneangle" 4 "float conedeltaangle" {delta}'
    assert read(text).lights[0].inner == inner


def test_infinite_light(read, tmp_path):
    texels = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
    exr(tmp_path / "sky.exr", texels)
    world = 'Rotate 90 0 0 1 Scale 3 3 3 LightSource "infinite" "string mapname" "sky.exr" "color L" [1 2 3]'
    light = one_light(read(world), EnvironmentLight)
    close(light.texels, texels)
    close(light.to_world, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    close(light.scale, [1, 2, 3])
    assert light.wrap == "repeat"
    light = one_light(read('LightSource "infinite" "rgb L" [.5 .5 .5]'), EnvironmentLight)
    close(light.radiance(np.array([[0], [0], [1]], np.float32)), [[0.5]] * 3)


AREA = 'AreaLightSource "area" "color L" [4 5 6] "color scale" [2 2 2]\n'


@pytest.mark.parametrize(
    "transform, centre, normal, radius",
    [
        ("", (0, 0, 1), (0, 0, 1), 3),
        ("ReverseOrientation", (0, 0, 1), (0, 0, -1), 3),
        ("ReverseOrientation ReverseOrientation", (0, 0, 1), (0, 0, 1), 3),
        ("Translate 1 2 3 Scale 2 2 2", (1, 2, 5), (0, 0, 1), 6),
        ("Rotate 90 1 0 0", (0, -1, 0), (0, -1, 0), 3),
        ("Scale 1 1 -1", (0, 0, -1), (0, 0, -1), 3),
        ("Scale -1 1 1", (0, 0, 1), (0, 0, 1), 3),
        ("Scale -1 1 1 ReverseOrientation", (0, 0, 1), (0, 0, -1), 3),
    ],
)
def test_disk_light(read, transform, centre, normal, radius):
    scene = read(AREA + transform + ' Shape "disk" "float radius" 3 "float height" 1', add="")
    light = one_light(scene, DiskLight)
    close(light.centre, centre)
    close(np.asarray(light.normal) / np.linalg.norm(light.normal), normal)
    assert light.radius == pytest.approx(radius)
    close(light.radiance, (8, 10, 12))
    (part,) = scene.parts
    assert part.light is light
    close(flat_normals(part.mesh.vertices, part.mesh.faces), np.tile(normal, (len(part.mesh.faces), 1)))


@pytest.mark.parametrize(
    "transform, radius, centre", [("", 3, (0, 0, 0)), ("Scale -2 2 2", 6, (0, 0, 0)), ("Translate 1 2 3", 3, (1, 2, 3))]
)
def test_sphere_light_shines_outwards(read, transform, radius, centre):
    """Or inwards, by ReverseOrientation alone."""
    shape = f'{transform} Shape "sphere" "float radius" 3'
    scene = read(AREA + shape, add="")
    light = one_light(scene, SphereLight)
    close([*light.centre, light.radius], [*centre, radius])
    assert outwards(scene.parts[0].mesh, light.centre) > 0
    (part,) = read(f"{AREA} ReverseOrientation {shape}", add="", resolution=(40, 30)).parts
    assert outwards(part.mesh, light.centre) < 0
    close(part.light.vertices, part.mesh.vertices)


def outwards(mesh, centre):
    """The least (or, if negative, largest) of the cosines between normals and the way from the centre."""
    corners = mesh.vertices[mesh.faces].mean(axis=1) - centre
    cos = np.einsum("ij,ij->i", corners, flat_normals(mesh.vertices, mesh.faces))
    assert (cos > 0).all() or (cos < 0).all()
    return cos[0]


@pytest.mark.parametrize(
    "transform, z", [("", 1), ("ReverseOrientation", -1), ("Scale -1 1 1", -1), ("Scale 3 1 1", 1)]
)
def test_parallelogram_light(read, transform, z):
    scene = read(AREA + transform + " " + SQUARE, add="")
    light = one_light(scene, QuadLight)
    normal = np.cross(light.edge_u, light.edge_v)
    close(normal, [0, 0, z * (6 if "3" in transform else 2)])
    close(flat_normals(scene.parts[0].mesh.vertices, scene.parts[0].mesh.faces), [[0, 0, z]] * 2)
    corners = light.corner + np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) @ [light.edge_u, light.edge_v]
    assert {tuple(c) for c in corners} == {tuple(v) for v in scene.parts[0].mesh.vertices}


@pytest.mark.parametrize("first", ["0 1 2", "1 2 0", "2 0 1"])
@pytest.mark.parametrize("second", ["0 2 3", "2 3 0", "3 0 2"])
def test_every_order_of_a_parallelogram(read, first, second):
    scene = read(AREA + SQUARE.replace("0 1 2  0 2 3", f"{first} {second}"), add="")
    close(np.cross(one_light(scene, QuadLight).edge_u, scene.lights[0].edge_v), [0, 0, 2])


@pytest.mark.parametrize(
    "shape",
    [
        SQUARE.replace("0 2 3", "0 3 2"),  # the two triangles face different ways
        SQUARE.replace("0 1 0]", "0 1.5 0]"),  # a trapezium
        TRIANGLE,
        'Shape "cylinder"',
        f'Shape "loopsubdiv" "integer nlevels" 1 {TETRAHEDRON}',
    ],
)
def test_other_shapes_make_mesh_lights(read, shape):
    scene = read(AREA + shape, add="")
    light = one_light(scene, MeshLight)
    assert len(light.faces) == len(scene.parts[0].mesh.faces)
    close(light.radiance, (8, 10, 12))


# Materials --------------------------------------------------------------------------------------------------------


def lobes(scene):
    return material(scene).lobes


GREY = [0.5] * 3
LOBES = [  # a Material line; its lobes; attributes of some of them, as "lobe.attribute", with their values
    ("matte", [Lambert], {"0.reflectance": GREY}),
    ("plastic", [Lambert, Microfacet], {"0.reflectance": [0.25] * 3, "1.reflectance": [0.25] * 3}),
    ("plastic", [Lambert, Microfacet], {"1.distribution.exponent": 10, "1.fresnel.eta": 1 / 1.5}),  # indices swapped
    ("metal", [Microfacet], {"0.fresnel.eta": COPPER_ETA, "0.fresnel.k": COPPER_K, "0.distribution.exponent": 100}),
    (
        'metal" "color eta" [1 2 3] "rgb k" [4 5 6]',
        [Microfacet],
        {"0.fresnel.eta": (1, 2, 3), "0.fresnel.k": (4, 5, 6)},
    ),
    *((f'metal" "float roughness" {r}', [Microfacet], {"0.distribution.exponent": 1e4}) for r in (0, 1e-5, 1e-300)),
    ("substrate", [BlendBase, BlendCoat], {"0.diffuse": GREY, "0.specular": GREY, "1.distribution.exponent": 10}),
    ('substrate" "float vroughness" 0', [BlendBase, BlendCoat], {"1.distribution.u": 10, "1.distribution.v": 10_000}),
    ("uber", [Lambert, Microfacet], {}),
    ('uber" "color opacity" [.5 1 1.2]', [SpecularTransmission, Lambert, Microfacet], {"0.transmittance": [0.5, 0, 0]}),
    ("mirror", [SpecularReflection], {"0.reflectance": [0.9] * 3}),
    ("glass", [SpecularReflection, SpecularTransmission], {"0.fresnel.eta": 1.5, "1.eta": 1.5, "1.scaled": False}),
    ('shinymetal" "color Ks" [.25 .25 .25]', [Microfacet, SpecularReflection], {"0.fresnel.eta": [3] * 3}),
    ('matte" "color Kd" [0 0 0]', [], {}),
]


@pytest.mark.parametrize("line, kinds, values", LOBES)
def test_lobes_of_materials(read, line, kinds, values):
    found = lobes(read(f'Material "{line}' + '"' * (line.count('"') % 2 == 0)))
    assert [type(lobe) for lobe in found] == kinds
    for path, value in values.items():
        number, *names = path.split(".")
        close(functools.reduce(getattr, names, found[int(number)]), value)


def test_matte_and_uber(read):
    with pytest.warns(PbrtWarning):
        (lobe,) = lobes(read('Material "matte" "color Kd" [-1 .5 2] "float sigma" 120'))
    assert isinstance(lobe, OrenNayar) and lobe.sigma == 90
    close(lobe.reflectance, (0, 0.5, 2))
    # uber
    text = 'Material "uber" "color Kr" [.1 .2 .3] "color Kt" [.3 .2 .1] "color opacity" [.5 .5 .5] "float index" 2'
    clear, diffuse, coat, mirror, through = lobes(read(text))
    assert coat.fresnel == mirror.fresnel == Dielectric(0.5)
    assert (clear.eta, through.eta, through.scaled) == (1, 0.5, False)
    close([clear.transmittance, diffuse.reflectance], [[0.5] * 3, [0.125] * 3])
    close([mirror.reflectance, through.transmittance], [[0.05, 0.1, 0.15], [0.15, 0.1, 0.05]])


@pytest.mark.parametrize("integrator", ["directlighting", "path"])
@pytest.mark.parametrize("opacity, index", [(1, 1.5), (1, 0.7)])
def test_refracted_radiance_is_not_divided_by_eta2(read, integrator, opacity, index):
    """As in pbrt-v2: one sheet of glass under a sky of 1 shows 1 from both sides."""
    for turn in ("", "ReverseOrientation"):
        world = f'LightSource "infinite" Material "glass" "float index" {index} {turn}'
        square = '"point P" [-9 -9 2 9 -9 2 9 9 2 -9 9 2] "integer indices" [0 1 2 0 2 3]'
        head = f'SurfaceIntegrator "{integrator}" Film "image" "integer xresolution" 4 "integer yresolution" 4'
        scene = read(world, head, add=f'Shape "trianglemesh" {square}')
        image = dmis.render(scene, "balance", 64).image
        np.testing.assert_allclose(image, 1, rtol=1e-4)


def test_vertices_of_shapes(read):
    """Exporters write some; from mesh files they are mended, too."""
    for z in (1, -1):  # on the side of the others
        mesh = read(add=TRIANGLE[:-1] + f'"normal N" [0 0 {z} 0 .6 {0.8 * z} 0 0 0]\n').parts[0].mesh
        close(mesh.normals, [[0, 0, z], [0, 0.6, 0.8 * z], [0, 0, z]])
    # uv comes before st
    (part,) = read(add=TEXTURED[:-1] + ' "float st" [5 5 6 5 5 6]\n').parts
    np.testing.assert_array_equal(part.mesh.uv, [[0, 0], [1, 0], [0, 1]])
    # loopsubdiv has three levels by default
    (part,) = read(f'Shape "loopsubdiv" {TETRAHEDRON}', add="").parts
    assert part.mesh.triangles == 4 * 4**3
    assert part.mesh.normals is not None and part.mesh.uv is None


@pytest.mark.parametrize(
    "kind, value, rgb",
    [
        ("color", "[.1 .2 .3]", (0.1, 0.2, 0.3)),
        ("rgb", "[.1 .2 .3]", (0.1, 0.2, 0.3)),
        ("xyz", "[.950456 1 1.088754]", (1, 1, 1)),
        ("spectrum", "[300 .5 800 .5]", (0.602443, 0.474114, 0.454634)),
        ("spectrum", '"half.spd"', (0.602443, 0.474114, 0.454634)),
        ("blackbody", "[0 1]", (0, 0, 0)),
    ],
)
def test_types_of_spectra(read, tmp_path, kind, value, rgb):
    (tmp_path / "half.spd").write_text("# flat\n300 .5\n800 .5\n")
    scene = read(f'Material "mirror" "{kind} Kr" {value}')
    if any(rgb):
        np.testing.assert_allclose(lobes(scene)[0].reflectance, rgb, atol=2e-5)
    else:
        assert lobes(scene) == ()


def test_named_materials(read):
    world = """
    Material "matte" "color Kd" [.1 .1 .1]
    MakeNamedMaterial "a" "string type" "matte"
    MakeNamedMaterial "b" "string type" "plastic" "color Kd" [.4 .4 .4]
    NamedMaterial "b"
    AttributeBegin
      NamedMaterial "a"
    """
    scene = read(world + TRIANGLE + "AttributeEnd\n" + TRIANGLE + 'Material "mirror"')
    close(scene.parts[0].material.lobes[0].reflectance, [0.1] * 3)  # what it lacks is from the Material line
    close(scene.parts[1].material.lobes[0].reflectance, [0.4] * 3)
    assert [part.material.name for part in scene.parts] == ["matte", "plastic", "mirror"]
    # texture of the material line beats constant of a named material
    world = 'Texture "t" "color" "constant" "color value" [.3 .3 .3] Material "matte" "texture Kd" "t"\n'
    scene = read(world + 'MakeNamedMaterial "a" "string type" "matte" "color Kd" [.2 .2 .2] NamedMaterial "a"')
    close(lobes(scene)[0].reflectance, [0.3] * 3)
    other = 'Texture "u" "color" "constant" "color value" [.7 .7 .7] MakeNamedMaterial "a" "string type" "matte" '
    close(lobes(read(f'{world} {other} "texture Kd" "u" NamedMaterial "a"'))[0].reflectance, [0.7] * 3)


# Textures ---------------------------------------------------------------------------------------------------------


def kd(scene):
    return lobes(scene)[0].reflectance


def test_constant_and_scaled_textures(read):
    world = """
    Texture "a" "color" "constant" "color value" [.2 .4 .8]
    Texture "b" "spectrum" "scale" "texture tex1" "a" "color tex2" [.5 .5 .25]
    Texture "r" "float" "constant" "float value" .5
    Texture "s" "float" "scale" "texture tex1" "r" "float tex2" .5
    Texture "one" "color" "constant"
    Material "plastic" "texture Kd" "b" "texture roughness" "s" "texture Ks" "one"
    """
    diffuse, coat = lobes(read(world))
    close(diffuse.reflectance, (0.1, 0.2, 0.2))
    assert coat.distribution.exponent == pytest.approx(4)
    close(coat.reflectance, (1, 1, 1))


def test_imagemap(read, tmp_path):
    texels = np.arange(1, 25, dtype=np.float32).reshape(2, 4, 3)
    exr(tmp_path / "a.exr", texels)
    world = """
    Texture "a" "color" "imagemap" "string filename" "a.exr" "float uscale" 2 "float vdelta" .5 "string wrap" "clamp"
        "float scale" .5 "float gamma" 2
    Texture "b" "color" "scale" "texture tex1" "a" "color tex2" [1 2 4]
    Material "matte" "texture Kd" "b"
    """
    with pytest.warns(PbrtWarning, match="reflectance above 1, .*: 'Kd' of Material"):
        image = kd(read(world, add=TEXTURED))
    assert isinstance(image, Image)
    close(image.texels, (texels / 2) ** 2 * [1, 2, 4])
    assert (image.scale, image.offset, image.wrap) == ((2, 1), (0, 0.5), "clamp")
    # row 0 is t = 0
    first = Image(texels)(np.array([[1 / 8], [1 / 4]], np.float32))
    close(first[:, 0], texels[0, 0])
    # float image takes the luminance and roughness is capped
    exr(tmp_path / "a.exr", [[[0.5, 0.5, 0.5], [0, 0, 0], [1, 0, 0]]])
    world = 'Texture "a" "float" "imagemap" "string filename" "a.exr" Material "metal" "texture roughness" "a"'
    (lobe,) = lobes(read(world, add=TEXTURED))
    places = np.array([[1 / 6, 1 / 2, 5 / 6, 1 / 3], [0.5] * 4], np.float32)  # three centres, and between two
    # roughness is interpolated, not its reciprocal
    np.testing.assert_allclose(lobe.distribution.exponent(places)[0], [2, 10_000, 1 / 0.212671, 4], rtol=1e-3)
    # pbrt-v2 does not decode whole numbers
    pytest.importorskip("OpenImageIO")
    (tmp_path / "a.tga").write_bytes(tga(51, 204))
    texture = 'Texture "a" "color" "imagemap" "string filename" "a.tga" "float gamma" 2'
    close(kd(read(f'{texture} Material "matte" "texture Kd" "a"', add=TEXTURED)).texels[0, :, 0], [0.04, 0.64])


def test_textures_belong_to_their_block(read):
    world = """
    Texture "a" "color" "constant" "color value" [.2 .2 .2]
    Material "matte" "texture Kd" "a"
    AttributeBegin
    Texture "a" "color" "constant" "color value" [.3 .3 .3]
    """
    scene = read(world + TRIANGLE + "AttributeEnd\n")
    close([part.material.lobes[0].reflectance for part in scene.parts], [[0.3] * 3, [0.2] * 3])
    with pytest.warns(PbrtWarning, match="texture that is not defined"):
        read('AttributeBegin Texture "a" "color" "constant" AttributeEnd Material "matte" "texture Kd" "a"')


# Shapes -----------------------------------------------------------------------------------------------------------


def test_shapes_are_merged_by_material_and_kind(read):
    smooth = TRIANGLE[:-1] + ' "normal N" [0 0 1 0 0 1 0 0 1]\n'
    mapped = TRIANGLE[:-1] + ' "float uv" [0 0 1 0 0 1]\n'
    world = TRIANGLE + smooth + "Translate 0 0 1\n" + mapped + TRIANGLE + 'Material "mirror"\n' + smooth + TRIANGLE
    scene = read(world, add="")
    meshes = [(part.material.name, part.mesh) for part in scene.parts]
    assert [(name, m.normals is not None, m.uv is not None, m.triangles) for name, m in meshes] == [
        ("matte", False, False, 2),
        ("matte", True, False, 1),
        ("matte", False, True, 1),
        ("mirror", True, False, 1),
        ("mirror", False, False, 1),
    ]
    close(points(scene), np.concatenate([CORNERS, CORNERS + [0, 0, 1]]))
    assert scene.parts[0].mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_instances(read, monkeypatch):
    world = f"""
    Translate 1 0 0
    ObjectBegin "thing"
    Scale 2 2 2
    {TRIANGLE}
    Material "mirror"
    {TRIANGLE}
    ObjectEnd
    Identity
    Translate 0 5 0
    ObjectInstance "thing"
    Scale 3 3 3
    ObjectInstance "thing"
    """
    scene = read(world, add="")
    assert [(part.material.name, part.mesh.triangles) for part in scene.parts] == [("matte", 2), ("mirror", 2)]
    inner = CORNERS * 2 + [1, 0, 0]
    close(points(scene), np.concatenate([inner + [0, 5, 0], inner * 3 + [0, 5, 0]]))
    # mirrored instance of glass
    world = f'ObjectBegin "a" {TRIANGLE[:-1]} "normal N" [0 0 1 0 0 1 0 0 1] ObjectEnd Scale -1 1 1 ObjectInstance "a"'
    mesh = read('Material "glass" ' + world, add="").parts[0].mesh
    close(flat_normals(mesh.vertices, mesh.faces), [[0, 0, 1]])  # the instance's own handedness does not count
    # triangles are limited
    monkeypatch.setattr(reader, "MAX_SCENE_TRIANGLES", 4)  # those of the object count, too
    world = f'ObjectBegin "thing" {TRIANGLE} ObjectEnd\nObjectInstance "thing"\nObjectInstance "thing"\n'
    with pytest.raises(PbrtError, match=r"scene.pbrt:8: token ObjectInstance: a scene must have at most 4 triangles"):
        read(world + 'ObjectInstance "thing"\nObjectInstance "thing"')


# Which side is outside --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("transform, z", [("", -1), ("ReverseOrientation", 1)])
def test_mirrored_texture_coordinates_turn_glass(read, transform, z):
    scene = read(f'Material "glass" {transform} ', add=TRIANGLE[:-1] + ' "float uv" [0 0 0 1 1 0]\n')
    mesh = scene.parts[0].mesh
    close(flat_normals(mesh.vertices, mesh.faces), [[0, 0, z]])


# Files and warnings -----------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore")  # WorldEnd is none of v4
@pytest.mark.parametrize("dialect", ["v2", "v3", "v4"])
def test_names_are_relative_to_the_first_file(read, tmp_path, dialect):
    """As in all versions of pbrt; a file that is only beside the one that names it is found, too."""
    (tmp_path / "sub").mkdir()
    image = 'Texture "a" "float" "imagemap" "string filename" "a.exr"'
    (tmp_path / "sub/a.pbrt").write_text(f'Include "b.pbrt"\nInclude "c.pbrt"\n{image}')
    for name, text in (("b", "Translate 1 0 0"), ("sub/b", "Translate 100 0 0"), ("sub/c", "Translate 0 2 0")):
        (tmp_path / f"{name}.pbrt").write_text(text)
    exr(tmp_path / "a.exr", np.zeros((1, 1, 3)))
    exr(tmp_path / "sub/a.exr", np.ones((1, 1, 3)))
    masked = TEXTURED[:-1] + ' "texture alpha" "a"\n'
    scene = read('Include "sub/a.pbrt"', "" if dialect == "v2" else 'Integrator "path"', masked, dialect=dialect)
    close(points(scene), CORNERS + [1, 2, 0])
    assert not scene.parts[0].mask.image.texels.any()


def test_files(read, tmp_path):
    """A byte order mark is no word, in front of any file; UTF-16 is refused."""
    (tmp_path / "a.pbrt").write_text("Translate 1 2 3", "utf-8-sig")
    read('Include "a.pbrt"')
    text, path = (tmp_path / "scene.pbrt").read_text(), tmp_path / "scene.pbrt"
    path.write_text(text, "utf-8-sig")
    close(points(read_pbrt(path)), CORNERS + [1, 2, 3])
    (tmp_path / "a.pbrt").write_text("Translate 1 2 3", "utf-16")
    with pytest.raises(PbrtError, match=r'scene\.pbrt:3: token "a\.pbrt": .*a\.pbrt is UTF-16 or binary'):
        read_pbrt(path)
    # folders, pipes, and what is not there
    with pytest.raises(FileNotFoundError, match=r"there is no scene file .*none\.pbrt"):
        read_pbrt(tmp_path / "none.pbrt")
    os.mkfifo(tmp_path / "pipe.pbrt")
    for path in (tmp_path, tmp_path / "pipe.pbrt"):
        with pytest.raises(FileNotFoundError, match="is no scene file but a folder, a pipe or a device"):
            read_pbrt(path)


ABOVE = "reflectance above 1, which adds light, taken as it is, as pbrt does: "
BELOW = "reflectance below 0, taken as 0, as pbrt does: "
RED = 'Material "matte" "color Kd" [255 0 0]'
UNKNOWN, UNUSED = "not used, because it is unknown there: ", "not used, because it does not change the expected image: "
WARNINGS = [  # a line of the world, which is line 3 of the file, and the warning
    ('Material "matte" "color Kd" [-1 .5 .5]', f"{BELOW}'Kd' of Material (line 3)"),
    (RED, f"{ABOVE}'Kd' of Material (line 3)"),
    ('MakeNamedMaterial "a" "string type" "mirror" "color Kr" [1 1 1.01]', f"{ABOVE}'Kr' of MakeNamedMaterial"),
    (f"{RED} TRIANGLE {RED}", f"{ABOVE}'Kd' of Material (line 3 and 1 more)"),
    # spectra may exceed 1 a little: a constant 1 is (1.2, .95, .91)
    ('Material "matte" "color Kd" [1 1 1.0001]', None),
    ('Material "shinymetal" "color Ks" [2 2 2]', None),
    ('LightSource "point"', None),
    ('Material "plastic" "float rougness" .5', f"{UNKNOWN}parameter 'rougness' of Material, did you mean 'roughness'?"),
    ('Material "plastic" "float sheen" .5', f"{UNKNOWN}parameter 'sheen' of Material (line 3)"),
    ('LightSource "distant" "color I" [5 5 5]', f"{UNKNOWN}parameter 'I' of LightSource, did you mean 'L'? (line 3)"),
]


@pytest.mark.parametrize("line, text", WARNINGS)
def test_warnings(read, line, text):
    """What is not used or out of range is named, with its place, and nothing else is."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read(line.replace("TRIANGLE", TRIANGLE[:-1]))
    assert len(caught) == (text is not None)
    for warning in caught:
        assert f"scene.pbrt: {text}" in str(warning.message) and warning.filename == __file__


def test_options_that_are_not_used(read):
    options = """Sampler "random" "integer pixelsamples" 4 "bool jitter" "true"
    Accelerator "kdtree"
    VolumeIntegrator "emission"
    TransformTimes 0 1
    Renderer "sampler"
    SurfaceIntegrator "directlighting" "integer maxdepth" 3 "string strategy" "one"
    Film "image" "string filename" "out.exr"
    Camera "perspective" "float shutteropen" 0
    PixelFilter "box" "float xwidth" .5"""
    with pytest.warns(PbrtWarning) as caught:
        read(f'AttributeBegin {AREA[:-1]} "integer nsamples" 4 {TRIANGLE} AttributeEnd', options)
    (text,) = [str(w.message) for w in caught]
    assert text.endswith(
        f"scene.pbrt: {UNUSED}parameter 'jitter' of Sampler (line 1), Accelerator (line 2), VolumeIntegrator (line 3), "
        "TransformTimes (line 4), parameter 'filename' of Film (line 7), parameter 'shutteropen' of Camera (line 8)"
    )


# Bad input --------------------------------------------------------------------------------------------------------

# (options or world, line of it, what the message says); TRIANGLE, POINTS and LAMP stand for the texts above
BAD_OPTIONS = [
    ('Renderer "sampler"\nIntegrator "path"', 2, "token Integrator: Integrator belongs to v3 and v4"),
    ('Camera "perspective" "integer fov" 60', 1, "parameter 'fov' must be of type float; got integer"),
    ('Film "image" "integer xresolution" 2.5', 1, "needs whole numbers below 2**31"),
    ('Camera "perspective" "float frameaspectratio" 1', 1, "pixels that are not square are not supported"),
    ('Camera "perspective" "float screenwindow" [0 1 0 1]', 1, "'screenwindow' must be that of square pixels,"),
    ('\nCamera "perspective" "float fov" 180', 2, "token Camera: fov must be between 0 and 180"),
    ('Film "image" "float cropwindow" [0 1.5 0 1]', 1, "'cropwindow' must be four shares of the image"),
    ('PixelFilter "box" "float xwidth" 0', 1, "radius of a pixel filter must be a number from 1e-06"),
    ('SurfaceIntegrator "directlighting" "string strategy" "none"', 1, "must be all or one; got 'none'"),
]
BAD_WORLDS = [
    ("WorldBegn", 1, "did you mean 'WorldBegin'?"),
    ("Foo 1 2", 1, "token Foo: a directive must be one of Include, Identity,"),
    ('\nMaterial "matte', 2, 'token "matte: this string has no end'),
    ('\nMaterial "matte" "color Kd" [1 2 3', 2, "token [: this list has no end"),
    ('Material "matte" "color Kd" [1\n nan 3]', 1, "a number must be finite; nan is too large"),
    ('Material "matte" "color Kd" [1\n\n 1e 3]', 1, "a list holds numbers or quoted strings; got 1e"),
    ("Translate 1 nan 3", 1, "token nan: Translate needs 3 numbers"),
    ("Transform [1 0 0 1 0 1 0 0 0 0 1 0 0 0 0 1] TRIANGLE", 1, "must be affine"),
    ("Scale 1 0 1 TRIANGLE", 1, "token Shape: the current transform must be invertible"),
    ('CoordSysTransform "x"', 1, "there is no coordinate system 'x' here; there are: 'world'"),
    ("ActiveTransform EndTime", 1, "token EndTime: ActiveTransform must be All"),
    ("Material matte", 1, "token matte: Material needs a kind of material as a string"),
    ('Material "matte" "Kd" [1 1 1]', 1, 'token "Kd": a parameter is declared by its type and name'),
    ('Material "matte" "colour Kd" [1 1 1]', 1, "must be integer, float, point"),
    ('Material "matte" "color Kd"\n', 3, "token Shape: parameter 'Kd' needs a value"),
    ('Texture "a" "color" "imagemap" "string filename" 3', 1, "needs strings in quotes"),
    ('Shape "trianglemesh" "point P" [1 2 3 4]', 1, "needs 3 numbers for each point; got 4"),
    ('Material "matte" "spectrum Kd" [400 1 500]', 1, "pairs of wavelength and value; got 3"),
    ('Material "matte" "spectrum Kd" "no.spd"', 1, "there is no file 'no.spd' in"),
    ("AttributeBegin\nTransformEnd", 2, "must close TransformBegin; AttributeBegin of line 3 is open"),
    ("\nTransformBegin", 4, "token WorldEnd: TransformBegin of line 4 is still open"),
    ('Camera "perspective"', 1, "token Camera: Camera must stand before WorldBegin"),
    ("TRIANGLE\nWorldEnd\nIdentity", 3, "token Identity: nothing may follow WorldEnd"),
    ('Volume "homogeneous"', 1, "Volume is not supported; remove it"),
    ('Shape "sphere" "float radius" -1', 1, 'token "sphere": radius must be positive'),
    ('ObjectBegin "a" ObjectBegin "b"', 1, "must not be defined within another"),
    ('Material "glass" "float index" 0', 1, "parameter 'index' must be positive"),
    ('MakeNamedMaterial "x"', 1, 'needs the parameter "string type", which is missing'),
    ('Texture "x" "color" "checkerboard" "integer dimension" 3', 1, "'dimension' must be 2"),
    ('Texture "x" "color" "imagemap" "string filename" "a.png"', 1, "images of pbrt-v2 must be EXR, TGA, PFM"),
    ('Texture "x" "color" "imagemap" "string filename" "bad.exr"', 1, "cannot read"),
    ('LightSource "point" "color I" [-1 0 0]', 1, "intensity must be finite, not negative"),
    ('Scale 1 2 1 LightSource "spot"', 1, "a spot light must not be stretched"),
    ('LAMP Scale 1 2 1 Shape "disk"', 2, "a disk that emits must not be stretched"),
    ('LAMP Shape "disk" "float innerradius" .5', 2, "a disk that emits must be whole"),
    ('ObjectBegin "a" LAMP TRIANGLE\n', 2, "a shape in an object must not emit"),
    ('Shape "trianglemesh" "integer indices" [0 1 3] POINTS\n', 1, "indices must be from 0 to 2, the last point; got"),
    ('TRIANGLE"normal N" [0 0 1]', 1, "each of the 3 points needs one N; got 1"),
    ('LAMP TRIANGLE"float alpha" 0', 2, "a shape that emits must not have alpha"),
    ('TRIANGLE"vector S" [1 0 0]', 1, "this is not supported; remove the parameter"),
    ('ObjectBegin "a" ObjectInstance "a"', 1, "an object must not hold instances"),
]


@pytest.mark.parametrize("text, line, message", [*BAD_OPTIONS, *BAD_WORLDS])
def test_bad_input(read, tmp_path, text, line, message):
    in_world = (text, line, message) in BAD_WORLDS
    for file in ("bad.exr", "bad.ply", "a.png"):
        (tmp_path / file).write_bytes(b"nothing that a reader knows")
    for word, meaning in (("TRIANGLE", TRIANGLE[:-1]), ("POINTS", POINTS), ("LAMP", AREA)):
        text = text.replace(word, meaning)
    with pytest.raises(PbrtError) as caught:
        read(text if in_world else "", "" if in_world else text)
    error = str(caught.value)
    assert error.startswith(f"{tmp_path / 'scene.pbrt'}:{line + 2 * in_world}: token ")
    assert message in error and len(error) < 1000


@pytest.mark.parametrize(
    "text, message",
    [
        ("", ":1: token end of file: WorldBegin is missing"),
        ("WorldBegin\n" + TRIANGLE, ":3: token end of file: WorldEnd is missing"),
        ("WorldBegin\nWorldEnd\n", ":2: token WorldEnd: a scene needs at least one part"),
        ("\x00\x01\x7fELF", ":1: token at the beginning: the file is UTF-16 or binary; it must be text"),
        ("\x01\x7fELF", ":1: token \x01\x7fELF: a directive is expected"),
    ],
)
def test_broken_files(tmp_path, text, message):
    path = tmp_path / "scene.pbrt"
    path.write_text(text)
    with pytest.raises(PbrtError) as caught:
        read_pbrt(path)
    assert f"{path}{message}" in str(caught.value)


@pytest.mark.parametrize(
    "text", ["[" * 10_000, '"' * 10_001, "[1 " * 5_000, "#\n" * 10_000 + "[" + "# ]\n" * 5_000, "- " * 10_000]
)
def test_long_hostile_text_is_refused(tmp_path, text):
    (tmp_path / "scene.pbrt").write_text(text)
    with pytest.raises(PbrtError):
        read_pbrt(tmp_path / "scene.pbrt")


@pytest.mark.parametrize("name", ["killeroo-gold", "killeroo-diffuse", "env", "teapot-area-light"])
def test_original_scenes_load_without_a_warning(pbrt_scenes, name):
    assert read_pbrt(pbrt_scenes / f"{name}.pbrt").lights
