"""OBJ files with their MTL files: which material each triangle gets, and what is named as left out."""

import re
import sys

import numpy as np
import pytest
from PIL import Image as PIL

import dmis
from dmis.brdf.fresnel import Conductor
from dmis.brdf.lobe import Lambert
from dmis.brdf.microfacet import Microfacet
from dmis.brdf.specular import SpecularTransmission
from dmis.image import encode_png, write_exr
from dmis.scene.scene import SceneWarning

pytest.importorskip("OpenImageIO")
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 0 -1\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3\n"


@pytest.fixture
def load(tmp_path):
    def load(mtl, obj="usemtl a\n" + FACE, name="a.mtl", **options):
        (tmp_path / name).write_text(mtl)
        (tmp_path / "a.obj").write_text(f"mtllib {name}\n{CORNERS}{obj}")
        return dmis.load_scene(tmp_path / "a.obj", (8, 8), **options)

    return load


def lobes(scene, part=0):
    return scene.parts[part].material.lobes


def test_each_material_is_a_part(load):
    """Triangles of one name are one part, wherever they stand; those without a name are grey."""
    mtl = "newmtl a\nKd 1 0 0\nKa 1 1 1\nillum 2\nnewmtl b c\nKd 0 .5 0\n"
    scene = load(mtl, f"s 0\n{FACE}usemtl b c\n{FACE}s off\nusemtl a\n{FACE}usemtl  b  c\n{FACE}")
    names = {part.material.name: (part.mesh.triangles, part.material.lobes[0].reflectance) for part in scene.parts[:3]}
    assert names == {"matte": (1, 0.5), "b c": (2, (0, 0.5, 0)), "a": (1, (1, 0, 0))}
    assert "unread" not in scene.source
    # materials by name
    red = dmis.matte((1, 0, 0))
    scene = load("newmtl a\nKd .2\nnewmtl b\nKd .4\n", f"usemtl a\n{FACE}usemtl b\n{FACE}", material={"b": red})
    assert scene.parts[1].material is red and scene.parts[0].material.name == "a"
    with pytest.raises(ValueError, match=r"material must have names of materials .*, \['a'\]; got 'c'"):
        load("newmtl a\nKd .2\n", material={"c": red})


def test_coats_and_metals(load):
    diffuse, coat = lobes(load("newmtl a\nKd .5 .4 .3\nKs .5 .5 .5\nNs 40\n"))
    assert isinstance(diffuse, Lambert) and diffuse.reflectance == (0.5, 0.4, 0.3)
    assert isinstance(coat, Microfacet) and coat.distribution.exponent == pytest.approx(40)
    assert (coat.reflectance, coat.fresnel.eta) == ((0.5, 0.5, 0.5), 1.5)
    (metal,) = lobes(load("newmtl a\nKd 0 0 0\nKs .9 .6 .2\nNs 1000\n"))
    assert isinstance(metal.fresnel, Conductor) and metal.distribution.exponent == pytest.approx(1000)
    np.testing.assert_allclose(metal.fresnel(np.ones(1, np.float32))[:, 0], [0.9, 0.6, 0.2], rtol=1e-5)
    # as a glTF file of the same numbers; without Pr as rough as Ns says
    for mtl, expected in (
        ("Pr .3\nPm 1\nKs 1\n", {"metallic": 1, "roughness": 0.3}),
        ("Pm .25\nNs 30\n", {"metallic": 0.25, "roughness": 0.5}),
        ("Pr .6\nd .5\n", {"roughness": 0.6, "opacity": 0.5}),
    ):
        surface = dmis.metallic_roughness((0.8, 0.4, 0.2), **expected)
        assert repr(lobes(load(f"newmtl a\nKd .8 .4 .2\n{mtl}"))) == repr(surface.lobes)
    # illum 7 refracts: Tf is what it transmits, Ni its index; an image that it does without is named
    cases = [("Kd .01\nKs .95\nNi 1.33\nTf .9 .8 2\nd .1\n", (0.9, 0.8, 1), 1.33), ("", (1, 1, 1), 1.5)]
    for mtl, kt, eta in (*cases, ("Ni 1.4\nmap_Kd\n", (1, 1, 1), 1.4)):
        reflection, refraction = lobes(load(f"newmtl a\nillum 7 # glass\n{mtl}"))
        assert (refraction.transmittance, refraction.eta, reflection.fresnel.eta) == (kt, eta, eta)
    with pytest.warns(SceneWarning, match="left out: map_Kd of glass$"):
        load("newmtl a\nillum 7\nmap_Kd wood.png\n")


@pytest.mark.parametrize("statement", ["d 0.25\nTr 0.25", "d 0.25", "Tr 0.75", "d -halo 0.25"])
def test_opacity(load, statement):
    clear, diffuse = lobes(load(f"newmtl a\nKd .8\n{statement}\n"))
    assert isinstance(clear, SpecularTransmission) and clear.transmittance == (0.75,)
    np.testing.assert_allclose(diffuse.reflectance, [0.2] * 3)


def test_images(load, tmp_path):
    """The bottom row is at v = 0, Kd multiplies it, and -s and -o place it; a black Kd is an exporter's habit."""
    texels = np.random.default_rng(1).random((2, 3, 3), np.float32)
    (tmp_path / "sub").mkdir()
    write_exr(tmp_path / "sub/my wood.exr", {"RGB": texels})
    for kd, factor in (("", 1), ("Kd 0 0 0", 1), ("Kd 1 .5 .25", [1, 0.5, 0.25])):
        (lobe,) = lobes(load(f"newmtl a\n{kd}\nmap_Kd -s 2 3 1 -o .5 sub\\my wood.exr\n"))
        np.testing.assert_allclose(lobe.reflectance.texels, texels[::-1] * factor, rtol=1e-6)
        assert (lobe.reflectance.scale, lobe.reflectance.offset) == ((2, 3), (0.5, 0))
    for empty in ("map_Kd", "map_Kd ", "MAP_KD"):  # no image
        assert lobes(load(f"newmtl a\nKd .2 .4 .6\n{empty}\n"))[0].reflectance == (0.2, 0.4, 0.6)
    # escaped blanks in names of MTL files, one or several in a line, and of images
    write_exr(tmp_path / "my wood.exr", {"RGB": np.full((1, 2, 3), (0.1, 0.2, 0.3), np.float32)})
    (tmp_path / "my lib.mtl").write_text("newmtl a\nmap_Kd my\\ wood.exr\n")
    (tmp_path / "b.mtl").write_text("newmtl b\nKd 1\n")
    for libraries in ("my\\ lib.mtl", "b.mtl my\\ lib.mtl"):
        (tmp_path / "a.obj").write_text(f"mtllib {libraries}\n{CORNERS}usemtl a\n{FACE}")
        (lobe,) = lobes(dmis.load_scene(tmp_path / "a.obj"))
        np.testing.assert_allclose(lobe.reflectance.texels[0, 0], [0.1, 0.2, 0.3])


def test_masks(load, tmp_path):
    """map_d is the opacity of its file, or its values, as they are."""
    values = np.array([[0, 51], [255, 102]], np.uint8)
    (tmp_path / "grey.png").write_bytes(encode_png(values))
    mask = load("newmtl a\nKd 1\nmap_d grey.png\n").parts[0].mask
    np.testing.assert_allclose(mask.image.texels[..., 0], values[::-1] / 255, atol=1e-6)
    PIL.fromarray(np.stack([values] * 3 + [values.T], axis=2)).save(tmp_path / "leaf.png")
    mask = load("newmtl a\nKd 1\nmap_d leaf.png\n").parts[0].mask
    np.testing.assert_allclose(mask.image.texels[..., 0], values.T[::-1] / 255, atol=1e-6)
    assert mask.cutoff is None
    with pytest.warns(SceneWarning, match="left out: mask of a surface that emits"):
        assert load("newmtl a\nKe 1\nmap_d leaf.png\n").parts[0].mask is None


def test_lamps(load, tmp_path):
    """Triangles that emit are lights, beside the default sky and lamp if they light nothing."""
    scene = load("newmtl a\nKd 0\nKe 2 3 4\n", f"{FACE}usemtl a\n{FACE}", lights=[])
    (light,) = scene.lights
    assert light.radiance == (2, 3, 4) and [part.light for part in scene.parts] == [None, light]
    sky = dmis.EnvironmentLight(np.ones((1, 2, 3)))
    assert load("newmtl a\nKe 2\n", lights=[sky]).lights[0] is sky and len(load("newmtl a\nKe 2\n").lights) == 3
    # lamps that overlap are left out
    with pytest.warns(SceneWarning, match="left out: emission of triangles that overlap$"):
        scene = load("newmtl a\nKd .5\nKe 2\n", "v .5 0 0\nusemtl a\nf 1 2 3\nf 5 2 3\n")
    assert scene.parts[0].light is None
    # Ke multiplies map_Ke, unless it is black; without texture coordinates there is no such lamp
    texels = np.random.default_rng(1).random((2, 3, 3), np.float32)
    write_exr(tmp_path / "glow.exr", {"RGB": texels})
    for ke, factor in (("", 1), ("Ke 0 0 0\n", 1), ("Ke 4 2 1\n", [4, 2, 1])):
        (light,) = load(f"newmtl a\n{ke}map_Ke glow.exr\n").lights[-1:]
        np.testing.assert_allclose(light.radiance.texels, texels[::-1] * factor, rtol=1e-6)
    with pytest.warns(SceneWarning, match="left out: map_Ke of triangles without texture coordinates$"):
        assert load("newmtl a\nKe 1\nmap_Ke glow.exr\n", "usemtl a\nf 1 2 3\n").parts[0].light is None
    # as in glTF files: one material for all replaces reflection alone, and nothing is said of what it replaces
    values = np.random.default_rng(1).random((3, 3, 3)).astype(np.float32)
    write_exr(tmp_path / "leaf.exr", {"RGB": values})
    mtl = "newmtl a\nKd 1\nmap_d leaf.exr\nsharpness 3\nnewmtl b\nKe 1\n"
    obj = f"usemtl a\n{FACE}usemtl b\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 5 6 7\n"
    scene = load(mtl, obj, material=dmis.matte(0.3), lights=[])
    assert [part.mask is not None for part in scene.parts] == [True, False]
    assert [part.light is not None for part in scene.parts] == [False, True]


@pytest.mark.parametrize(
    "mtl, obj, named",
    [
        ("newmtl a\nbump b.png\nmap_Ks s.png\n", "usemtl a\n" + FACE, "bump of a material, map_Ks of a material"),
        ("newmtl a\nmap_Kd none.png\n", "usemtl a\n" + FACE, "missing file 'none.png'"),
        ("newmtl a\nKd 1\n", "mtllib gone.mtl\nusemtl a\n" + FACE, "missing file 'gone.mtl'"),
        ("newmtl a\nKd 1\n", f"usemtl b\n{FACE}", "material 'b' without a definition"),
        ("newmtl a\nKd 1\n", f"usemtl a\ns 1\n{FACE}", "smoothing groups (it has no normals, it is flat)"),
        ("newmtl a\nKd 2\nKs 1.2\n", "usemtl a\n" + FACE, "Kd above 1 of 'a', Ks above 1 of 'a'"),
    ],
)
def test_what_is_left_out_is_named(load, tmp_path, mtl, obj, named):
    with pytest.warns(SceneWarning, match=f"left out: {re.escape(named)}$") as caught:
        scene = load(mtl, obj)
    assert len(caught) == 1 and caught[0].filename == __file__
    assert ", ".join(scene.source["unread"]) == named


@pytest.mark.parametrize(
    "line, message",
    [
        ("Kd 1 -2 3", "line 2: Kd must be 1 or 3 numbers from 0; got '1 -2 3'"),
        ("Ks 1 2", "line 2: Ks must be"),
        ("Ke 1e999", "line 2: Ke must be"),
        ("d 2", "line 2: d must be 1 number from 0 to 1; got '2'"),
    ],
)
def test_bad_statements(load, line, message):
    with pytest.raises(ValueError, match=r"a\.obj cannot be .* OBJ: material file .*a\.mtl, " + re.escape(message)):
        load(f"newmtl a\n{line}\n")


def test_files_outside_of_the_folder(load, tmp_path):
    """Images and MTL files, also by a link, only if that is allowed."""
    model = tmp_path / "model"
    model.mkdir()
    write_exr(tmp_path / "a.exr", {"RGB": np.ones((1, 1, 3), np.float32)})
    (model / "link.exr").symlink_to(tmp_path / "a.exr")
    (tmp_path / "b.mtl").write_text("newmtl a\nKd 1\n")
    for mtl, library in (("map_Kd ../a.exr", "a.mtl"), ("map_Kd link.exr", "a.mtl"), ("Kd 1", "../b.mtl")):
        (model / "a.mtl").write_text(f"newmtl a\n{mtl}\n")
        (model / "a.obj").write_text(f"mtllib {library}\n{CORNERS}usemtl a\n{FACE}")
        with pytest.raises(ValueError, match=r"is outside of the folder .* allowed .outside=True, --allow-outside"):
            dmis.load_scene(model / "a.obj")
        assert dmis.load_scene(model / "a.obj", outside=True).parts[0].material.name == "a"


MTL, USES = "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n", "usemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\n"
COMMENTS = "newmtl a # red\nKd 1 0 0 # 255 0 0\n # no\nnewmtl b\t#\nKd 0 1 0#2\n"
SIGNS = "newmtl C #FFCCDD\nKd 1 0 0\nnewmtl Material #2\nKd 0 1 0\n"


@pytest.mark.parametrize(
    "mtl, obj",
    [
        ("NEWMTL a\nKD 1 0 0\nNewmtl b\nkd 0 1 0\n", "USEMTL a\nF 1 2 3\nUsemtl b\nF 1 2 3\n"),
        (COMMENTS, "usemtl a # the first\nf 1 2 3 #1\nusemtl b #\nf 1 2 3\n"),
        (SIGNS, USES.replace("mtl a", "mtl C #FFCCDD").replace("mtl b", "mtl Material #2 # b")),
        ("\xef\xbb\xbf" + MTL, USES),
        (MTL.replace("\n", "\r"), USES),
        (MTL.replace("a\n", "Stra\xdfe\n"), USES.replace("a\n", "Stra\xdfe\n")),
    ],
)
def test_spellings_and_comments(tmp_path, mtl, obj):
    """Words in any case, comments behind anything, marks in front; numbers and colours are part of a name."""
    (tmp_path / "a.mtl").write_text(mtl, "latin-1")
    (tmp_path / "a.obj").write_text(f"MTLLIB a.mtl # by hand\n{CORNERS}{obj}", "latin-1")
    scene = dmis.load_scene(tmp_path / "a.obj", (8, 8))
    assert [part.material.lobes[0].reflectance for part in scene.parts[:2]] == [(1, 0, 0), (0, 1, 0)]
    (tmp_path / "a.mtl").write_text(mtl, "utf-16")
    with pytest.raises(ValueError, match=r"material file .*a\.mtl is UTF-16 or binary; .* save it as UTF-8"):
        dmis.load_scene(tmp_path / "a.obj")


@pytest.mark.parametrize(
    "name",
    ["C:\\Users\\me\\Textures\\Oak Wood.EXR", "/home/me/model/textures/oak wood.exr", "TEXTURES/OAK WOOD.EXR"]
    + ["..\\textures\\oak wood.exr # brown", "D:oak wood.exr", "c:/old/[x]/leaf 2.exr"],
)
def test_files_that_another_machine_named(load, tmp_path, name):
    """The longest end of the path that is in the folder of the model counts, in any case."""
    texels = np.random.default_rng(1).random((2, 3, 3), np.float32)
    (tmp_path / "textures").mkdir()
    write_exr(tmp_path / "textures/oak wood.exr", {"RGB": texels})
    write_exr(tmp_path / "oak wood.exr", {"RGB": texels / 2})
    write_exr(tmp_path / "Leaf 2.exr", {"RGB": texels})
    (lobe,) = lobes(load(f"newmtl a\nmap_Kd {name}\n", name="A.mtl", obj="mtllib x:\\y\\a.MTL\nusemtl a\n" + FACE))
    np.testing.assert_allclose(lobe.reflectance.texels, texels[::-1] / (2 if name[:2] == "D:" else 1), rtol=1e-6)
    (tmp_path / "Leaf 2.exr").unlink()
    (tmp_path / "Leaf 2.exr").symlink_to(__file__)
    with pytest.raises(ValueError, match="is outside of the folder"):
        load("newmtl a\nmap_Kd leaf 2.exr\n")


def test_one_damaged_image_leaves_the_others(load, tmp_path, monkeypatch):
    """What it should have coloured is grey; without its package no image can be read, which is an error."""
    write_exr(tmp_path / "good.exr", {"RGB": np.full((1, 2, 3), (0.1, 0.2, 0.3), np.float32)})
    (tmp_path / "bad.png").write_bytes(encode_png(np.zeros((9, 9, 3), np.uint8))[:60])
    mtl = "newmtl a\nKd .8 .4 0\nmap_Kd bad.png\nmap_d bad.png\nnewmtl b\nmap_Kd good.exr\nnewmtl c\nmap_Kd x.png\n"
    obj = "".join(f"usemtl {name}\n{FACE}" for name in "abc")
    with pytest.warns(SceneWarning, match=r"left out: damaged image: cannot read .*bad\.png as PNG: .*'x\.png'$"):
        scene = load(mtl, obj)
    grey, good, missing = (lobes(scene, k)[0].reflectance for k in range(3))
    assert grey == (0.4, 0.2, 0) and missing == (0.5,) * 3 and scene.parts[0].mask is None
    np.testing.assert_allclose(good.texels[0, 0], [0.1, 0.2, 0.3])
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    with pytest.raises(ValueError, match=r"reading PNG needs OpenImageIO.*dmis\[images\]"):
        load(mtl, obj)
