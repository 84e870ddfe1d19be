"""Refusals of the pbrt reader: one message lists all that a file has and dmis does not; limits of files."""

import os
from time import process_time

import numpy as np
import pytest

import dmis
from dmis.cli.commands import main
from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.tokens import PbrtError
from dmis.image import write_exr
from tests.formats.pbrt.test_read import TRIANGLE

FILE = f"""Integrator "lightpath"
Camera "realistic" "string lensfile" "a.dat"
WorldBegin
MakeNamedMaterial "fur" "string type" "hair"
Texture "noise" "spectrum" "fbm"
Wobble 3 [1 2] "float a" true
Material "diffuse" "texture reflectance" "noise"
{TRIANGLE}
NamedMaterial "fur"
Shape "curve" "point3 P" [0 0 0]
Shape "curve" "point3 P" [0 0 0]
Material "measured"
{TRIANGLE}{TRIANGLE}
"""


def refusal(tmp_path, text):
    (tmp_path / "a.pbrt").write_text(text)
    with pytest.raises(PbrtError) as caught:
        read_pbrt(tmp_path / "a.pbrt")
    return str(caught.value).replace(f"{tmp_path}/", "").splitlines()


def test_all_refusals_are_listed_once(tmp_path):
    *lines, summary = refusal(tmp_path, FILE)
    begins = [
        'a.pbrt:1: token "lightpath": the integrator must be',
        'a.pbrt:2: token "realistic": the camera must be',
        'a.pbrt:4: token "hair": a material must be',
        'a.pbrt:5: token "fbm": a texture must be',
        "a.pbrt:6: token Wobble: a directive must be one of",
        'a.pbrt:11: token "curve": a shape must be',
        'a.pbrt:13: token "measured": a material must be',
    ]
    assert [line[: len(begin)] for line, begin in zip(lines, begins, strict=True)] == begins
    assert [line.endswith("(and 1 more places)") for line in lines] == [False] * 5 + [True, False]
    assert summary == "8 places of 7 kinds must change before the file can be read"


def test_a_broken_line_ends_the_list(tmp_path):
    first, broken, summary = refusal(tmp_path, 'WorldBegin\nShape "curve"\nMaterial [1 2]\n' + FILE)
    assert first.startswith('a.pbrt:2: token "curve"') and broken.startswith("a.pbrt:3: token [1 2]: Material needs")
    assert summary.endswith("before the file can be read; reading stopped at the last one, so more may follow")
    *lines, _ = refusal(tmp_path, 'WorldBegin Material "interface" Material "" WorldEnd')
    assert len(lines) > 1 and all("only bounds a medium is not supported" in line for line in lines)
    # A file of hair is refused in seconds: each place is found in no time, and a thousand of them are enough
    curve = 'Shape "curve" "point3 P" [0 0 0 1 0 0 2 0 0 3 0 0]\n'
    begin = process_time()
    *_, line, summary = refusal(tmp_path, "WorldBegin\n" + 30_000 * curve)
    assert process_time() - begin < 5
    assert line.startswith('a.pbrt:2: token "curve": a shape must be') and line.endswith("(and 999 more places)")
    assert summary == "at least 1,000 places of 1 kinds must change before the file can be read"


# What a scene file must not do: reach outside of its folder, or ask for more than there is ----------------------------


@pytest.fixture
def folders(tmp_path):
    """A scene's folder, and beside it one that a scene must not reach, with a file of each kind."""
    import trimesh

    inside, beside = tmp_path / "scene", tmp_path / "beside"
    inside.mkdir(), beside.mkdir()
    for folder in (inside, beside):
        (folder / "a.pbrt").write_text("Translate 1 2 3\n")
        (folder / "a.spd").write_text("400 .5\n700 .5\n")
        write_exr(folder / "a.exr", {"RGB": np.ones((2, 2, 3), np.float32)})
        trimesh.creation.box().export(folder / "a.ply")
    return inside, beside


USES = {
    "include": 'Include "{}.pbrt"',
    "mesh": 'Shape "plymesh" "string filename" "{}.ply"',
    "texture": 'Texture "t" "color" "imagemap" "string filename" "{}.exr" Material "matte" "texture Kd" "t"',
    "sky": 'LightSource "infinite" "string mapname" "{}.exr"',
    "spectrum": 'Material "matte" "spectrum Kd" "{}.spd"',
}
WAYS = {"parent": "../beside/a", "absolute": "{beside}/a", "roundabout": "sub/../../beside/a"}
WAYS |= {"link": "link/a", "file": "to"}


def write(inside, line):
    path = inside / "scene.pbrt"
    path.write_text(f'SurfaceIntegrator "directlighting" WorldBegin\n{line}\n{TRIANGLE}WorldEnd\n')
    return path


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("way", WAYS)
def test_files_outside_are_refused_unless_allowed(folders, use, way):
    inside, beside = folders
    (inside / "sub").mkdir()
    (inside / "link").symlink_to(beside)
    for suffix in ("pbrt", "spd", "exr", "ply"):
        (inside / f"to.{suffix}").symlink_to(beside / f"a.{suffix}")
    path = write(inside, USES[use].format(WAYS[way].format(beside=beside)))
    with pytest.raises(PbrtError, match=r"scene\.pbrt:2: token .*is outside of the folder") as caught:
        dmis.load_scene(path)
    assert "--allow-outside" in str(caught.value)
    assert len(dmis.load_scene(path, outside=True).parts) >= 1


def test_included_files_have_no_more_rights(folders):
    inside, _ = folders
    (inside / "sub").mkdir()
    (inside / "sub/b.pbrt").write_text('Include "../a.pbrt"\n')
    path = write(inside, 'Include "sub/b.pbrt"')
    (inside.parent / "alias").symlink_to(inside)
    for way in (path, inside.parent / "alias/scene.pbrt"):
        read_pbrt(way)
    (inside / "sub/b.pbrt").write_text('Include "../../beside/a.pbrt"\n')
    with pytest.raises(PbrtError, match=r"b\.pbrt:1: token .* is outside of the folder"):
        read_pbrt(write(inside, 'Include "sub/b.pbrt"'))


@pytest.mark.filterwarnings("default")
def test_command_line(folders, capsys):
    inside, _ = folders
    path = write(inside, USES["mesh"].format("../beside/a"))
    assert main(["info", str(path)]) == 2
    assert "is outside of the folder" in capsys.readouterr().err
    assert main(["info", str(path), "--allow-outside"]) == 0
    assert "integrator: direct" in capsys.readouterr().out


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no endless file here")
def test_devices_are_no_files(folders):
    inside, _ = folders
    (inside / "zero.pbrt").symlink_to("/dev/zero")
    with pytest.raises(PbrtError, match="there is no file"):
        read_pbrt(write(inside, 'Include "zero.pbrt"'), outside=True)


PLY = "ply\nformat binary_little_endian 1.0\nelement vertex {0}\nproperty float x\nproperty float y\nproperty float z\n"
PLY += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
HUGE = {
    "levels": 'Shape "loopsubdiv" "integer nlevels" 1000000000 "integer indices" [0 1 2] "point P" [0 0 0 1 0 0 0 1 0]',
    "mesh": 'Shape "plymesh" "string filename" "huge.ply"',
    "includes": 'Include "many.pbrt"',
}


@pytest.mark.parametrize("name", HUGE)
def test_too_much_is_refused(folders, name):
    inside, _ = folders
    (inside / "huge.ply").write_bytes(PLY.format(10**12).encode() + b"\0" * 99)
    (inside / "many.pbrt").write_text('Include "many1.pbrt"\n' * 99)
    for k in range(1, 9):
        (inside / f"many{k}.pbrt").write_text(f'Include "many{k + 1}.pbrt"\n' * 99)
    (inside / "many9.pbrt").write_text("")
    with pytest.raises(PbrtError, match=r"\.pbrt:\d+: token"):
        read_pbrt(write(inside, HUGE[name]))


@pytest.mark.parametrize("kind", ["sphere", "disk", "cylinder"])
def test_many_quadrics_are_refused_before_they_are_made(folders, monkeypatch, kind):
    """At the first one too many, with one message; a grid of lines for each of 30,000 took 15 s."""
    inside, _ = folders
    monkeypatch.setattr("dmis.formats.pbrt.reader.MAX_QUADRICS", 20)
    line = f'ObjectBegin "a" Shape "{kind}" {TRIANGLE}ObjectEnd\n'
    dmis.load_scene(write(inside, line + 'ObjectInstance "a"\n' * 19))
    monkeypatch.setattr("dmis.formats.pbrt.reader.tessellate_quadrics", None)
    what = "a scene must have at most 20 spheres, cylinders and disks, because .* make meshes of them .plymesh."
    with pytest.raises(PbrtError, match=rf"^.*scene\.pbrt:23: token ObjectInstance: {what}$"):
        dmis.load_scene(write(inside, line + 'ObjectInstance "a"\n' * 99))
