"""EXR files keep layers and provenance; mistakes are told before anything is written."""

import json

import numpy as np
import pytest

import dmis
from dmis.image import read_exr, tonemap, write_exr, write_png


def test_round_trip_keeps_every_layer_and_attribute(tmp_path):
    """float32 layers come back bit for bit, float16 ones as rounded, strings as they are."""
    rng = np.random.default_rng(1)
    layers = {"RGB": rng.random((5, 7, 3), np.float32), "weight": rng.random((5, 7), np.float32)}
    layers["half"] = rng.random((5, 7, 3)).astype(np.float16)
    write_exr(tmp_path / "a.exr", layers, {"dmis.provenance": json.dumps({"spp": 4})})
    back, attributes = read_exr(tmp_path / "a.exr")
    assert set(back) == set(layers)
    for name, layer in layers.items():
        np.testing.assert_array_equal(back[name], layer)
    assert json.loads(attributes["dmis.provenance"]) == {"spp": 4}


@pytest.mark.parametrize("change", [np.flipud, np.fliplr, lambda a: a[::2], lambda a: np.asfortranarray(a)])
def test_strided_arrays_are_written_as_they_look(tmp_path, change):
    """The EXR library writes memory order without a word; the writer here must not."""
    image = change(np.arange(4 * 6 * 3, dtype=np.float32).reshape(4, 6, 3))
    write_exr(tmp_path / "a.exr", {"RGB": image})
    np.testing.assert_array_equal(read_exr(tmp_path / "a.exr")[0]["RGB"], image)


def test_result_is_written_with_its_provenance(tmp_path, box):
    """An EXR of a render has the four layers that other tools read, and says how it was made."""
    result = dmis.render(box, "thesis:patch=4", 8, seed=3)
    dmis.write_image(tmp_path / "a.exr", result)
    layers, attributes = read_exr(tmp_path / "a.exr")
    assert set(layers) == {"RGB", "weight", "variance", "samples"}
    np.testing.assert_array_equal(layers["RGB"], result.image)
    np.testing.assert_array_equal(layers["weight"], result.weight)
    provenance = json.loads(attributes["dmis.provenance"])
    assert provenance["rule"] == "thesis:patch=4" and provenance["seed"] == 3 and provenance["spp"] == 8


@pytest.mark.parametrize(
    ("name", "layers", "error", "message"),
    [
        ("a.jpg", {"RGB": np.zeros((2, 2, 3))}, ValueError, "must end in .exr"),
        ("a.exr", {"RGB": np.zeros((2, 2, 4))}, ValueError, r"\(2, 2, 4\)"),
        ("a.exr", {"x": np.zeros(3)}, ValueError, "layer x"),
        ("no/such/a.exr", {"RGB": np.zeros((2, 2, 3))}, FileNotFoundError, "directory does not exist"),
    ],
)
def test_bad_output(tmp_path, name, layers, error, message):
    """Each mistake has its own message."""
    with pytest.raises(error, match=message):
        write_exr(tmp_path / name, layers)
    assert not list(tmp_path.iterdir())


def test_bad_input(tmp_path):
    """A file that is missing and a file that is not EXR are told apart."""
    with pytest.raises(FileNotFoundError, match="no such image"):
        read_exr(tmp_path / "missing.exr")
    (tmp_path / "text.exr").write_text("not an image")
    with pytest.raises(ValueError, match="cannot read"):
        read_exr(tmp_path / "text.exr")


def test_tonemap_is_the_srgb_curve():
    """Known points of the sRGB curve; negative, large and NaN values are clipped."""
    values = np.array([0.0, 0.0031308, 0.214041, 1.0, 7.0, -1.0, np.nan])
    np.testing.assert_allclose(tonemap(values), [0, 0.04045, 0.5, 1, 1, 0, 0], atol=2e-5)


def test_png(tmp_path):
    """A preview is written where matplotlib is installed."""
    image = pytest.importorskip("matplotlib.image")
    write_png(tmp_path / "a.png", np.full((3, 4, 3), 0.214041, np.float32))
    np.testing.assert_allclose(image.imread(tmp_path / "a.png")[..., :3], 0.5, atol=1 / 255)
