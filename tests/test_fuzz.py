"""Bad input of every kind: a result or the library's own error, no hang, no flood; and what once was neither.

The cases are those of `fuzz`, a sample of them here; ``python tests/fuzz.py KIND COUNT`` runs as many as one likes.
"""

import struct
import subprocess
import sys

import fuzz
import numpy as np
import pytest
import trimesh

import dmis
from dmis.cli.commands import main
from dmis.experiment.reference import load_reference
from dmis.formats.mesh_files import placed_geometries
from dmis.image import read_exr, write_exr
from dmis.scene.scene import Scene

COUNTS = {"parser": 200, "rendering": 20, "mesh": 100, "picture": 120, "rule": 60, "command": 20}
"""Cases of each kind in this run."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files to damage."""
    path = tmp_path_factory.mktemp("fuzz")
    fuzz.prepare(path)
    return path


@pytest.fixture(autouse=True)
def _small():
    with fuzz.small():
        yield


@pytest.mark.parametrize("kind", COUNTS)
def test_bad_input(folder, kind):
    """A sample of each kind; case k again: ``python tests/fuzz.py KIND 1 --seed 0 --first k``."""
    for k in range(COUNTS[kind]):
        try:
            fuzz.run(kind, 0, k, folder)
        except BaseException as error:
            error.add_note(f"{kind}, seed 0, case {k}")
            raise


@pytest.mark.slow
@pytest.mark.parametrize("kind", COUNTS)
def test_much_bad_input(kind):
    """Other cases, with limits."""
    count = {"parser": 5000, "command": 100}.get(kind, 500)
    done = subprocess.run(
        [sys.executable, fuzz.__file__, kind, str(count), "--seed", "2"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-5000:]


def test_what_is_not_changed_is_read(folder):
    """The cases start from files that are good."""
    for tokens in fuzz.TEXTS[:-1]:
        assert isinstance(fuzz.read(folder, "\n".join(tokens)), Scene)
    for path in sorted((folder / "good").iterdir()):
        if path.suffix in dmis.formats.mesh_files.MESH_SUFFIXES:
            assert dmis.load_scene(path, material=dmis.matte()).parts[0].mesh.triangles
        elif path.suffix == ".exr":
            assert read_exr(path)[0]["RGB"].size
    assert load_reference(folder / "good/g.exr").first.shape == (4, 6, 3)
    assert main(["info", str(folder / "scene.pbrt")]) == 0


def test_failures_are_found(monkeypatch, capfd):
    """The driver sees an error that is not the library's, a hang, and too much memory."""

    def bad(rng, folder):
        number = numbers.pop(0)
        if number == 1:
            raise RuntimeError("deep inside")
        if number == 2:
            while True:
                pass
        if number == 3:
            np.zeros(2**33).sum()

    numbers = list(range(5))
    monkeypatch.setitem(fuzz.KINDS, "bad", bad)
    monkeypatch.setattr(fuzz, "SECONDS", 0.3)
    monkeypatch.setattr(fuzz, "MEMORY", 2**32)  # a process that has run many tests holds more than one of `bulk`
    assert fuzz.bulk("bad", 5, 1) == 3
    said = capfd.readouterr().err
    assert all(message in said for message in ("bad 1 1: RuntimeError: deep inside", "Hang", "Unable to allocate"))


# What once failed


def test_meshes_too_far_away(tmp_path):
    """Finite numbers that are not so in float32, or whose squares are not."""
    for x in (1e19, 1e300):
        mesh = trimesh.Trimesh([[0, 0, 0], [x, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
        (tmp_path / "a.obj").write_text(trimesh.exchange.obj.export_obj(mesh))
        with pytest.raises(ValueError, match=r"a\.obj cannot be read .* vertices must be finite, within 1e\+18 of 0"):
            dmis.load_scene(tmp_path / "a.obj")
        with pytest.raises(ValueError, match=r"position must be within 1e\+18"):
            dmis.PointLight((x, 0, 0), (1, 1, 1))
        with pytest.raises(ValueError, match=r"to_world must not have elements above 1e\+18"):
            dmis.Camera(np.diag([1, 1, x, 1]), 40, (4, 4))


def test_files_that_end_early(tmp_path, capfd):
    """Headers that ask for more than there is are refused with the number, and no package prints a traceback."""
    ply = trimesh.exchange.ply.export_ply(trimesh.creation.box(), encoding="ascii")
    chunk = struct.pack("<4sIIII", b"glTF", 2, 99, 2**32 - 1, 0x4E4F534A) + bytes(79)
    for name, data, message in (
        ("a.ply", ply.replace(b"face 12", b"face 1000000000000"), "it is cut off: it must have as many rows as"),
        ("a.glb", chunk, "it must have 4294967315 bytes; it has 99"),
        ("a.stl", bytes(80) + b"\xff" * 54, "damaged"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ValueError, match=message):
            dmis.load_scene(tmp_path / name)
    assert "Traceback" not in capfd.readouterr().err
    write_exr(tmp_path / "a.exr", {"RGB": np.zeros((9, 9, 3), np.float32)})
    (tmp_path / "a.exr").write_bytes((tmp_path / "a.exr").read_bytes()[:-9])
    with pytest.raises(ValueError, match=r"a\.exr as EXR: its pixels are damaged or cut off"):
        read_exr(tmp_path / "a.exr")


def test_instances_are_counted(monkeypatch):
    """A small file may ask for one mesh any number of times."""
    monkeypatch.setattr("dmis.formats.model.MAX_FACES", 20)
    scene = trimesh.Scene(trimesh.creation.box())
    name = next(iter(scene.geometry))
    assert [len(mesh.faces) for _, mesh in placed_geometries(scene)] == [12]
    scene.graph.update("again", geometry=name)
    with pytest.raises(ValueError, match="at most 20 triangles, because instances are copied"):
        placed_geometries(scene)


def test_references_must_be_numbers(tmp_path, monkeypatch):
    """Not a number, halves of other kinds."""
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
