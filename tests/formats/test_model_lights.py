"""Models that emit: whether their emission takes the place of the default sky and lamp, and lamps that overlap."""

import numpy as np
import pytest
from gltf_file import CORNERS, FACES, File

import dmis
from dmis.cli.commands import main
from dmis.formats.model_lights import LIT, lit_share
from dmis.geometry.shapes import quad
from dmis.light.environment import EnvironmentLight
from dmis.light.mesh_light import MeshLight
from dmis.scene.scene import SceneWarning

GREY = {"pbrMetallicRoughness": {"metallicFactor": 0}}
FLOOR = np.float32([[-4, -1, 4], [4, -1, 4], [4, -1, -4], [-4, -1, -4]])
SMALL = np.float32([0.02, 0.02, 1]) * CORNERS
DOWN = np.float32([[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]])


def glowing(*colour):
    return {"emissiveFactor": colour}


def test_emission_that_lights_nothing(tmp_path, capsys):
    """Sky and lamp stay, whatever the brightness, and why is said; the surface emits beside them."""
    wall = File().mesh(glowing(1, 1, 1), SMALL, uv=None).mesh(GREY, FLOOR, uv=None)
    for file, colour in ((File().mesh(glowing(0.002, 0, 0), uv=None), (0.002, 0, 0)), (wall, (1, 1, 1))):
        scene = file.load(tmp_path, resolution=(12, 8))
        sky, _, light = scene.lights
        assert isinstance(sky, EnvironmentLight) and scene.parts[0].light is light and light.radiance == colour
        assert scene.suggested.integrator is None and "lit" not in scene.source
        assert np.median(dmis.render(scene, "balance", 4, parallel=1).image) > 0.05
        assert main(["info", str(tmp_path / "a.glb")]) == 0
        assert "a sky and a lamp, because its emission reaches only 0.0% of the image" in capsys.readouterr().out


def test_a_lamp_above_a_floor_lights_it(tmp_path, capsys):
    """Nothing is added, and what lights it is said; lights that are given replace nothing of it."""
    file = File().mesh(GREY, FLOOR, uv=None).mesh(glowing(1e-4, 1e-4, 1e-4), DOWN, uv=None)
    scene = file.load(tmp_path)
    assert len(scene.lights) == 1 and scene.suggested.integrator == "path"
    assert scene.source["lit"].startswith("its emission, which reaches ")
    assert main(["info", str(tmp_path / "a.glb")]) == 0
    assert "  lit by its emission, which reaches " in capsys.readouterr().out
    sun = dmis.DistantLight((0, 1, 0), (1, 1, 1))
    assert file.load(tmp_path, lights=[sun]).lights[0] is sun and len(file.load(tmp_path, lights=[sun]).lights) == 2


def test_lights_of_the_file_light_it(tmp_path):
    file = File().mesh(glowing(0.002, 0, 0), uv=None)
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    file.json["nodes"].append({"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 0, 3]})
    scene = file.load(tmp_path)
    assert len(scene.lights) == 2 and scene.source["lit"] == "its lights"
    assert scene.source["added"] == ["a camera that sees all of it, because it has none"]


def test_lit_share_of_a_small_lamp():
    """The radiance rho / pi L A h^2 / (h^2 + r^2)^2 of a floor is above 1/1000 L within a circle."""
    albedo, side, height = 0.8, 0.2, 1.0
    half = np.sqrt(np.sqrt(albedo * side**2 * height**2 / (np.pi * LIT)) - height**2)
    corners = [(x * side / 2, y * side / 2, height) for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    lamp = MeshLight(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), (7, 7, 7))
    floor = dmis.Part(quad((-9, -9, 0), (18, 0, 0), (0, 18, 0)), dmis.matte(albedo))
    camera = dmis.Camera.look_at((0, 0, 50), (0, 0, 0), (0, 1, 0), fov=2 * np.degrees(np.arctan(3 / 50)))
    scene = dmis.Scene(camera, (floor, dmis.light_part(lamp)), (lamp,))
    assert lit_share(scene) == pytest.approx(np.pi * half**2 / 48, abs=0.012)


def test_lamps_that_overlap_across_meshes(tmp_path):
    """The second one, in part in the place of the first, loses its emission with a warning, and renders."""
    file = File()
    for x, z, colour in ((0, 0, (1, 0, 0)), (0.5, 3e-6, (0, 1, 0)), (2.6, 0, (0, 0, 1))):  # rays tell 1e-5 apart
        file.mesh(glowing(*colour), uv=None, node={"translation": [x, 0, z]})
    with pytest.warns(SceneWarning, match="left out: emission of a surface that overlaps another lamp$"):
        scene = file.load(tmp_path, lights=[])
    assert [light.radiance for light in scene.lights] == [(1, 0, 0), (0, 0, 1)]
    assert scene.parts[1].light is None and scene.parts[1].material.lobes
    with pytest.warns(SceneWarning, match="is nearer to"):  # and not an error
        scene.in_float32[0].prepare()
    back_to_back = File().mesh(glowing(1, 1, 1)).mesh(glowing(1, 1, 1), faces=FACES[::-1])
    assert len(back_to_back.load(tmp_path, lights=[]).lights) == 2
