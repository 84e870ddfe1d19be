"""Bad pbrt files of every kind: a scene or the reader's own error, with file, line and token; no hang, no flood.

Cases are the shipped scenes with their tokens dropped, doubled, swapped, changed, and files made of words that belong
to the format in orders that may not.
"""

import re
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dmis import geometry, pbrt_directives, pbrt_reader, subdivision
from dmis.image import write_exr
from dmis.pbrt import PbrtError, PbrtWarning, read_pbrt
from dmis.pbrt_dialect import DIALECTS
from dmis.scene import Scene

SECONDS = 5.0
"""Most that a file may take, of this process, because the machine may be busy."""
FAST = settings(
    max_examples=120, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
MANY = settings(FAST, max_examples=2_500, derandomize=False)

SCENES = Path(__file__).parent.parent / "scenes"
TOKEN = re.compile(r'\[[^\]"]*\]|"[^"\n]*"|[^\s"\[\]#]+|\[|\]|#[^\n]*')
TEXTS = [TOKEN.findall(path.read_text()) for path in sorted(SCENES.glob("*.pbrt"))]

V3 = """Integrator "directlighting" Film "image" Camera "perspective" "float fov" [40] WorldBegin AttributeBegin
AreaLightSource "diffuse" "rgb L" [1 2 3] Shape "disk" "float radius" 2 AttributeEnd MakeNamedMaterial "a"
"string type" "matte" "rgb Kd" [.1 .2 .3] NamedMaterial "a" Texture "t" "spectrum" "imagemap" "string filename" "a.exr"
Material "matte" "texture Kd" "t" Shape "plymesh" "string filename" "a.ply" LightSource "infinite" "string mapname"
"a.exr" Shape "loopsubdiv" "integer levels" 1 "integer indices" [0 2 1 0 1 3 0 3 2 1 2 3] "point3 P"
[0 0 0 1 0 0 0 1 0 0 0 1] MediumInterface "" "" ObjectBegin "o" Shape "sphere" ObjectEnd ObjectInstance "o" WorldEnd"""
V4 = """Film "rgb" "float iso" 100 PixelFilter "box" Integrator "volpath" "integer maxdepth" 1 Option "bool quiet" true
ColorSpace "srgb" WorldBegin LightSource "distant" "blackbody L" 3000 "float illuminance" 4 AttributeBegin
AreaLightSource "diffuse" "spectrum L" [400 1 500 2] "float power" 3 Attribute "shape" "float radius" 2 Shape "sphere"
AttributeEnd Shape "bilinearmesh" "point3 P" [0 0 0 1 0 0 0 1 0 1 1 0] Material "mix" "string materials" ["b" "b"]
MakeNamedMaterial "b" "string type" "diffuse" "spectrum reflectance" "a.spd" Import "empty.pbrt" Shape "trianglemesh"
"point3 P" [0 0 0 1 0 0 0 1 0] "normal N" [0 0 1 0 0 1 0 0 1] "point2 uv" [0 0 0 1 1 1]"""
TEXTS += [TOKEN.findall(V3), TOKEN.findall(V4)]

WORDS = sorted(
    {token for text in TEXTS for token in text if len(token) < 40}
    | set(pbrt_directives._DIRECTIVES)
    | {f'"{kind} {name}"' for kind in DIALECTS["v3"].types for name in ("L", "Kd", "P", "radius", "indices", "scale")}
)
NUMBERS = "0 -1 1e9 1000000000 65536 1e308 1e-320 -0 2147483647 2147483648 .5 nan inf".split()
NASTY = ["[", "]", '"', '""', '"a\0b"', "\ufffd", "[1 2", "[]", '"../../../etc/passwd"', '"/"', '"."', "#", "\0"]
LISTS = st.lists(st.sampled_from(NUMBERS), max_size=20).map(lambda numbers: f"[{' '.join(numbers)}]")
TOKENS = st.one_of(st.sampled_from(WORDS), st.sampled_from(NUMBERS), st.sampled_from(NASTY), LISTS, st.text(max_size=6))
CHANGES = st.lists(
    st.tuples(st.sampled_from(["drop", "double", "swap", "put", "replace", "cut"]), st.integers(0, 2**20), TOKENS),
    min_size=1,
    max_size=6,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files for scenes to name; some of the shipped ones are named by small ones here."""
    import trimesh

    path = tmp_path_factory.mktemp("fuzz")
    for name in ("a.exr", "textures/grid.exr", "textures/sky.exr"):
        (path / name).parent.mkdir(exist_ok=True)
        write_exr(path / name, {"RGB": np.full((2, 4, 3), 0.5, np.float32)})
    (path / "geometry").mkdir()
    box = trimesh.creation.box()
    names = {name for text in TEXTS for name in re.findall(r"geometry/[\w-]+\.ply", " ".join(text))}
    for name in ("a.ply", *sorted(names)):
        box.export(path / name)
    (path / "geometry/creature.pbrt").write_text(
        'Shape "loopsubdiv" "integer nlevels" 1 '
        + " ".join(['"integer indices" [0 2 1 0 1 3 0 3 2 1 2 3]', '"point P" [0 0 0 1 0 0 0 1 0 0 0 1]'])
    )
    (path / "a.spd").write_text("400 1\n700 .5\n")
    (path / "empty.pbrt").write_text("")
    return path


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    """Limits that are reached in time."""
    monkeypatch.setattr(subdivision, "MAX_TRIANGLES", 2**12)
    monkeypatch.setattr(pbrt_reader, "MAX_TRIANGLES", 2**14)
    for name in ("sphere", "disk", "cylinder"):
        full = getattr(geometry, name)
        monkeypatch.setattr(geometry, name, lambda *a, full=full, **k: full(*a, **{**k, "segments": 8}))


def check(folder, text, dialect=None):
    """A scene, or the reader's error; in time."""
    path = folder / "scene.pbrt"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    begin = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", PbrtWarning)
            assert isinstance(read_pbrt(path, dialect=dialect), Scene)
        message = ""
    except PbrtError as error:
        message = str(error)
    assert not message or re.match(r".*\.pbrt:\d+: token .+: .", message, re.DOTALL), message
    assert len(message) < 3000
    assert time.process_time() - begin < SECONDS


def mutated(tokens, changes):
    tokens = list(tokens)
    for what, where, token in changes:
        k = where % max(len(tokens), 1)
        if what == "drop":
            del tokens[k : k + 1]
        elif what == "double":
            tokens[k:k] = tokens[k : k + 3]
        elif what == "swap":
            other = (where // 7) % max(len(tokens), 1)
            if tokens:
                tokens[k], tokens[other] = tokens[other], tokens[k]
        elif what == "put":
            tokens.insert(k, token)
        elif what == "replace":
            tokens[k : k + 1] = [token]
        else:
            del tokens[k:][: len(tokens)]
            tokens[k:] = []
    return "\n".join(tokens)


NAMES = (
    "P N uv st S indices radius height zmin zmax phimax levels nlevels L I scale power from to coneangle Kd Ks sigma "
    "eta k roughness reflectance opacity amount filename mapname maxdepth xresolution yresolution fov type"
).split()
VALUES = st.sampled_from(['"a.exr"', '"a.ply"', '"a.spd"', '"matte"', '"a"', "true", '"metal-Cu-eta"', "3", "-1", ".5"])
COMMON = """"float radius" 2,"point P" [0 0 0 1 0 0 0 1 0],"integer indices" [0 1 2],"rgb L" [1 2 3],
"rgb Kd" [.5 .5 .5],"float scale" 3,"string filename" "a.ply","string filename" "a.exr",
"texture Kd" "t","integer levels" 2,"rgb I" [1 1 1],
"normal N" [0 0 1 0 0 1 0 0 1],"integer nlevels" 20,"float power" 3,"rgb Ks" [0 0 0],"float zmin" 0,
"spectrum L" "a.spd","string type" "matte","rgb reflectance" [.1 .1 .1],"string mapname" "a.exr",
"bool twosided" "false\""""
PARAMETER = st.one_of(
    st.sampled_from(COMMON.replace("\n", "").split(",")),
    st.tuples(
        st.sampled_from([*sorted(DIALECTS["v3"].types), "bool", "string", "texture", "spectrum"]),
        st.sampled_from(NAMES),
        st.one_of(LISTS, VALUES),
    ).map(lambda p: f'"{p[0]} {p[1]}" {p[2]}'),
)
MAKERS = {
    "Shape": "sphere disk cylinder trianglemesh plymesh loopsubdiv bilinearmesh",
    "Material": "matte plastic metal mirror glass uber mix diffuse conductor dielectric",
    "LightSource": "point spot distant infinite",
    "AreaLightSource": "diffuse area",
    'Texture "t" "spectrum"': "constant scale imagemap",
    'Texture "t" "float"': "constant scale imagemap",
    "MakeNamedMaterial": "a b",
    "NamedMaterial": "a b",
    "ObjectBegin": "o",
    "ObjectInstance": "o",
    "Attribute": "shape light material",
}
MADE = st.sampled_from([f'{line} "{kind}"' for line, kinds in MAKERS.items() for kind in kinds.split()])
PLAIN = "AttributeBegin AttributeEnd TransformBegin TransformEnd ObjectEnd ReverseOrientation Identity".split()
MOVES = st.tuples(
    st.sampled_from(["Translate", "Scale"]), st.lists(st.sampled_from("1 -1 .5 0 1e9".split()), min_size=3)
)
LINE = st.one_of(
    st.sampled_from(PLAIN),
    MOVES.map(lambda x: f"{x[0]} {' '.join(x[1][:3])}"),
    st.tuples(MADE, st.lists(PARAMETER, max_size=4)).map(lambda x: " ".join([x[0], *x[1]])),
    st.tuples(MADE, st.lists(PARAMETER, max_size=2)).map(lambda x: " ".join([x[0], *x[1]])),
    st.tuples(st.sampled_from(WORDS), st.lists(PARAMETER, max_size=2)).map(lambda x: " ".join([x[0], *x[1]])),
)
WORLD = st.lists(LINE, max_size=10).map("\n".join)
HEADS = st.sampled_from(
    [
        "WorldBegin\n",
        'Integrator "directlighting" Film "image"\nWorldBegin\n',
        'Film "rgb" PixelFilter "box" Integrator "path" "integer maxdepth" 1\nWorldBegin\nShape "sphere"\n',
        "",
    ]
)


@FAST
@given(st.sampled_from(TEXTS), CHANGES)
def test_mutated_scenes(folder, tokens, changes):
    check(folder, mutated(tokens, changes))


@FAST
@given(HEADS, WORLD, st.sampled_from([None, *DIALECTS]))
def test_generated_scenes(folder, head, world, dialect):
    check(folder, f"{head}{world}\nWorldEnd\n", dialect)


@FAST
@given(st.text(max_size=200), st.sampled_from([None, *DIALECTS]))
def test_any_text(folder, text, dialect):
    check(folder, text, dialect)


@pytest.mark.slow
@MANY
@given(st.sampled_from(TEXTS), CHANGES)
def test_many_mutated_scenes(folder, tokens, changes):
    check(folder, mutated(tokens, changes))


@pytest.mark.slow
@MANY
@given(HEADS, WORLD, st.sampled_from([None, *DIALECTS]))
def test_many_generated_scenes(folder, head, world, dialect):
    check(folder, f"{head}{world}\nWorldEnd\n", dialect)


def test_what_is_not_changed_is_read(folder):
    """The cases start from files that are scenes."""
    for tokens in TEXTS[:-1]:
        (folder / "scene.pbrt").write_text("\n".join(tokens))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PbrtWarning)
            assert isinstance(read_pbrt(folder / "scene.pbrt"), Scene)
