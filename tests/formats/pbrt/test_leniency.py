"""What the pbrt reader takes as pbrt does, with a warning where the image may not be the one that was meant."""

import gzip
import warnings

import numpy as np
import pytest
import trimesh

from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.tokens import PbrtError
from dmis.samplers.pixel_filter import PixelFilter
from tests.formats.pbrt.test_read import TRIANGLE

HEADS = {
    "v2": 'SurfaceIntegrator "path"',
    "v3": 'Film "image" Integrator "path"',
    "v4": 'Film "rgb" Integrator "path" PixelFilter "box"',
}
AS_PBRT = ", as pbrt does: "


@pytest.fixture
def read(tmp_path):
    """Reads options and a world in a dialect; returns the scene and the texts of the warnings."""

    def read(dialect, options="", world="", add=TRIANGLE):
        path = tmp_path / "scene.pbrt"
        path.write_text(f"{HEADS[dialect]} {options}\nWorldBegin {world} {add}")
        if dialect != "v4":
            path.write_text(path.read_text() + "WorldEnd")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            scene = read_pbrt(path, dialect=dialect)
        return scene, [str(w.message).replace(f"{path}: ", "") for w in caught if "words of the file" not in str(w)]

    return read


BIASED = "rendered as path, because pbrt's own image is biased: integrator "


@pytest.mark.parametrize(
    "dialect, line, expected, warned",
    [
        ("v2", "", ("path", 6), ""),
        ("v2", 'SurfaceIntegrator "path" "integer maxdepth" 0', ("path", 1), ""),
        ("v2", 'SurfaceIntegrator "directlighting" "integer maxdepth" 3', ("direct", 3), ""),
        ("v2", 'SurfaceIntegrator "directlighting" "integer maxdepth" 0', ("direct", 1), ""),  # the first is shaded
        ("v2", 'SurfaceIntegrator "whitted" "integer maxdepth" 3', ("direct", 3), ""),
        ("v2", 'SurfaceIntegrator "photonmap"', ("path", 6), f'{BIASED}"photonmap" (line 1)'),
        ("v2", 'Renderer "metropolis" "integer maxdepth" 4 SurfaceIntegrator "directlighting"', ("path", 4), ""),
        ("v3", 'Integrator "path" "integer maxdepth" 1', ("path", 1), ""),
        ("v3", 'Integrator "directlighting" "integer maxdepth" 7', ("direct", 7), ""),
        ("v3", 'Integrator "bdpt" "integer maxdepth" 7', ("path", 7), ""),
        ("v3", 'Integrator "sppm" "integer maxdepth" 9', ("path", 9), f'{BIASED}"sppm" (line 1)'),
        ("v4", 'Integrator "mlt" "integer maxdepth" 20', ("path", 20), ""),
        ("v4", 'Integrator "simplepath"', ("path", 5), ""),
    ],
)
def test_integrators(read, dialect, line, expected, warned):
    """maxdepth m of v3 and v4 is the number of surfaces that scatter light; of v2's path it is one less."""
    scene, texts = read(dialect, line)
    assert (scene.suggested.integrator, scene.suggested.max_depth) == expected
    assert texts == [warned] * bool(warned)


@pytest.mark.parametrize("dialect, kind", [("v2", "direct"), ("v3", "path"), ("v4", "path")])
def test_default_integrators(tmp_path, dialect, kind):
    """Those of files that name none."""
    (tmp_path / "a.pbrt").write_text(f"WorldBegin {TRIANGLE}" + ("" if dialect == "v4" else "WorldEnd"))
    suggested = read_pbrt(tmp_path / "a.pbrt", dialect=dialect).suggested
    assert (suggested.integrator, suggested.max_depth) == (kind, 5)


UNAPPLIED = "not applied, so that the image differs by it from pbrt's: "


@pytest.mark.parametrize(
    "dialect, line, what",
    [
        ("v3", 'Film "image" "float scale" 2', "'scale' of Film"),
        ("v4", 'Film "rgb" "float iso" 200', "'iso' of Film"),
        ("v4", 'Camera "perspective" "float shutterclose" .5', "'shutterclose' of Camera"),
        ("v4", 'Integrator "path" "bool regularize" true', "'regularize' of Integrator"),
        ("v3", 'Film "image" "float scale" 1', None),
        ("v4", 'Integrator "path" "bool regularize" false', None),
    ],
)
def test_parameters_that_are_not_applied(read, dialect, line, what):
    _, texts = read(dialect, line)
    assert texts == ([] if what is None else [f"{UNAPPLIED}{what} (line 1)"])


def test_mitchell_becomes_a_gaussian_of_its_variance(read):
    scene, texts = read("v2", 'PixelFilter "mitchell"')
    assert texts == ['negative filter, a Gaussian of the same variance taken: "mitchell" (line 1)']
    assert scene.camera.filter == PixelFilter("gaussian", (2, 2), 1 / 3)
    x = np.linspace(-2, 2, 4001)
    a = np.abs(x)
    near, far = 7 * a**3 - 12 * a**2 + 16 / 3, -7 / 3 * a**3 + 12 * a**2 - 20 * a + 32 / 3
    values = np.where(a < 1, near, far)  # of B = C = 1/3, times 6
    assert np.isclose(np.sqrt((values * x * x).sum() / values.sum()), 1 / 3, rtol=1e-3)


@pytest.mark.parametrize("dialect", ["v2", "v3"])
def test_last_of_two_equal_parameters_counts(read, dialect):
    scene, _ = read(dialect, 'Film "image" "integer xresolution" 7 "integer xresolution" 9 "integer yresolution" 3')
    assert scene.camera.resolution == (9, 3)


@pytest.mark.parametrize("dialect", ["v2", "v3"])
def test_what_is_not_defined(read, dialect):
    scene, texts = read(dialect, "", 'Material "mirror" NamedMaterial "a"')
    assert scene.parts[0].material.name == "mirror"
    assert texts == [f'material that is not defined, the Material line taken{AS_PBRT}"a" (line 2)']
    scene, texts = read(dialect, "", 'Material "matte" "texture Kd" "a" "texture sigma" "b"')
    assert scene.parts[0].material.lobes[0].reflectance == (0.5, 0.5, 0.5)
    begin = f"texture that is not defined, its parameter's default taken{AS_PBRT}"
    assert texts == [f"{begin}'a' for 'Kd' of Material (line 2), 'b' for 'sigma' of Material (line 2)"]


def test_what_counts_nothing(read):
    for empty in ('"point P" []', '"point P" [0 0 0]'):
        scene, texts = read("v2", "", f'Shape "trianglemesh" "integer indices" [] {empty}')
        assert len(scene.parts) == 1
        assert texts == [f"mesh without triangles, left out{AS_PBRT}Shape (line 2)"]
    # transforms count where they are used
    scene, texts = read("v3", "", "TransformBegin Scale 1 0 1 TransformEnd")
    assert scene.parts and not texts
    # commas between numbers
    scene, _ = read("v3", "", "Translate 1, 2, 3", add=TRIANGLE.replace("0 0 0  1", "0,0, 0 ,1"))
    assert scene.parts[0].mesh.vertices.tolist() == [[1, 2, 3], [2, 2, 3], [1, 3, 3]]


def test_packed_files(read, tmp_path, monkeypatch):
    ply = trimesh.exchange.ply.export_ply(trimesh.creation.box())
    (tmp_path / "box.ply.gz").write_bytes(gzip.compress(ply))
    line = b'Translate 0 0 5 Shape "plymesh" "string filename" "box.ply.gz"'
    (tmp_path / "more.pbrt.gz").write_bytes(gzip.compress(line))
    scene, texts = read("v4", "", 'Include "more.pbrt.gz"', add="")
    assert scene.parts[0].mesh.triangles == 12 and scene.parts[0].mesh.vertices[:, 2].max() == 5.5 and not texts
    (tmp_path / "box.ply.gz").write_bytes(gzip.compress(bytes(5_000_000)))
    with pytest.raises(PbrtError, match=r"must have at most 4,194,304 bytes when it is unpacked"):
        read("v4", "", 'Shape "plymesh" "string filename" "box.ply.gz"')
    for broken in (gzip.compress(ply)[:-20], b"nothing"):
        (tmp_path / "box.ply.gz").write_bytes(broken)
        with pytest.raises(PbrtError, match=r'token "string filename"'):
            read("v4", "", 'Shape "plymesh" "string filename" "box.ply.gz"')
