"""Options that give a model a camera and a sky; exposure of its preview."""

import json
import re

import numpy as np
import pytest
import trimesh

import dmis
from dmis.cli.commands import main
from dmis.cli.shared import read_sky
from dmis.image import tonemap, write_exr

SMALL = ["--resolution", "12x8", "--spp", "4", "--rule", "balance", "--threads", "1"]


@pytest.fixture
def ball(tmp_path):
    trimesh.creation.icosphere(2).export(tmp_path / "ball.obj")
    return str(tmp_path / "ball.obj")


def image_of(tmp_path, *words):
    assert main(["render", *words, *SMALL, "-o", str(tmp_path / "a.exr")]) == 0
    layers, attributes = dmis.read_exr(tmp_path / "a.exr")
    return layers["RGB"], json.loads(attributes["dmis.provenance"])


def test_a_model_alone(tmp_path, ball, capsys):
    """A camera and lights are added, and that is said."""
    for view in ((), ("--look-at", *"090000"), ("--up", "z", "--look-at", *"009000")):  # also along the axis up
        image, _ = image_of(tmp_path, ball, *view)
        assert image[3:5, 5:7].min() > 0.1
    assert "added to the file: a camera that sees all of it, because it has none; a sky and" in capsys.readouterr().out
    assert main(["info", ball]) == 0
    about = capsys.readouterr().out
    assert "added to the file: a camera that sees all" in about
    assert "from (-1, -1, -1) to (1, 1, 1), y is up" in about
    # an even sky lights the ball; the camera sees what it looks at
    words, colour = ["--light", "0.2 0.4 0.8", "--look-at"], [0.2, 0.4, 0.8]
    image, _ = image_of(tmp_path, ball, *words, *"00", "-5", *"000", "--fov", "4")
    albedo = image.mean(axis=(0, 1)) / colour
    assert 0.3 < albedo[0] < 0.9
    np.testing.assert_allclose(albedo, np.broadcast_to(albedo[0], 3), rtol=1e-3)
    behind, _ = image_of(tmp_path, ball, *words, "0", "5", "0", "0", "9", "0.1")
    np.testing.assert_allclose(behind, np.broadcast_to(colour, image.shape), rtol=1e-5)


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1)])
def test_skies_are_upright_and_not_mirrored(tmp_path, up):
    """The first row is above; seen from inside, what is to the right in the image is to the right."""
    texels = np.zeros((4, 8, 3), np.float32)
    texels[0], texels[1:3, 2], texels[1:3, 3] = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    write_exr(tmp_path / "sky.exr", {"RGB": texels})
    sky = read_sky(str(tmp_path / "sky.exr"), up)
    up = np.array(up, float)
    assert np.argmax(sky.radiance(np.float32(up)[:, None])[:, 0]) == 0
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    level = np.roll(np.eye(3), 1, axis=0)[:2] if up[2] == 0 else np.eye(3)[:2]
    across = np.stack([np.outer(level[0], np.cos(turn)), np.outer(np.cross(up, level[0]), np.sin(turn))]).sum(axis=0)
    green, blue = (across[:, np.argmax(sky.radiance(across.astype(np.float32))[k])] for k in (1, 2))
    assert np.cross(green, up) @ blue > 0  # to the right of where one looks: green x up


@pytest.mark.parametrize(
    "words, message",
    [
        (["--light", "no.hdr"], "no such image: no.hdr; --light takes an image file or 'R G B'"),
        (["--light", "1 2"], "one number or three; got 2: '1 2'"),
        (["--light=-1 0 0"], "not negative"),
        (["--camera", "front"], "the name or number of one in .*: none; got 'front'"),
        (["--exposure", "0"], "must be a number from 1e-30"),
    ],
)
def test_bad_options(tmp_path, ball, refused, words, message):
    assert re.search(message, refused(["render", ball, *SMALL, "-o", str(tmp_path / "a.exr"), *words]))


def test_exposure(tmp_path, capsys):
    """A preview of a model with lights shows it, whatever their unit; --exposure settles it."""
    from PIL import Image

    text = "v -9 0 9\nv 9 0 9\nv 9 0 -9\nv -9 0 -9\nv -1 3 -1\nv 1 3 -1\nv 1 3 1\nv -1 3 1\n"
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{text}usemtl floor\nf 1 2 3 4\nusemtl lamp\nf 5 6 7 8\n")
    view = ["--look-at", "0", "2", "0", "0", "0", "0.1"]
    for strength in (1e-5, 1, 1e4):
        (tmp_path / "a.mtl").write_text(f"newmtl floor\nKd .5\nnewmtl lamp\nKe {strength}\n")
        word = [str(tmp_path / "a.obj"), *view, *SMALL, "--spp", "64", "-o"]
        assert main(["render", *word, str(tmp_path / "a.png")]) == 0
        assert "exposure of the preview" in capsys.readouterr().out
        assert main(["render", *word, str(tmp_path / "a.exr")]) == 0
        assert "of the preview" not in capsys.readouterr().out  # there is none
        pixels = np.asarray(Image.open(tmp_path / "a.png")) / 255
        assert np.quantile(pixels, 0.95) == pytest.approx(float(tonemap(np.array(0.6))), abs=0.02)
    assert main(["render", *word, str(tmp_path / "a.png"), "--exposure", "1"]) == 0
    assert np.asarray(Image.open(tmp_path / "a.png")).min() == 255
