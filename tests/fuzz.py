"""Bad input by the thousand: ``python tests/fuzz.py parser 200000``.

Each kind of case is a function of a source of random numbers and a folder with good files, which damages one of them,
hands it to the library, and lets through what is allowed: a result, or the library's own error. Everything else is
raised. `tests/test_fuzz.py` runs a sample of them; run by itself this file runs many, with limits: a case of more than
`SECONDS` of computing, or whose process holds more than `MEMORY`, the interpreter included, fails too. The last case
that is named is that at which the interpreter crashed.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import copy
import gzip
import io
import json
import random
import re
import resource
import runpy
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import trimesh
from fuzz_commands import arguments, rule_text
from fuzz_scenes import MADE, NUMBERS, PARAMETERS, SCENES, SMALL, TEXTS, TRIANGLE, mutated, token
from PIL import Image as PIL

import dmis
from dmis import intersect
from dmis.cli.commands import main
from dmis.experiment.reference import load_reference
from dmis.fit.registry import make_rule
from dmis.formats import mesh_files
from dmis.formats.pbrt import reader
from dmis.formats.pbrt.dialect import DIALECTS
from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.tokens import PbrtError
from dmis.geometry import shapes, subdivision
from dmis.image import read_exr, write_exr
from dmis.image_reader import IMAGE_SUFFIXES, load_image
from dmis.scene.scene import Scene, SceneWarning

SECONDS = 5.0
"""Most that a case may take of its process's time: the machine may be busy."""
MEMORY = 2**30
"""Most memory that the process of a case may hold, and a quarter of the addresses that it may ask for."""

intersect.CHECK_RAYS = True


def prepare(folder: Path) -> None:
    """Good files, for scenes to name and for cases to damage."""
    rng = np.random.default_rng(1)
    sources = [path.read_text() for path in SCENES.rglob("*.pbrt")]
    textures, meshes = (
        {name for text in sources for name in re.findall(rf"[\w/-]+\.{suffix}", text)} for suffix in ("exr", "ply")
    )
    for name in ("a.exr", *sorted(textures)):
        (folder / name).parent.mkdir(exist_ok=True)
        write_exr(folder / name, {"RGB": np.full((2, 4, 3), 0.5, np.float32)})
    (folder / "geometry").mkdir()
    box = trimesh.creation.box()
    for name in ("a.ply", *sorted(meshes)):
        box.export(folder / name)
    tetrahedron = '"integer indices" [0 2 1 0 1 3 0 3 2 1 2 3] "point P" [0 0 0 1 0 0 0 1 0 0 0 1]'
    shutil.copy(SCENES / "geometry/tt-world.pbrt", folder / "geometry")
    (folder / "geometry/creature.pbrt").write_text(f'Shape "loopsubdiv" "integer nlevels" 1 {tetrahedron}')
    (folder / "a.spd").write_text("400 1\n700 .5\n")
    (folder / "empty.pbrt").write_text("")
    (folder / "scene.pbrt").write_text(f"{SMALL} Shape {TRIANGLE} WorldEnd")
    good = folder / "good"
    good.mkdir()
    (good / "a.ply").write_bytes(trimesh.exchange.ply.export_ply(box, encoding="ascii"))
    smooth = trimesh.creation.icosphere(1)
    _ = smooth.vertex_normals
    smooth.export(good / "b.ply", vertex_normal=True)
    smooth.export(good / "c.stl")
    quad_and_triangle = struct.pack("<B4IB3I", 4, 0, 1, 2, 3, 3, 0, 1, 4)
    head, body = smooth.export(file_type="ply").split(b"end_header\n", 1)
    head = re.sub(rb"element face \d+", b"element face 2", head)
    (good / "r.ply").write_bytes(head + b"end_header\n" + body[: 24 * len(smooth.vertices)] + quad_and_triangle)
    (good / "d.stl").write_text(trimesh.exchange.stl.export_stl_ascii(box))
    (good / "e.obj").write_text(OBJ)
    (good / "material.mtl").write_text(MTL)
    moved = trimesh.transformations.translation_matrix((1, 2, 3))
    trimesh.Scene({"box": box, "ball": smooth.copy().apply_transform(moved)}).export(good / "f.glb")
    layers = {"RGB": rng.random((4, 6, 3)).astype(np.float32), "weight": np.ones((4, 6), np.float32)}
    write_exr(good / "g.exr", layers, {"dmis.provenance": "{}"})
    write_exr(good / "h.exr", {"RGB": rng.random((3, 5, 3)).astype(np.float16)})
    room = SimpleNamespace(**runpy.run_path(str(SCENES / "make_room.py")))
    few = [thing for thing in room.things(metals=True) if thing.name in ("earth", "lamp", "leaf 20")]
    room.write_glb(good / "j.glb", few)
    data = (good / "j.glb").read_bytes()
    end = 20 + int.from_bytes(data[12:16], "little")
    uri = "data:;base64," + base64.b64encode(data[end + 8 :]).decode()
    (good / "k.gltf").write_text(
        json.dumps({**json.loads(data[20:end]), "buffers": [{"byteLength": len(data), "uri": uri}]})
    )
    (folder / "good.bin").write_bytes(data[end + 8 :])
    pixels = rng.integers(0, 256, (4, 6, 4)).astype(np.uint8)
    for name, picture in (("l.png", pixels), ("m.jpg", pixels[..., :3]), ("n.tga", pixels), ("o.png", pixels[..., 0])):
        PIL.fromarray(np.ascontiguousarray(picture)).save(good / name)
    (good / "p.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 6\n" + pixels.tobytes())
    (good / "q.pfm").write_bytes(b"PF\n6 4\n-1.0\n" + rng.random(72).astype("<f4").tobytes())


OBJ = """mtllib material.mtl
o one
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 .5
vt 0 0
vt 1 1
vn 0 0 1
usemtl red
f 1/1/1 2/2/1 3/1/1 4/2/1
f 1//1 2//1 4//1
usemtl lamp
f -1 -2 -3
USEMTL glass # of water
f\t1 2 \\
  3 4
"""


MTL = """newmtl red
Kd 1 0.5 0
Ks .5 .5 .5
Ns 20
map_Kd -s 2 2 -o .5 .5 image.png
newmtl lamp
Kd 0
Ke 2 2 1
map_Ke IMAGE.png
Pr .3 # PBR
d .5
map_d image.png
newmtl glass
ILLUM 7
Ni 1.3
"""


# Scene files


def parser(rng: random.Random, folder: Path) -> None:
    """A scene file: a scene, or an error that names file, line and token."""
    text = mutated(rng, rng.choice(TEXTS))
    if rng.random() < 0.1:
        text = "".join(token(rng) + " " for _ in range(rng.randint(0, 12)))
    dialect = rng.choice([None, None, *DIALECTS])
    if rng.random() < 0.05:
        packed = gzip.compress(text.encode("utf-8", "surrogatepass"), 1)
        (folder / "packed.pbrt.gz").write_bytes(damaged(rng, packed) if rng.random() < 0.5 else packed)
        text = 'Include "packed.pbrt.gz"'
    read(folder, text, dialect)


def read(folder: Path, text: str, dialect: str | None = None) -> Scene | None:
    """The scene of a text, None where it is refused as it should be."""
    path = folder / "case.pbrt"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", SceneWarning)
            return read_pbrt(path, dialect=dialect)
    except PbrtError as error:
        message = str(error)
        assert re.match(r".*\.pbrt(\.gz)?:\d+: token .+: .", message, re.DOTALL), message
        assert max(map(len, message.split("\n"))) < 3000
        return None


def rendering(rng: random.Random, folder: Path) -> None:
    """A scene file of lines that mostly belong there: what is read is rendered, and its image is finite."""
    lines = [
        " ".join([rng.choice(MADE), *(rng.choice(PARAMETERS) for _ in range(rng.randint(0, 2)))])
        for _ in range(rng.randint(1, 2))
    ]
    scene = read(folder, f"{SMALL}\n" + "\n".join([*lines, f"Shape {TRIANGLE} WorldEnd"]))
    if scene is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # such as of a camera on the triangle
            image = dmis.render(scene, rng.choice(["balance", "pbrt", "one-sample"]), 2, parallel=1).image
        assert np.isfinite(image).all() and (image >= 0).all()


# Files of numbers


def damaged(rng: random.Random, data: bytes) -> bytes:
    """Bytes changed, cut, doubled; numbers made extreme."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        near = len(out) if rng.random() < 0.4 else min(len(out), 400)
        k = rng.randrange(max(near, 1))
        what = rng.randrange(7)
        if what == 0:
            out[k : k + 1] = bytes([rng.randrange(256)])
        elif what == 1:
            whole = rng.choice([0, 1, -1, 2**31 - 1, 2**30, 65536, 10**6, 255])
            out[k : k + 4] = struct.pack(rng.choice("<>") + "i", whole)
        elif what == 2:
            real = rng.choice([float("nan"), float("inf"), 1e38, -1e38, 1e-45, 0.0])
            out[k : k + 4] = struct.pack(rng.choice("<>") + "f", real)
        elif what == 3:
            del out[k : k + rng.choice([1, 4, 40])]
        elif what == 4:
            out[k:k] = out[k : k + rng.choice([1, 4, 40])]
        elif what == 5 and rng.random() < 0.4:
            del out[k:]
        elif found := [match.span() for match in re.finditer(rb"\d+", bytes(out[:near]))]:
            begin, end = rng.choice(found)
            out[begin:end] = rng.choice(NUMBERS + ["2", "3", "4", "99"]).encode()
    return bytes(out)


def mesh(rng: random.Random, folder: Path) -> None:
    """A mesh file: a mesh that renders, or an error that names the file."""
    source = rng.choice([p for p in sorted((folder / "good").iterdir()) if p.suffix in mesh_files.MESH_SUFFIXES])
    path, data = folder / f"case{source.suffix}", source.read_bytes()
    path.write_bytes(damaged(rng, data))
    if source.suffix == ".ply" and rng.random() < 0.2:
        packed = rng.choice([gzip.compress(damaged(rng, data), 1), damaged(rng, gzip.compress(data, 1))])
        (folder / "case.ply.gz").write_bytes(packed)
        read(folder, 'WorldBegin Shape "plymesh" "string filename" "case.ply.gz" WorldEnd', rng.choice([*DIALECTS]))
        return
    if source.suffix in (".gltf", ".glb") and rng.random() < 0.5:
        document = json.loads((folder / "good/k.gltf").read_text())
        if beside := rng.random() < 0.5:
            document["buffers"][0]["uri"] = "case.bin"
            document["images"] = [{"uri": "image.png"} for _ in document["images"]]
        path = folder / "case.gltf"
        path.write_text(json.dumps(document if beside else damaged_json(rng, document)))
    for name, whole in (
        ("material.mtl", MTL.encode()),
        ("image.png", (folder / "good/l.png").read_bytes()),
        ("case.bin", (folder / "good.bin").read_bytes()),
    ):
        (folder / name).write_bytes(damaged(rng, whole) if rng.random() < 0.5 else whole)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # about its materials
            scene = dmis.load_scene(path, (4, 4))
    except ValueError as error:
        assert str(path) in str(error) or len(str(error)) < 300, error
        return
    with contextlib.suppress(ValueError), warnings.catch_warnings():  # of what is too far away, or too bright
        warnings.simplefilter("ignore", SceneWarning)  # lights that are near to surfaces
        image = dmis.render(scene, "balance", 1, parallel=1).image
        assert np.isfinite(image).all()


def damaged_json(rng: random.Random, document: Any) -> Any:
    """A description with some of its values replaced, left out or repeated."""
    for _ in range(rng.randint(1, 3)):
        node, place = document, None
        while isinstance(node, dict | list) and node and (place is None or rng.random() < 0.85):
            holder, place = node, rng.choice(list(node) if isinstance(node, dict) else range(len(node)))
            node = holder[place]
        what = rng.randrange(5)
        if what == 0:
            del holder[place]
        elif what == 1 and isinstance(holder, list):
            holder.append(node)
        else:
            holder[place] = copy.deepcopy(rng.choice(VALUES))
    return document


VALUES = [0, 1, 2, 5, -1, 10**9, 2**40, 0.5, 1e30, -1e300, float("inf"), float("nan"), None, True, 5121, 5123, 5126]
VALUES += [[], {}, [0], [1, 2, 3], [0, 0, 0, 0], {"index": 0}, {"mesh": 0, "children": [0, 1]}]
VALUES += ["", "a", "MASK", "BLEND", "VEC2", "SCALAR", "image.png", "../a.exr", "data:,", "file:///etc/passwd", "/"]


def picture(rng: random.Random, folder: Path) -> None:
    """An image file of any format: an image, or an error that names the file."""
    source = rng.choice([p for p in sorted((folder / "good").iterdir()) if p.suffix in IMAGE_SUFFIXES])
    path, data = folder / f"picture{source.suffix}", damaged(rng, source.read_bytes())
    path.write_bytes(with_checksums(data) if rng.random() < 0.7 else data)
    use = rng.choice([*IMAGE_USES, ""])
    if use:
        read(
            folder,
            f'WorldBegin {use.replace("{}", path.name)} Shape {TRIANGLE} "texture alpha" "t"',
            rng.choice([*DIALECTS]),
        )
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


def with_checksums(data: bytes) -> bytes:
    """The bytes of a PNG file with right checksums, so that what is damaged is read; other bytes as they are."""
    out, k = bytearray(data), 8
    while data.startswith(b"\x89PNG") and k + 12 <= len(data):
        end = k + 8 + int.from_bytes(data[k : k + 4], "big")
        out[end : end + 4] = zlib.crc32(data[k + 4 : end]).to_bytes(4, "big")
        k = end + 4
    return bytes(out)


IMAGE_USES = [
    'Texture "t" "color" "imagemap" "string filename" "{}" Material "matte" "texture Kd" "t"',
    'Texture "t" "spectrum" "imagemap" "string filename" "{}" Material "diffuse" "texture reflectance" "t"',
    'Texture "t" "float" "imagemap" "string filename" "{}" Material "diffuse" "string normalmap" "{}"',
    'LightSource "infinite" "string mapname" "{}"',
    'LightSource "infinite" "string filename" "{}"',
]


# The command line


def rule(rng: random.Random, folder: Path) -> None:
    """A rule: one that renders, or an error."""
    text = rule_text(rng)
    try:
        made = make_rule(text)
    except ValueError as error:
        assert len(str(error)) < 9000
        return
    assert sum(made.pilot.values()) >= 0
    scene = dmis.load_scene(folder / "scene.pbrt")
    with contextlib.suppress(ValueError):
        result = dmis.render(scene, text, rng.choice([1, 8, 20]), parallel=1)
        assert np.isfinite(result.image).all()


def command(rng: random.Random, folder: Path) -> None:
    """The command line in this process: 0, or 2 and a message."""
    words = arguments(rng)
    out, err = io.StringIO(), io.StringIO()
    quiet = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with contextlib.chdir(folder), quiet[0], quiet[1], warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # about a dialect that was asked for
        before = (folder / "scene.pbrt").read_bytes()
        try:
            code = main(words)
        except SystemExit as stop:
            code = stop.code
        if not (folder / "scene.pbrt").read_bytes() == before:
            (folder / "scene.pbrt").write_bytes(before)
    said = err.getvalue()
    assert code in (0, 2), (words, code, said)
    assert "Traceback" not in said, (words, said)
    if code == 2:
        assert re.search(r"dmis.*: error: .", said), (words, said)
        assert max(map(len, said.split("\n"))) < 9000, (words, len(said))


KINDS = {one.__name__: one for one in (parser, rendering, mesh, picture, rule, command)}


@contextlib.contextmanager
def small():
    """Limits that are reached in time; no plots."""
    mesh = shapes.Quadric.mesh
    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(subdivision, "MAX_SUBDIVIDED", 2**10))
        stack.enter_context(mock.patch.object(reader, "MAX_SCENE_TRIANGLES", 2**14))
        for plot in ("report.page.write_report", "report.plots.convergence"):
            stack.enter_context(mock.patch(f"dmis.{plot}"))
        stack.enter_context(mock.patch.object(shapes.Quadric, "mesh", lambda quadric, segments=8: mesh(quadric, 8)))
        yield


class Hang(BaseException):
    """A case that takes too long."""


def run(kind: str, seed: int, k: int, folder: Path) -> None:
    """Case number `k`."""
    KINDS[kind](random.Random(f"{kind} {seed} {k}"), folder)


def bulk(kind: str, count: int, seed: int, first: int = 0) -> int:
    """Run many cases with limits, print failures, and return their number."""

    def late(*_: object) -> None:
        raise Hang(f"more than {SECONDS} s of computing")

    begin, failures, slowest, most = time.time(), 0, 0.0, 0.0
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    signal.signal(signal.SIGPROF, late)
    with tempfile.TemporaryDirectory() as name, small(), warnings.catch_warnings(action="error"):
        prepare(Path(name))
        resource.setrlimit(resource.RLIMIT_AS, (4 * MEMORY, hard))
        for k in range(first, first + count):
            print(f"\r{kind} {seed} {k}", end="", file=sys.stderr)
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
            start = time.process_time()
            try:
                run(kind, seed, k, Path(name))
                peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 2**10
                most = max(most, peak)
                assert peak <= MEMORY, f"{peak / 2**20:.0f} MB of memory"
            except (Exception, Hang, SystemExit) as error:
                where = "".join(traceback.format_tb(error.__traceback__)[-3:])
                print(f": {type(error).__name__}: {str(error)[:1500]}\n{where}", file=sys.stderr)
                failures += 1
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
            slowest = max(slowest, time.process_time() - start)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    numbers = f"{time.time() - begin:.0f} s, slowest {slowest:.2f} s, at most {most / 2**20:.0f} MB"
    print(f"\n{count} cases of {kind}, seed {seed}: {failures} failures, {numbers}")
    return failures


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("kind", choices=KINDS)
    options.add_argument("count", type=int)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--first", type=int, default=0, help="number of the first case")
    given = options.parse_args()
    sys.exit(bulk(given.kind, given.count, given.seed, given.first) > 0)
