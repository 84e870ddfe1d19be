"""Bad input of every kind: a result or the library's own error, no hang, no flood; and what once was neither.

Each kind of case is a function of a source of random numbers and a folder with good files. It damages one of them, and
lets through what is allowed: a result, or the library's own error. ``DMIS_FUZZ=100`` runs a hundred times as many.
"""

import contextlib
import gzip
import io
import os
import random
import re
import resource
import runpy
import signal
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers import tga

import dmis
from dmis.cli.arguments import COMMANDS
from dmis.cli.commands import main
from dmis.experiment.reference import load_reference
from dmis.fit.registry import RULES, make_rule
from dmis.formats.mesh_files import MESH_SUFFIXES
from dmis.formats.pbrt import directives
from dmis.formats.pbrt.dialect import DIALECTS
from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.tokens import PbrtError
from dmis.geometry import shapes
from dmis.image import read_exr, write_exr, write_png
from dmis.image_reader import IMAGE_SUFFIXES, load_image
from dmis.scene.scene import Scene, SceneWarning

SECONDS = 5.0
"""Most that a case may take of its process's time: the machine may be busy."""
SCENES = Path(__file__).parent.parent / "scenes"
TOKEN = re.compile(r'\[[^\]"]*\]|"[^"\n]*"|[^\s"\[\]#]+|\[|\]|#[^\n]*')

V3 = """Integrator "directlighting" Film "image" Camera "perspective" "float fov" [40] WorldBegin AttributeBegin
AreaLightSource "diffuse" "rgb L" [1 2 3] Shape "disk" "float radius" 2 AttributeEnd MakeNamedMaterial "a"
"string type" "matte" "rgb Kd" [.1 .2 .3] NamedMaterial "a" Texture "t" "spectrum" "imagemap" "string filename" "a.exr"
Material "matte" "texture Kd" "t" Shape "plymesh" "string filename" "a.ply" LightSource "infinite" "string mapname"
"a.exr" Shape "loopsubdiv" "integer levels" 1 "integer indices" [0 2 1 0 1 3 0 3 2 1 2 3] "point3 P"
[0 0 0 1 0 0 0 1 0 0 0 1] MediumInterface "" "" ObjectBegin "o" Shape "sphere" ObjectEnd ObjectInstance "o" WorldEnd"""
V4 = """Film "rgb" "float iso" 100 PixelFilter "box" Integrator "volpath" "integer maxdepth" 1
ColorSpace "srgb" WorldBegin LightSource "distant" "blackbody L" 3000 AttributeBegin
AreaLightSource "diffuse" "spectrum L" [400 1 500 2] Shape "sphere" "float radius" 2 AttributeEnd Material "mix"
"string materials" ["b" "b"] MakeNamedMaterial "b" "string type" "diffuse" "spectrum reflectance" "a.spd"
Include "empty.pbrt" Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "normal N" [0 0 1 0 0 1 0 0 1]"""
TEXTS = [TOKEN.findall(path.read_text()) for path in sorted(SCENES.glob("*.pbrt"))]
TEXTS += [TOKEN.findall(V3), TOKEN.findall(V4)]
"""Scenes as tokens: those that come with the library, and two with what they lack."""
SMALL = """SurfaceIntegrator "directlighting" Camera "perspective" Film "image" "integer xresolution" 6
"integer yresolution" 4 WorldBegin LightSource "point" """
TRIANGLE = 'Shape "trianglemesh" "integer indices" [0 1 2] "point P" [-9 -9 2  9 -9 2  0 9 2]'
NUMBERS = "0 1 -1 3 1e9 1000000000 65536 1e38 1e308 1e-320 -0 2147483647 2147483648 .5 nan inf".split()
NASTY = ["[", "]", '"', '""', '"a\0b"', "\ufffd", "[1 2", "[]", '"../../../etc/passwd"', '"/"', "#", "\0", "²", ""]
PARAMETERS = """"float radius" 2,"point P" [0 0 0 1 0 0 0 1 0],"integer indices" [0 1 2],"rgb L" [1 2 3],"rgb Ks" 0,
"rgb Kd" [.5 .5 .5],"float scale" 3,"string filename" "a.ply","string filename" "a.exr","texture Kd" "t","rgb I" 1,
"integer levels" 2,"normal N" [0 0 1 0 0 1 0 0 1],"integer nlevels" 20,"float power" 3,"float zmin" 0,"float alpha" .5,
"spectrum L" "a.spd","string type" "matte","rgb reflectance" [.1 .1 .1],"string mapname" "a.exr","texture alpha" "t",
"texture bumpmap" "t","texture displacement" "t","string normalmap" "a.exr","texture amount" "t","float uscale" 3,
"bool twosided" "true","string materials" ["a" "b"],"spectrum eta" "glass-BK7\"""".replace("\n", "").split(",")
MAKERS = {
    "Shape": "sphere disk cylinder trianglemesh plymesh loopsubdiv",
    "Material": "matte plastic metal mirror glass uber mix diffuse conductor dielectric coateddiffuse coatedconductor",
    "LightSource": "point spot distant infinite",
    "AreaLightSource": "diffuse area",
    'Texture "t" "spectrum"': "constant scale imagemap mix checkerboard",
    'Texture "t" "float"': "constant scale imagemap mix checkerboard",
    "MakeNamedMaterial": "a b",
    "NamedMaterial": "a b",
}
MADE = [f'{line} "{kind}"' for line, kinds in MAKERS.items() for kind in kinds.split()]
WORDS = sorted(
    {token for text in TEXTS for token in text if len(token) < 40} | {*directives._DIRECTIVES, *MADE, *PARAMETERS}
)
"""Tokens, directives with a kind, and parameters that belong to the format."""
IMAGE_USES = [
    'Texture "t" "color" "imagemap" "string filename" "{}" Material "matte" "texture Kd" "t"',
    'Texture "t" "float" "imagemap" "string filename" "{}" Material "diffuse" "string normalmap" "{}"',
    'LightSource "infinite" "string mapname" "{}"',
]
OBJ = """mtllib material.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 .5
vt 0 0
vt 1 1
vn 0 0 1
usemtl red
f 1/1/1 2/2/1 3/1/1 4/2/1
usemtl lamp
f -1 -2 -3
"""
MTL = """newmtl red
Kd 1 0.5 0
Ks .5 .5 .5
Ns 20
map_Kd -s 2 2 image.tga
newmtl lamp
Ke 2 2 1
map_Ke image.tga
d .5
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Good files, for scenes to name and, in ``good``, for cases to damage."""
    folder = tmp_path_factory.mktemp("fuzz")
    sources = "".join(path.read_text() for path in SCENES.rglob("*.pbrt"))
    (folder / "geometry").mkdir()
    (folder / "textures").mkdir()
    for name in {"a.exr", *re.findall(r"[\w/-]+\.exr", sources)}:
        write_exr(folder / name, {"RGB": np.full((2, 4, 3), 0.5, np.float32)})
    for name in {"a.ply", *re.findall(r"[\w/-]+\.ply", sources)}:
        trimesh.creation.box().export(folder / name)
    for name in ("geometry/tt-world.pbrt", "geometry/interior.pbrt"):
        (folder / name).write_text((SCENES / name).read_text())
    (folder / "geometry/creature.pbrt").write_text(TRIANGLE)
    (folder / "a.spd").write_text("400 1\n700 .5\n")
    (folder / "empty.pbrt").write_text("")
    (folder / "scene.pbrt").write_text(f"{SMALL} {TRIANGLE} WorldEnd")
    good = folder / "good"
    good.mkdir()
    ball = trimesh.creation.icosphere(1)
    (good / "a.ply").write_bytes(trimesh.exchange.ply.export_ply(ball, encoding="ascii"))
    ball.export(good / "b.ply", vertex_normal=True)
    ball.export(good / "c.stl")
    (good / "d.stl").write_text(trimesh.exchange.stl.export_stl_ascii(ball))
    (good / "e.obj").write_text(OBJ)
    (good / "material.mtl").write_text(MTL)
    (good / "image.tga").write_bytes(tga(*range(8)))
    room = runpy.run_path(str(SCENES / "make_room.py"))
    few = [thing for thing in room["things"](metals=True) if thing.name in ("earth", "lamp", "leaf 20")]
    room["write_glb"](good / "f.glb", few)
    picture = np.random.default_rng(1).random((4, 6, 3)).astype(np.float32)
    write_exr(good / "g.exr", {"RGB": picture, "weight": picture[..., 0]}, {"dmis.provenance": "{}"})
    (good / "h.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 6\n" + bytes(range(96)))
    (good / "i.pfm").write_bytes(b"PF\n6 4\n-1.0\n" + picture.astype("<f4").tobytes())
    write_png(good / "j.png", picture)
    return folder


def good_file(rng, folder, suffixes):
    return rng.choice([path for path in sorted((folder / "good").iterdir()) if path.suffix in suffixes])


# --- kinds of cases


def token(rng):
    """Return a word that belongs to the format, a number, a list, or none of these."""
    some = rng.choice((NUMBERS, ["0", "1", "2", "-1", "3"], [*NUMBERS, "1e", "x", '"a"']))
    numbers = f"[{' '.join(rng.choice(some) for _ in range(rng.choice([0, 1, 3, 6, 9, 12, 16])))}]"
    letters = "".join(chr(rng.choice([rng.randrange(128), rng.randrange(0x3000)])) for _ in range(rng.randint(0, 6)))
    return rng.choice((rng.choice(WORDS), rng.choice(NUMBERS), rng.choice(NASTY), numbers, letters))


def mutated(rng, tokens):
    """Return the text of tokens that are dropped, doubled, put in, replaced, or cut off."""
    tokens = list(tokens)
    for _ in range(rng.randint(1, 6)):
        k = rng.randrange(max(len(tokens), 1))
        new = {"drop": [], "double": 2 * tokens[k : k + 1], "put": [token(rng), *tokens[k : k + 1]]}
        tokens[k : k + 1] = new.get(rng.choice(["drop", "double", "put", "replace", "replace"]), [token(rng)])
        if rng.random() < 0.04:
            del tokens[k:]
    return "\n".join(tokens)


def read(folder, text, dialect=None):
    """Return the scene of a text, None where it is refused as it should be: with file, line and token."""
    path = folder / "case.pbrt"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        return read_pbrt(path, dialect=dialect)
    except PbrtError as error:
        message = str(error)
        assert re.match(r".*\.pbrt(\.gz)?:\d+: token .+: .", message, re.DOTALL), message
        assert max(map(len, message.split("\n"))) < 3000
        return None


def parser(rng, folder):
    """Read a scene file, packed or not."""
    text = mutated(rng, rng.choice(TEXTS))
    if rng.random() < 0.05:
        packed = gzip.compress(text.encode("utf-8", "surrogatepass"), 1)
        (folder / "packed.pbrt.gz").write_bytes(damaged(rng, packed) if rng.random() < 0.5 else packed)
        text = 'Include "packed.pbrt.gz"'
    read(folder, text, rng.choice([None, None, *DIALECTS]))


def rendering(rng, folder):
    """Render a scene file of lines that mostly belong there: its image is finite."""
    lines = [" ".join([rng.choice(MADE), *rng.sample(PARAMETERS, rng.randint(0, 2))]) for _ in range(2)]
    scene = read(folder, "\n".join([SMALL, *lines[: rng.randint(1, 2)], TRIANGLE]))
    if scene is not None:
        image = dmis.render(scene, rng.choice(["balance", "pbrt", "one-sample"]), 2, parallel=1).image
        assert np.isfinite(image).all() and (image >= 0).all()


def damaged(rng, data):
    """Return bytes of which some are changed, cut or doubled, and numbers made extreme."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        near = len(out) if rng.random() < 0.4 else min(len(out), 400)
        k = rng.randrange(max(near, 1))
        whole = rng.choice([0, 1, -1, 2**31 - 1, 2**30, 65536, 10**6, 255])
        real = rng.choice([float("nan"), float("inf"), 1e38, -1e38, 1e-45, 0.0])
        order, size, what = rng.choice("<>"), rng.choice([1, 4, 40]), rng.randrange(8)
        texts = [match.span() for match in re.finditer(rb"\d+", bytes(out[:near]))]
        if what == 0:
            out[k : k + 1] = bytes([rng.randrange(256)])
        elif what in (1, 2):
            out[k : k + 4] = struct.pack(order + "i", whole) if what == 1 else struct.pack(order + "f", real)
        elif what in (3, 4):
            out[k : k + size] = b"" if what == 3 else 2 * out[k : k + size]
        elif what == 5 and rng.random() < 0.4:
            del out[k:]
        elif texts:
            begin, end = rng.choice(texts)
            out[begin:end] = rng.choice([*NUMBERS, "2", "3", "4", "99"]).encode()
    return bytes(out)


def mesh(rng, folder):
    """Read a file of a mesh or a model: what is read renders; an error names the file."""
    source = good_file(rng, folder, MESH_SUFFIXES)
    path, data = folder / f"case{source.suffix}", source.read_bytes()
    path.write_bytes(damaged(rng, data))
    if source.suffix == ".ply" and rng.random() < 0.2:
        packed = rng.choice([gzip.compress(damaged(rng, data), 1), damaged(rng, gzip.compress(data, 1))])
        (folder / "case.ply.gz").write_bytes(packed)
        read(folder, 'WorldBegin Shape "plymesh" "string filename" "case.ply.gz" WorldEnd', rng.choice([*DIALECTS]))
        return
    for name in ("material.mtl", "image.tga"):
        whole = (folder / "good" / name).read_bytes()
        (folder / name).write_bytes(damaged(rng, whole) if rng.random() < 0.5 else whole)
    try:
        scene = dmis.load_scene(path, (4, 4))
    except ValueError as error:
        assert str(path) in str(error) or len(str(error)) < 300, error
        return
    with contextlib.suppress(ValueError):  # of what is too far away, or too bright
        assert np.isfinite(dmis.render(scene, "balance", 1, parallel=1).image).all()


def picture(rng, folder):
    """Read an image file of any format, by itself and in a scene: an error names the file."""
    source = good_file(rng, folder, IMAGE_SUFFIXES)
    path = folder / f"picture{source.suffix}"
    path.write_bytes(damaged(rng, source.read_bytes()))
    use = rng.choice(IMAGE_USES).replace("{}", path.name)
    read(folder, f'WorldBegin {use} {TRIANGLE} "texture alpha" "t"', rng.choice([*DIALECTS]))
    try:
        image = load_image(path, linear=rng.random() < 0.5, alpha=rng.random() < 0.5)
    except ValueError as error:
        assert str(path) in str(error), error
        return
    assert image.dtype == np.float32 and image.size
    if source.suffix == ".exr":
        assert all(layer.dtype == np.float32 and layer.size for layer in read_exr(path)[0].values())
        with contextlib.suppress(ValueError):
            load_reference(path)


AMOUNTS = ["", " ", "1" * 5000]
AMOUNTS += "0 1 2 3 4 5 16 -1 0.5 0.25 1e400 1e-400 1e9 99999999999999999999 nan inf -inf x".split()
KEYS = "patch spp filter size sigma reuse combiner sampler guard gamma cost w techniques objective channels".split()
CHOICES = "gaussian none joint yes no rgb balance power optimal sobol balance+power cutoff stratified random".split()


def rule_text(rng):
    """Return a rule with options, right or wrong."""
    options = [
        f"{rng.choice([*KEYS, ''])}={rng.choice([rng.choice(AMOUNTS), rng.choice(CHOICES)])}"
        for _ in range(rng.randint(0, 3))
    ]
    return ":".join([rng.choice([*RULES, "none", ""]), *([",".join(options)] if options else [])])


def rule(rng, folder):
    """Make a rule: one that renders, or an error."""
    text = rule_text(rng)
    try:
        make_rule(text)
        scene = dmis.load_scene(folder / "scene.pbrt")
        result = dmis.render(scene, text, rng.choice([1, 8, 20]), parallel=1)
    except ValueError as error:
        assert len(str(error)) < 9000
    else:
        assert np.isfinite(result.image).all()


SIZES = ["4x4", "1x1", "0x0", "-1x4", "99999x1", "65535x65535", "4", "x", "4x4x4", "²x²", "1" * 5000 + "x1"]
FILES = ["no/such/a.exr", ".", "/", "/proc/x.exr", "/dev/full", "/dev/null", "out.exr", "out.png", "good/a.ply", ""]
FILES += ["a\nb.exr", "\udcff.exr", "x" * 300 + ".exr", "scene.pbrt", "good/g.exr", "-"]


def command_line(rng):
    """Return words of a command, its scene, and some of its options with values that are mostly of their kind."""
    name = rng.choice([*COMMANDS, "render", "render", "compare"])
    options = {key.split()[0]: about for key, about in COMMANDS[name].options.items() if key.startswith("-")}
    words = [name, rng.choice([*["scene.pbrt"] * 12, "good/a.ply", "case.pbrt", "no-such", "", "/dev/zero"])]
    if name in ("render", "compare"):
        words += ["--spp", "2", "--resolution", "6x4", "-o", "out.exr" if name == "render" else "out"]
    for option in rng.sample(list(options), min(rng.randint(0, 4), len(options))):
        values = {"--rule": [rule_text(rng)], "--rules": [rule_text(rng)], "--resolution": SIZES, "-o": FILES}
        values |= {
            "--checkpoint": FILES,
            "--stats": FILES,
            "--png": FILES,
            "--reference": FILES,
            "--cluster": ["tcp://"],
        }
        chosen = rng.choice([*(options[option].get("choices") or ()), *values.get(option, AMOUNTS)])
        words += [option] if options[option].get("action") == "store_true" else [option, str(chosen)]
    if name == "compare" and "--reference" not in words:
        words += ["--reference", "good/g.exr"]
    return [*words, rng.choice(["--", "--nothing", "\udcff", "@x"])] if rng.random() < 0.1 else words


def command(rng, folder):
    """Run the command line in this process: 0, or 2 and a message."""
    words, before = command_line(rng), (folder / "scene.pbrt").read_bytes()
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        with contextlib.redirect_stderr(io.StringIO()) as err:
            try:
                code = main(words)
            except SystemExit as stop:
                code = stop.code
    (folder / "scene.pbrt").write_bytes(before)
    said = err.getvalue()
    assert code in (0, 2) and "Traceback" not in said, (words, code, said)
    assert code == 0 or re.search(r"dmis.*: error: .", said), (words, said)
    assert max(map(len, said.split("\n"))) < 9000, (words, len(said))


CASES = {parser: 200, rendering: 20, mesh: 100, picture: 120, rule: 60, command: 20}
"""Cases of each kind in a run of the tests."""


@pytest.fixture
def limits(monkeypatch):
    """Limits that are reached in time, no plots, and an error where a case takes too long or asks for too much."""

    def late(*_):
        raise RuntimeError(f"more than {SECONDS} s of computing")

    quadric = shapes.Quadric.mesh
    monkeypatch.setattr("dmis.geometry.subdivision.MAX_SUBDIVIDED", 2**10)
    monkeypatch.setattr("dmis.formats.pbrt.reader.MAX_SCENE_TRIANGLES", 2**14)
    monkeypatch.setattr("dmis.report.compare._draw", lambda *_: None)
    monkeypatch.setattr(shapes.Quadric, "mesh", lambda self, segments=8: quadric(self, 8))
    before, addresses = signal.signal(signal.SIGPROF, late), resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (2**35, addresses[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, addresses)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.signal(signal.SIGPROF, before)


@pytest.mark.usefixtures("limits")
@pytest.mark.filterwarnings("ignore::dmis.scene.scene.SceneWarning")
@pytest.mark.parametrize("kind", CASES, ids=lambda kind: kind.__name__)
def test_bad_input(folder, kind):
    for k in range(CASES[kind] * int(os.environ.get("DMIS_FUZZ", "1"))):
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        try:
            kind(random.Random(f"{kind.__name__} {k}"), folder)
        except BaseException as error:
            error.add_note(f"{kind.__name__}, case {k}")
            raise


def test_what_is_not_changed_is_read(folder):
    """The cases start from files that are good."""
    for tokens in TEXTS[:-1]:
        with warnings.catch_warnings(action="ignore", category=SceneWarning):
            assert isinstance(read(folder, "\n".join(tokens)), Scene)
    for path in sorted((folder / "good").iterdir()):
        if path.suffix in MESH_SUFFIXES:
            assert dmis.load_scene(path, material=dmis.matte()).parts[0].mesh.triangles
        elif path.suffix in IMAGE_SUFFIXES:
            assert load_image(path).size
    assert load_reference(folder / "good/g.exr").first.shape == (4, 6, 3)
    assert main(["info", str(folder / "scene.pbrt")]) == 0


# --- what once failed


def test_images_that_end_early(tmp_path, monkeypatch):
    write_exr(tmp_path / "a.exr", {"RGB": np.zeros((9, 9, 3), np.float32)})
    (tmp_path / "a.exr").write_bytes((tmp_path / "a.exr").read_bytes()[:-9])
    with pytest.raises(ValueError, match=r"a\.exr as EXR: its pixels are damaged or cut off"):
        read_exr(tmp_path / "a.exr")
    # Not a number, halves of other kinds
    first = np.zeros((2, 2, 3), np.float32)
    write_exr(tmp_path / "a.exr", {"first": first, "second": first[..., 0]})
    with pytest.raises(ValueError, match="must hold an image of three channels, or halves"):
        load_reference(tmp_path / "a.exr")
    monkeypatch.setattr("dmis.experiment.reference.read_exr", lambda _: ({"RGB": first + np.float32(np.nan)}, {}))
    with pytest.raises(ValueError, match="of finite numbers"):
        load_reference(tmp_path / "a.exr")


def test_images_that_say_too_much(tmp_path, monkeypatch):
    """By their headers: sides, pixels, channels."""
    write_exr(tmp_path / "a.exr", {str(k): np.zeros((2, 8), np.float32) for k in range(9)})
    assert len(read_exr(tmp_path / "a.exr")[0]) == 9
    data = (tmp_path / "a.exr").read_bytes()
    window = struct.pack("<4i", 0, 0, 7, 1)
    (tmp_path / "b.exr").write_bytes(data.replace(window, struct.pack("<4i", 0, 0, 65535, 0)))
    with pytest.raises(ValueError, match=r"b\.exr as EXR: .*1 to 65535 pixels on a side .* got 65536x1"):
        read_exr(tmp_path / "b.exr")
    with pytest.raises(ValueError, match=r"and 100 values in them; got 9 of 8x2"):
        read_exr(tmp_path / "a.exr", 100)
    monkeypatch.setattr("dmis.base.window.MAX_CHANNELS", 8)
    with pytest.raises(ValueError, match=r"at most 8 channels, .* got 9 of 8x2"):
        read_exr(tmp_path / "a.exr")


def test_no_memory_is_an_error(folder, monkeypatch, capsys):
    """Where no limit is known beforehand."""
    monkeypatch.setattr("dmis.cli.shared.load_scene", lambda *_, **__: np.empty(2**55))
    assert main(["info", str(folder / "scene.pbrt")]) == 2
    assert "there is not enough memory" in capsys.readouterr().err
