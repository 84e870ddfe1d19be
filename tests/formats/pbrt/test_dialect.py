"""pbrt-v3 and v4: the same scene in three dialects is the same scene; what differs, by hand; what is refused."""

import dataclasses
import warnings

import numpy as np
import pytest
from helpers import tga

import dmis
from dmis.base.color import LUMINANCE, spectrum_to_rgb
from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.coated_conductor import CoatedConductor
from dmis.brdf.coated_diffuse import CoatedBase
from dmis.brdf.lobe import Lambert, LambertTransmission, OrenNayar
from dmis.brdf.microfacet import GGX
from dmis.brdf.rough_glass import RoughReflection, RoughTransmission
from dmis.brdf.specular import SpecularReflection, SpecularTransmission
from dmis.cli.commands import main
from dmis.formats.pbrt.dialect import detect
from dmis.formats.pbrt.notes import PbrtWarning
from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.tokens import PbrtError, Source, tokens_of
from dmis.image import write_exr
from dmis.light.area import DiskLight
from dmis.light.delta import DistantLight, PointLight
from dmis.samplers.pixel_filter import PixelFilter

TRIANGLE = 'Shape "trianglemesh" "integer indices" [0 1 2] "point3 P" [0 0 0  1 0 0  0 1 0]\n'
TEXTURED = TRIANGLE[:-1] + ' "point2 uv" [0 0 1 0 0 1]\n'
SQUARE = '"point3 P" [-2 -2 0  2 -2 0  2 2 0  -2 2 0] "integer indices" [0 1 2 0 2 3]'
HEAD = {
    "v3": 'Integrator "directlighting"\nFilm "image"\n',
    "v4": 'Film "rgb"\nIntegrator "path" "integer maxdepth" 1\nPixelFilter "box"\n',
}


@pytest.fixture
def read(tmp_path):
    """Reads a scene of the dialect with the given world and options; a triangle is added."""

    def read(dialect, world="", options="", add=TRIANGLE, head=None, force=False):
        path = tmp_path / "scene.pbrt"
        end = "" if dialect == "v4" else "WorldEnd\n"
        path.write_text(f"{HEAD[dialect] if head is None else head}{options}\nWorldBegin\n{world}\n{add}{end}")
        return read_pbrt(path, dialect=dialect if force else None)

    return read


def close(value, expected):
    np.testing.assert_allclose(value, expected, rtol=1e-6, atol=1e-9)


# The same scene -----------------------------------------------------------------------------------------------------

COMMON = f"""
LookAt 0 -6 3  0 0 0  0 0 1
Camera "perspective" "float fov" 40
Film "FILM" "integer xresolution" [24] "integer yresolution" 16
INTEGRATOR
WorldBegin
LightSource "point" STRENGTH "POINT from" [0 0 3]
LightSource "distant" "rgb L" [.5 .25 .125] "POINT from" [0 0 1] "POINT to" [0 0 0]
AttributeBegin
  AreaLightSource "AREA" "COLOR L" [8 4 2] EMITS
  Material "MATTE" "COLOR KD" [0 0 0]
  Translate 0 0 4
  ReverseOrientation
  DISK
AttributeEnd
Texture "a" "TYPE" "constant" "COLOR value" [.2 .4 .8]
Texture "b" "TYPE" "scale" PRODUCT
MakeNamedMaterial "floor" "string type" "MATTE" "texture KD" "b"
NamedMaterial "floor"
Shape "trianglemesh" {SQUARE} "UV uv" [0 0 1 0 1 1 0 1]
Material "MATTE" "COLOR KD" [.1 .2 .3]
ObjectBegin "ball"
  Shape "sphere" "float radius" .5
ObjectEnd
Translate 0 0 1
ObjectInstance "ball"
Shape "loopsubdiv" "integer LEVELS" 2 "integer indices" [0 2 1 0 1 3 0 3 2 1 2 3] "POINT P" [0 0 0 1 0 0 0 1 0 0 0 1]
WorldEnd
"""
"""A scene; the words in capitals are those of each dialect."""

WORDS = {
    "v2": {
        "FILM": "image", "INTEGRATOR": 'SurfaceIntegrator "directlighting"', "STRENGTH": '"color I" [4 4 4]',
        "AREA": "area", "EMITS": '"color scale" [2 2 2]', "DISK": 'Shape "disk" "float radius" 1',
        "PRODUCT": '"texture tex1" "a" "color tex2" [.5 .5 .5]', "point3": "point", "POINT": "point",
        "COLOR": "color", "TYPE": "color", "UV": "float", "MATTE": "matte", "KD": "Kd", "LEVELS": "nlevels",
    },
    "v3": {
        "FILM": "image", "INTEGRATOR": 'Integrator "directlighting"', "STRENGTH": '"rgb I" [4 4 4]',
        "AREA": "diffuse", "EMITS": '"rgb scale" [2 2 2] "bool twosided" "false"',
        "DISK": 'Shape "disk" "float radius" 1 "float alpha" 1',
        "PRODUCT": '"texture tex1" "a" "rgb tex2" [.5 .5 .5]', "POINT": "point3",
        "COLOR": "rgb", "TYPE": "spectrum", "UV": "point2", "MATTE": "matte", "KD": "Kd", "LEVELS": "levels",
    },
    "v4": {
        "FILM": "rgb",
        "INTEGRATOR": 'Integrator "volpath" "integer maxdepth" [1] ColorSpace "srgb" '
        'PixelFilter "box" "float xradius" .5 "float yradius" .5',
        "STRENGTH": '"rgb I" [2 2 2] "float scale" 2', "AREA": "diffuse",
        "EMITS": '"float scale" [2] "bool twosided" false',
        "DISK": 'Shape "disk" "float radius" 1',
        "PRODUCT": '"texture tex" "a" "float scale" .5', "POINT": "point3", "COLOR": "rgb", "TYPE": "spectrum",
        "UV": "point2", "MATTE": "diffuse", "KD": "reflectance", "LEVELS": "levels", "WorldEnd": "",
    },
}  # fmt: skip


def spoken(dialect):
    """The scene in a dialect."""
    text = COMMON
    for word, theirs in WORDS[dialect].items():
        text = text.replace(word, theirs)
    return text


@pytest.mark.parametrize("dialect", ["v3", "v4"])
def test_same_scene_in_other_words(tmp_path, dialect):
    """Equal parts, materials, lights and camera, and so the same image to the last bit."""
    scenes = []
    for name in ("v2", dialect):
        (tmp_path / f"{name}.pbrt").write_text(spoken(name))
        scenes.append(read_pbrt(tmp_path / f"{name}.pbrt"))
    first, second = scenes
    assert len(first.parts) == len(second.parts) == 4  # disk, floor, ball and the subdivided one (no uv)
    for a, b in zip(first.parts, second.parts, strict=True):
        for table in ("vertices", "faces", "normals", "uv"):
            np.testing.assert_array_equal(getattr(a.mesh, table), getattr(b.mesh, table))
        assert [type(lobe) for lobe in a.material.lobes] == [type(lobe) for lobe in b.material.lobes]
        for one, other in zip(a.material.lobes, b.material.lobes, strict=True):
            close(one.reflectance, other.reflectance)
    assert [type(light) for light in first.lights] == [PointLight, DistantLight, DiskLight]
    for a, b in zip(first.lights, second.lights, strict=True):
        for field in dataclasses.fields(a):
            close(getattr(a, field.name), getattr(b, field.name))
    assert first.camera.fov == second.camera.fov and first.camera.resolution == second.camera.resolution
    np.testing.assert_array_equal(first.camera.to_world, second.camera.to_world)
    descriptions = [scene.describe().replace("diffuse", "matte").split("  integrator:")[0] for scene in scenes]
    assert descriptions[0] == descriptions[1]
    images = [dmis.render(scene, rule="balance", spp=2, seed=3).image for scene in scenes]
    assert images[0].max() > 0
    np.testing.assert_array_equal(*images)


# Which dialect ------------------------------------------------------------------------------------------------------


def test_dialect_can_be_forced(read, tmp_path):
    read("v3")
    with pytest.raises(ValueError, match="dialect must be v2 or v3 or v4; got 'v5'"):
        read_pbrt(tmp_path / "scene.pbrt", dialect="v5")
    with pytest.raises(PbrtError, match="a parameter must be integer"):
        read("v4", TRIANGLE, 'Camera "perspective" "color a" 1')
    bare = 'Shape "trianglemesh" "point3 P" [0 0 0  1 0 0  0 1 0]\n'
    assert read("v4", add=bare).parts[0].mesh.triangles == 1
    with pytest.raises(PbrtError, match="integer indices"):
        read("v3", add=bare)
    path = tmp_path / "open.pbrt"
    path.write_text('WorldBegin Shape "disk"')
    with pytest.raises(PbrtError, match=r'WorldEnd is missing; .* dialect="v4" \(--dialect v4\)'):
        dmis.load_scene(path)
    assert dmis.load_scene(path, dialect="v4").parts
    path.write_text('SurfaceIntegrator "path" WorldBegin Shape "sphere"')  # of v2
    with pytest.raises(PbrtError, match="WorldEnd is missing"):
        dmis.load_scene(path)


NARROWING = {  # by the tables of names in core/api.cpp of v1 to v3 and the classes of v4
    "WorldBegin": ("v2 v3", "guess"),
    'AreaLightSource "diffuse" "rgb L" [1 1 1]': ("v2 v3", "guess"),  # core/pbrtparse.yy of v2 has rgb and blackbody
    'Material "shinymetal"': ("v2", "file"),
    'Film "image" "bool premultiplyalpha" "true"': ("v2", "file"),
    'Film "image" "float scale" 2': ("v3", "file"),
    'Shape "plymesh" "string filename" "a.ply"': ("v3", "file"),
    'LightSource "point" "integer samples" 4': ("v3", "file"),
    'Material "diffuse"': ("v4", "file"),
    'MakeNamedMaterial "a" "string type" "coateddiffuse"': ("v4", "file"),
    'PixelFilter "gaussian" "float xradius" 2': ("v4", "file"),
}


@pytest.mark.parametrize("line", NARROWING)
def test_words_rule_dialects_out(tmp_path, line):
    """A line of a file, with WorldEnd (which v4 does not have) unless it is of v4."""
    fits, reason = NARROWING[line]
    path = tmp_path / "a.pbrt"
    path.write_text(line + ("" if fits == "v4" else "\nWorldEnd"))
    dialect, candidates = detect(tokens_of(Source.read(path)))
    assert (" ".join(candidates), dialect.name) == (fits, fits[:2])
    assert (len(candidates) > 1) == (reason == "guess")


def test_a_dialect_that_is_a_guess_is_named(tmp_path, capsys):
    """In a warning that says how to settle it, by `info`, and in the provenance of images."""
    path = tmp_path / "plain.pbrt"
    path.write_text('Film "image" "integer xresolution" 4 "integer yresolution" 4 WorldBegin Shape "sphere" WorldEnd')
    with pytest.warns(PbrtWarning, match="fit v2 and v3; .* give dialect='v2' .--dialect v2. or dialect='v3'"):
        scene = dmis.load_scene(path)
    with pytest.warns(dmis.scene.scene.SceneWarning, match="none of its 0 lights emits"):
        source = dmis.render(scene, "balance", 1).provenance["source"]
    assert (source["dialect"], source["dialect_from"]) == ("v2", "guess")
    source = dmis.load_scene(path, dialect="v3").source
    assert (source["dialect"], source["dialect_from"]) == ("v3", "caller")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["info", str(path)]) == 0
    printed = capsys.readouterr()
    assert "dialect of pbrt: v2, from: guess" in printed.out and "--dialect v3" in printed.err
    assert main(["info", str(path), "--dialect", "v3"]) == 0
    printed = capsys.readouterr()
    assert "dialect of pbrt: v3, from: caller" in printed.out and not printed.err


@pytest.mark.filterwarnings("default")
def test_a_dialect_that_the_words_contradict(tmp_path, capsys):
    """A warning names the dialect of the words, whether the file can be read or not; not where they fit."""
    path = tmp_path / "two.pbrt"
    for line, code, other, right in (
        ('Film "image" "float scale" 1', 0, "v2", "v3"),
        ('SurfaceIntegrator "path"', 2, "v4", "v2"),
    ):
        path.write_text(f'{line} WorldBegin Shape "disk" WorldEnd')
        assert main(["info", str(path), "--dialect", other]) == code
        assert f"read as pbrt-{other}, as asked, but the words of the file fit {right};" in capsys.readouterr().err
        assert main(["info", str(path), "--dialect", right]) == 0
        assert "as asked" not in capsys.readouterr().err


def test_dialect_follows_included_files(tmp_path):
    """Also by way of files that include each other, and of files that are missing, which are errors later."""
    (tmp_path / "a.pbrt").write_text('Include "b.pbrt" Include "c.pbrt" WorldBegin Shape "disk" WorldEnd')
    (tmp_path / "b.pbrt").write_text('Film "image"')
    (tmp_path / "c.pbrt").write_text('Integrator "path"')
    scene = dmis.load_scene(tmp_path / "a.pbrt")
    assert (scene.source["dialect"], scene.source["dialect_from"]) == ("v3", "file")
    (tmp_path / "b.pbrt").write_text('Include "a.pbrt"')
    with pytest.raises(PbrtError, match=r'b\.pbrt:1: token "a\.pbrt": a file must not include itself'):
        dmis.load_scene(tmp_path / "a.pbrt")
    (tmp_path / "b.pbrt").unlink()
    with pytest.raises(PbrtError, match=r"there is no file 'b\.pbrt'"):
        dmis.load_scene(tmp_path / "a.pbrt")


# Colours ------------------------------------------------------------------------------------------------------------


def test_spectra_of_lights_have_luminance_one_in_v4(read):
    for spectrum in ('"blackbody I" 3000', '"spectrum I" [300 7 800 7]', '"spectrum I" [400 1 700 2]'):
        (light,) = read("v4", f'LightSource "point" {spectrum} "float scale" 5').lights
        assert LUMINANCE @ light.intensity == pytest.approx(5)
    (light,) = read("v4", 'Scale 2 2 2 LightSource "point" "blackbody I" 3000 "point3 from" [1 2 3]').lights
    assert light.intensity[0] > light.intensity[1] > light.intensity[2]
    assert light.position == (2, 4, 6)  # moved by the whole transform
    (light,) = read("v4", 'LightSource "point" "spectrum I" "stdillum-D65"').lights
    assert light.intensity == (1, 1, 1)


@pytest.mark.parametrize("temperature", [3000, 9000])
def test_black_body_of_v3_is_one_where_it_is_brightest(read, temperature):
    """Planck's law over its value at Wien's wavelength, as a table, in 471 steps of 470 nm."""

    def planck(nanometres):
        return nanometres**-5.0 / np.expm1(1.4388e7 / (nanometres * temperature))

    (light,) = read("v3", f'LightSource "point" "blackbody I" [{temperature} 2]').lights
    table = np.arange(360, 831), planck(np.arange(360, 831)) / planck(2.8977721e6 / temperature)
    close(light.intensity, np.multiply(spectrum_to_rgb(*table), 2 * 470 / 471))
    (light,) = read("v3", 'LightSource "point" "spectrum I" [400 1 700 2]').lights
    close(light.intensity, np.multiply(spectrum_to_rgb([400, 700], [1, 2]), 470 / 471))


# Positions and sides --------------------------------------------------------------------------------------------------


UP = ' "normal N" [0 0 1 0 0 1 0 0 1 0 0 1]'


def test_textures_are_the_other_way_up(read, tmp_path):
    texels = np.arange(24, dtype=np.float32).reshape(2, 4, 3) / 24
    write_exr(tmp_path / "a.exr", {"RGB": texels})
    texture = 'Texture "a" "spectrum" "imagemap" "string filename" "a.exr" '
    (lobe,) = lobes(read("v3", texture + 'Material "matte" "texture Kd" "a"', add=TEXTURED))
    close(lobe.reflectance.texels, texels[::-1])
    scaled = f'{texture} "float scale" .5 Material "diffuse" "texture reflectance" "a"'
    close(lobes(read("v4", scaled, add=TEXTURED))[0].reflectance.texels, texels[::-1] / 2)
    # textures may be named twice but in v4
    twice = 'Texture "t" "spectrum" "constant" "rgb value" [.1 .1 .1] ' * 2
    close(lobes(read("v3", twice + 'Material "matte" "texture Kd" "t"'))[0].reflectance, [0.1] * 3)
    with pytest.raises(PbrtError, match="there is a texture of this name"):
        read("v4", twice)


def test_float_images_of_colours(read, tmp_path):
    """v3 takes their luminance, v4 their mean."""
    rgb = np.random.default_rng(2).random((2, 2, 3), np.float32)
    write_exr(tmp_path / "a.exr", {"RGB": rgb})
    texture = 'Texture "a" "float" "imagemap" "string filename" "a.exr" Material'
    for dialect, metal, expected in (
        ("v3", "metal", rgb[::-1] @ LUMINANCE),
        ("v4", "conductor", rgb[::-1].mean(axis=2)),
    ):
        (lobe,) = lobes(read(dialect, f'{texture} "{metal}" "texture roughness" "a" {PLAIN}', add=TEXTURED))
        close(lobe.roughness.alpha.texels[..., 0], expected)


# Materials ------------------------------------------------------------------------------------------------------------


def lobes(scene):
    return scene.parts[-1].material.lobes


REMAPPED = {0.1: 0.4618, 0.01: 0.1389, 0.001: 0.0473, 0.0: 0.0473}
"""alpha of pbrt-v3, by hand from its polynomial: 1.62142 - 1.88801 + 0.91935 - 0.20900 + 0.01801 for 0.1."""
GLASS, BLEND = [RoughReflection, RoughTransmission], [BlendBase, BlendCoat]
SMOOTH, COATED = [SpecularReflection, SpecularTransmission], [CoatedBase, SpecularReflection]
METAL_COATED, ROUGH_METAL = [CoatedConductor, SpecularReflection], '"float conductor.roughness" .04'
YELLOW = '"rgb conductor.eta" [3 2 1.5]'
FINE, COARSE = '"float uroughness" .01 "float roughness" .1', '"float uroughness" .1 "float vroughness" .01'
PLAIN = '"bool remaproughness" "false"'
PAPER = [Lambert, LambertTransmission]
HALVED = '"float scale" .5 "rgb reflectance" [.2 .4 .6] "rgb transmittance" [1 .8 0]'
POLISHED = '"rgb Ks" [0 0 0] "rgb Kr" [1 1 1] "rgb Kt" [1 1 1] "float eta" 1.2'
CLEAR, DIMMED = [SpecularTransmission, Lambert, RoughReflection], (0.1, 0.15, 0.2)
THIN, SHEET = f'"rgb reflect" [.2 .2 .2] "rgb transmit" [.6 .6 .6] {PLAIN}', [*PAPER, *GLASS]
LOBES = [  # dialect, material, its parameters, its lobes, and attributes of some of them
    ("v3", "matte", '"float sigma" 20', [OrenNayar], {}),
    ("v3", "plastic", "", [Lambert, RoughReflection], {"1.fresnel.eta": 1 / 1.5}),  # swapped on one side
    ("v3", "glass", '"float eta" 1.3', SMOOTH, {"0.fresnel.eta": 1.3, "1.eta": 1.3}),
    ("v3", "glass", COARSE, GLASS, {"1.roughness.alpha_u": REMAPPED[0.1], "1.roughness.alpha_v": REMAPPED[0.01]}),
    ("v3", "uber", '"rgb Kd" [0 0 0] "float eta" 1.3', [RoughReflection], {"0.fresnel.eta": 1.3}),  # not swapped
    ("v3", "uber", f'"rgb Kd" [0 0 0] {FINE}', [RoughReflection], {"0.roughness.alpha": REMAPPED[0.01]}),  # v is u
    ("v3", "uber", f'"rgb opacity" [.4 .6 .8] {COARSE}', CLEAR, {"2.roughness.alpha_v": REMAPPED[0.01]}),
    ("v3", "uber", '"rgb opacity" [.4 .6 .8]', CLEAR, {"0.transmittance": (0.6, 0.4, 0.2), "2.reflectance": DIMMED}),
    ("v3", "translucent", THIN, SHEET, {"0.reflectance": [0.05] * 3, "1.transmittance": [0.15] * 3}),
    ("v3", "metal", FINE, [GGX], {"0.roughness.alpha_v": REMAPPED[0.1]}),  # v is roughness
    ("v3", "substrate", '"float uroughness" .01', BLEND, {"1.distribution.roughness.alpha_u": REMAPPED[0.01]}),
    ("v3", "substrate", '"float uroughness" .01', BLEND, {"1.distribution.roughness.alpha_v": REMAPPED[0.1]}),
    *(("v3", "metal", f'"float roughness" {r}', [GGX], {"0.roughness.alpha": alpha}) for r, alpha in REMAPPED.items()),
    ("v3", "metal", f'"float roughness" 0 {PLAIN}', [GGX], {"0.roughness.alpha": 0.001}),
    ("v3", "uber", POLISHED, [Lambert, *SMOOTH], {"1.fresnel.eta": 1.2, "2.eta": 1.2}),  # not swapped as in v2
    ("v4", "diffuse", '"spectrum reflectance" [300 .25 800 .25]', [Lambert], {"0.reflectance": [0.25] * 3}),
    ("v4", "diffusetransmission", HALVED, PAPER, {"0.reflectance": (0.1, 0.2, 0.3), "1.transmittance": (0.5, 0.4, 0)}),
    ("v4", "conductor", '"float roughness" .04', [GGX], {"0.roughness.alpha": 0.2}),
    ("v4", "conductor", '"float vroughness" .09 "float uroughness" .04', [GGX], {"0.roughness.alpha_v": 0.3}),
    ("v4", "conductor", '"float roughness" 9e-7', [SpecularReflection], {}),  # alpha is below 1e-3
    ("v4", "conductor", '"rgb reflectance" [.5 .5 .5]', [SpecularReflection], {"0.fresnel.k": [2] * 3}),
    ("v4", "dielectric", '"float roughness" .04', GLASS, {"0.roughness.alpha": 0.2, "1.roughness.alpha": 0.2}),
    ("v4", "dielectric", '"float roughness" .1 "float eta" 1', SMOOTH, {}),  # there is no surface
    ("v4", "coateddiffuse", "", COATED, {"0.reflectance": [0.5] * 3, "0.bounces": 5}),
    ("v4", "coateddiffuse", "", COATED, {"0.eta": 1.5, "0.thickness": 0.01, "1.fresnel.eta": 1.5}),
    ("v4", "coateddiffuse", '"float roughness" .04', [CoatedBase, GGX], {"0.roughness": 0.2, "1.roughness.alpha": 0.2}),
    ("v4", "coateddiffuse", '"integer maxdepth" 101 "integer nsamples" 4', COATED, {"0.bounces": 51}),
    ("v4", "coateddiffuse", '"float thickness" -1 "float g" .5', COATED, {"0.thickness": 0}),
    ("v4", "coatedconductor", "", [SpecularReflection], {"0.fresnel.bounces": 5, "0.fresnel.thickness": 0.01}),
    ("v4", "coatedconductor", '"float conductor.roughness" .04', METAL_COATED, {"0.alpha": 0.2, "0.bounces": 5}),
    ("v4", "coatedconductor", '"float interface.roughness" .04', [CoatedConductor, GGX], {"0.roughness": 0.2}),
    ("v4", "coatedconductor", f"{ROUGH_METAL} {YELLOW}", METAL_COATED, {"0.metal.0": (2, 4 / 3, 1)}),
    ("v4", "coatedconductor", f'{ROUGH_METAL} "rgb reflectance" [.5 .5 .5]', METAL_COATED, {"0.metal.1": [4 / 3] * 3}),
]


@pytest.mark.parametrize("dialect, kind, parameters, kinds, values", LOBES)
def test_lobes_of_materials(read, dialect, kind, parameters, kinds, values):
    found = lobes(read(dialect, f'Material "{kind}" {parameters}'))
    assert [type(lobe) for lobe in found] == kinds
    for path, value in values.items():
        number, *names = path.split(".")
        item = found[int(number)]
        for name in names:
            item = item[int(name)] if name.isdigit() else getattr(item, name)
        np.testing.assert_allclose(item, value, atol=1e-4)


def test_mix(read):
    world = """MakeNamedMaterial "a" "string type" "matte" "rgb Kd" [.4 .4 .4]
    MakeNamedMaterial "b" "string type" "mirror"
    Material "mix" "string namedmaterial1" "a" "string namedmaterial2" "b" "rgb amount" [.25 .5 1]"""
    diffuse, mirror = lobes(read("v3", world))
    close(diffuse.reflectance, [0.1, 0.2, 0.4])
    close(mirror.reflectance, [0.675, 0.45, 0])
    world = """MakeNamedMaterial "a" "string type" "diffuse" "rgb reflectance" [.4 .4 .4]
    MakeNamedMaterial "b" "string type" "diffuse" "rgb reflectance" [.8 .8 .8]
    Material "mix" "string materials" ["a" "b"] "float amount" .25"""
    first, second = lobes(read("v4", world))
    close(first.reflectance, [0.3] * 3)
    close(second.reflectance, [0.2] * 3)
    # names outlive blocks in v4
    world = 'AttributeBegin MakeNamedMaterial "a" "string type" "{}" AttributeEnd NamedMaterial "a"'
    assert len(lobes(read("v4", world.format("diffuse")))) == 1
    with pytest.warns(PbrtWarning, match="material that is not defined, the Material line taken"):
        read("v3", world.format("matte"))


def test_images_and_parameters_that_are_refused(read, tmp_path):
    write_exr(tmp_path / "a.exr", {"RGB": np.array([0.5, 2, 0.1], np.float32).reshape(1, 1, 3)})
    texture = 'Texture "a" "{}" "imagemap" "string filename" "a.exr"\nMaterial "coateddiffuse" "texture {}" "a"'
    base, _ = lobes(read("v4", texture.format("spectrum", "reflectance")))
    close(base.reflectance.texels.ravel(), [0.5, 1, 0.1])
    for name in ("roughness", "uroughness", "vroughness", "eta", "thickness", "g"):
        with pytest.raises(PbrtError, match=rf"scene\.pbrt:\d+: .*parameter '{name}' must be constant here"):
            read("v4", texture.format("float", name))
    with pytest.raises(PbrtError, match="parameter 'albedo' must be constant here"):
        read("v4", texture.format("spectrum", "albedo"))
    # Shape lines do not change materials
    named = 'MakeNamedMaterial "a" "string type" "{}" NamedMaterial "a"\n'
    for line in ('Material "matte"', named.format("matte")):
        with pytest.raises(PbrtError, match='token "rgb Kd": a parameter of materials must stand in a Material line'):
            read("v3", line, add=TRIANGLE[:-1] + ' "rgb Kd" [.2 .2 .2]\n')
    with pytest.warns(PbrtWarning, match="'reflectance' of Shape"):
        scene = read("v4", named.format("diffuse"), add=TRIANGLE[:-1] + ' "rgb reflectance" [.2 .2 .2]\n')
    close(lobes(scene)[0].reflectance, [0.5] * 3)


# Shapes and state -----------------------------------------------------------------------------------------------------


def test_media_are_refused_and_vacuum_is_not_used(read):
    fog = 'MakeNamedMedium "fog" "string type" "homogeneous" MediumInterface "" '
    for dialect in HEAD:
        with pytest.warns(PbrtWarning, match="MakeNamedMedium"):
            read(dialect, fog + '""')
        with pytest.raises(PbrtError, match=r'scene\.pbrt:\d+: token "fog": a medium changes the image'):
            read(dialect, fog + '"fog"')


# What is refused ----------------------------------------------------------------------------------------------------

# (dialect, options or world, what the message says)
BAD_OPTIONS = [
    ("v4", 'Film "rgb" "string sensor" "canon_eos_5d"', "'sensor' must be cie1931"),
    ("v4", 'Option "bool disablepixeljitter" true', "token Option: Option is not supported; remove it"),
    ("v4", 'Film "rgb" "float iso" 1 "float iso" 2', "parameter 'iso' is given twice"),
    ("v3", 'PixelFilter "gaussian" "float alpha" 0', "alpha must be positive"),
    ("v4", 'Integrator "path" "integer maxdepth" 0', "maxdepth must let 1 to 10000 surfaces"),
    ("v4", 'Renderer "sampler"', "Renderer belongs to v2"),
]
IMAGE = 'Texture "a" "spectrum" "imagemap" "string filename" "a.exr"'
BUMPY = 'Texture "h" "float" "imagemap" "string filename" "a.exr" MakeNamedMaterial "a" "string type" "diffuse" '
BUMPY += '"texture displacement" "h"'
MIX = 'Material "mix" "string namedmaterial1" "a" "string namedmaterial2" "a"'
BAD_WORLDS = [
    ("v4", f'{IMAGE} "string encoding" "gamma 2.2"', "parameter 'encoding' must be linear"),
    ("v4", f'{IMAGE} "bool invert" true', "parameter 'invert' must be False"),
    ("v4", f'{BUMPY} "string normalmap" "a.exr"', "a displacement or a normalmap, not both"),
    ("v4", f'{BUMPY} Material "mix" "string materials" ["a" "a"]', "a bump map or normal map cannot be mixed; got 'a'"),
    ("v4", 'Import "a.pbrt"', "token Import: Import is not supported; write AttributeBegin, Inc"),
    ("v4", 'Attribute "shape" "float radius" 2', "token Attribute: Attribute is not supported; write its parameters"),
    ("v4", 'LightSource "point" "float power" 3', "this is not supported; give the strength of the light"),
    ("v4", 'LightSource "infinite" "float illuminance" 3', "this is not supported; give the strength of the light"),
    ("v4", 'Material "coateddiffuse" "rgb albedo" [0 .1 0]', "'albedo' must be black, because"),
    ("v4", 'Material "coateddiffuse" "float vroughness" .1', "roughness must be the same along"),
    ("v4", 'Material "coateddiffuse" "integer maxdepth" 0', "'maxdepth' must be at least 1"),
    ("v4", 'Material "coatedconductor" "rgb reflectance" [0 0 0] "rgb conductor.k" [1 1 1]', "must not stand beside"),
    ("v4", 'Material "conductor" "float uroughness" .1', "must be rough along both tangents"),
    ("v3", f'MakeNamedMaterial "a" "string type" "substrate" {MIX}', "the kind substrate cannot be mixed"),
    *(
        ("v4", f'Material "{kind}" "rgb reflectance" [{rgb}]', "'reflectance' must be from 0 to 1 in pbrt-v4; got [")
        for kind in ("diffuse", "coateddiffuse")
        for rgb in ("1.5 .5 .5", "-.5 .5 .5")
    ),
    ("v3", 'Material "metal" "float roughness" -.1', "must not be negative, because it is a spread"),
    ("v4", 'Material "conductor" "spectrum eta" "metal-Xx-eta"', "no spectrum of the name 'metal-Xx-eta'"),
    ("v4", 'AreaLightSource "diffuse" "bool twosided" true Shape "sphere"', "must not be twosided, which is not"),
    ("v4", 'AreaLightSource "diffuse" "string filename" "x"', "an image that emits"),
    ("v3", 'AreaLightSource "diffuse" ReverseOrientation Shape "trianglemesh" SQUAREUP', "shines on both sides in v3"),
    ("v4", 'AreaLightSource "diffuse" Scale -1 1 1 Shape "disk"', "a mirrored disk that emits"),
    ("v4", 'LightSource "point" "spectrum I" [400 0 700 0]', "must have a positive luminance"),
    ("v3", 'TRIANGLE "float shadowalpha" .5', "shadows of another shape than the surface"),
    ("v4", 'Shape "plymesh" "string filename" "a.obj"', "a plymesh must be a .ply or .ply.gz file"),
    ("v4", 'Shape "bilinearmesh"', "a shape must be trianglemesh, plymesh, loopsubdiv, sphere"),
]


@pytest.mark.parametrize("dialect, text, message", [*BAD_OPTIONS, *BAD_WORLDS])
def test_refused(read, tmp_path, dialect, text, message):
    write_exr(tmp_path / "a.exr", {"RGB": np.ones((1, 1, 3), np.float32)})
    in_world = (dialect, text, message) in BAD_WORLDS
    for word, meaning in (("TRIANGLE", TRIANGLE[:-1]), ("SQUARE", SQUARE), ("UP", UP)):
        text = text.replace(word, meaning)
    with pytest.raises(PbrtError) as caught:
        read(dialect, text if in_world else "", "" if in_world else text)
    assert str(caught.value).startswith(f"{tmp_path / 'scene.pbrt'}:")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "dialect, line, expected",
    [
        ("v4", "", PixelFilter("gaussian", (1.5, 1.5), 0.5)),
        ("v4", 'PixelFilter "gaussian" "float yradius" 2 "float sigma" 1', PixelFilter("gaussian", (1.5, 2), 1)),
        ("v4", 'PixelFilter "box"', None),
        ("v4", 'PixelFilter "triangle" "float xradius" 1', PixelFilter("triangle", (1, 2))),
        ("v3", "", None),
        ("v3", 'PixelFilter "gaussian" "float xwidth" 3', PixelFilter("gaussian", (3, 2), 0.5)),
        ("v3", 'PixelFilter "gaussian" "float alpha" 8', PixelFilter("gaussian", (2, 2), 0.25)),
        ("v3", 'PixelFilter "box" "float xwidth" 1', PixelFilter("box", (1, 0.5))),
    ],
)
def test_pixel_filters(read, dialect, line, expected):
    film = {"v3": "image", "v4": "rgb"}[dialect]
    assert read(dialect, head=f'Film "{film}"\nIntegrator "path"\n{line}\n').camera.filter == expected


# Images of whole numbers ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "dialect, more, expected",
    [
        ("v3", "", 0.21404),
        ("v3", '"bool gamma" "false"', 0.5),
        ("v4", "", 0.21404),
        ("v4", '"string encoding" "linear"', 0.5),
    ],
)
def test_encoding_of_textures(read, tmp_path, dialect, more, expected):
    """The value 127.5 of 255 is 0.5, or 0.21404 by the sRGB curve; v3 and v4 read TGA files."""
    pytest.importorskip("OpenImageIO")
    (tmp_path / "a.tga").write_bytes(tga(127, 128))
    texture = f'Texture "a" "spectrum" "imagemap" "string filename" "a.tga" {more}'
    matte = {"v3": 'Material "matte" "texture Kd" "a"', "v4": 'Material "diffuse" "texture reflectance" "a"'}[dialect]
    image = lobes(read(dialect, f"{texture} {matte}", add=TEXTURED))[0].reflectance
    assert image.texels.mean() == pytest.approx(expected, abs=2e-4)


def test_encodings_of_images(read, tmp_path):
    pytest.importorskip("OpenImageIO")
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=4\n\n-Y 1 +X 1\n"
    (tmp_path / "a.hdr").write_bytes(head + bytes([128, 64, 32, 129]))
    texture = 'Texture "a" "spectrum" "imagemap" "string filename" "a.hdr" Material "diffuse" "texture reflectance" "a"'
    close(lobes(read("v4", texture, add=TEXTURED))[0].reflectance.texels, [[[1, 0.5, 0.25]]])
    pytest.importorskip("OpenImageIO")
    (tmp_path / "a.tga").write_bytes(tga(127, 128))
    (light,) = read("v3", 'LightSource "infinite" "string mapname" "a.tga"').lights
    assert light.wrap == "repeat"
    (part,) = read("v4", 'Material "diffuse" "string normalmap" "a.tga"', add=TEXTURED).parts
    assert light.texels.mean() == pytest.approx(0.5, abs=1e-6) == part.material.relief.image.texels.mean()
