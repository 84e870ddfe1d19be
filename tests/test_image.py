"""EXR files keep layers and provenance; mistakes are told before anything is written."""

import io
import json
import struct
import zlib

import numpy as np
import pytest
from helpers import fresh_python

import dmis
from dmis.image import encode_png, read_exr, tonemap, write_exr, write_png


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


GREY = np.ones((4, 6), np.float32)
HALF = np.full((4, 6), 0.5, np.float16)
ACES_CG = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
DEEP = np.array([[np.arange(3, dtype=np.float32)] * 2, [GREY[0]] * 2], object)


def write_foreign(path, channels, kind="scanlineimage", **header):
    """Write an EXR file of parts of these channels."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": getattr(OpenEXR, kind)} | header
    parts = [OpenEXR.Part(dict(header), dict(part), name=f"part {k}") for k, part in enumerate(channels)]
    with OpenEXR.File(parts) as file:
        file.write(str(path))


def test_exr_channels_of_two_types(tmp_path):
    """Those of a layer may be half and float; chromaticities of Rec. 709 change nothing."""
    for channels in ({"R": HALF, "G": GREY, "B": HALF}, {"RGB": np.stack([HALF] * 3, axis=2), "A": GREY}):
        write_foreign(tmp_path / "a.exr", [channels], chromaticities=(0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329))
        expected = np.stack([HALF, channels.get("G", HALF), HALF], axis=2)
        np.testing.assert_array_equal(dmis.load_image(tmp_path / "a.exr"), expected)


RGB = np.ones((4, 6, 3), np.float32)


@pytest.mark.parametrize(
    "channels, header, message",
    [
        ([{"Y": GREY, "RY": GREY, "BY": GREY}], {}, "Y alone, without RY, BY or X, Z; it has .*; convert it to RGB"),
        ([{"X": GREY, "Y": GREY, "Z": GREY}], {}, "Y alone, without RY, BY or X, Z; it has X, Y, Z"),
        ([{"RGB": RGB}], {"chromaticities": ACES_CG}, r"must be those of Rec\. 709 \(sRGB\); convert it; got \(0.71"),
        ([{"RGB": RGB}], {"chromaticities": (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)}, "must be those of Rec"),
        ([{"Z": DEEP}], {"kind": "deepscanline"}, "must have one part of flat pixels; it is deep"),
        ([{"Y": GREY}, {"Y": GREY}], {}, "must have one part of flat pixels; it has 2 parts"),
    ],
)
def test_exr_files_of_other_kinds_are_refused(tmp_path, channels, header, message):
    write_foreign(tmp_path / "a.exr", channels, **header)
    with pytest.raises(ValueError, match=rf"a\.exr.* {message}"):
        dmis.load_image(tmp_path / "a.exr")


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
    assert set(layers) == {"RGB", "weight", "variance", "samples", "light_samples", "brdf_samples"}
    np.testing.assert_array_equal(layers["RGB"], result.image)
    np.testing.assert_array_equal(layers["weight"], result.weight)
    provenance = json.loads(attributes["dmis.provenance"])
    expected = {"rule": "thesis:patch=4", "seed": 3, "spp": 8, "resolution": [32, 24]}
    assert provenance.items() >= expected.items() and provenance["settings"]["sampler"] == "sobol"


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


def test_tonemap_is_the_srgb_curve():
    """Known points of the sRGB curve; negative, large and NaN values are clipped."""
    values = np.array([0.0, 0.0031308, 0.214041, 1.0, 7.0, -1.0, np.nan])
    np.testing.assert_allclose(tonemap(values), [0, 0.04045, 0.5, 1, 1, 0, 0], atol=2e-5)


def chunks(data: bytes) -> dict[bytes, bytes]:
    """Chunks of a PNG file by name; their checksums must be right (ISO/IEC 15948, 5.3)."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    contents, place = {}, 8
    while place < len(data):
        (length,) = struct.unpack(">I", data[place : place + 4])
        name, body = data[place + 4 : place + 8], data[place + 8 : place + 8 + length]
        assert struct.unpack(">I", data[place + 8 + length : place + 12 + length]) == (zlib.crc32(name + body),)
        contents[name], place = body, place + 12 + length
    return contents


def test_png_values(tmp_path):
    """Linear 0.214041 is 0.5 in sRGB, so 127.5 of 255, rounded; below 0 and above 1 is clipped, NaN is black."""
    image = np.array([[[0.214041, 0, 1], [-1, 7, np.nan]]], np.float32)
    write_png(tmp_path / "a.png", image)
    contents = chunks((tmp_path / "a.png").read_bytes())
    assert list(contents) == [b"IHDR", b"sRGB", b"IDAT", b"IEND"] and contents[b"sRGB"] == b"\0"  # perceptual
    assert struct.unpack(">IIBBBBB", contents[b"IHDR"]) == (2, 1, 8, 2, 0, 0, 0)  # 8 bits, RGB, not interlaced
    (filter_, *values) = zlib.decompress(contents[b"IDAT"])
    if filter_ == 1:  # less the pixel to the left
        values[3:] = [(a + b) % 256 for a, b in zip(values[3:], values[:3])]
    assert filter_ in (0, 1) and values[0] in (127, 128) and values[1:] == [0, 255, 0, 255, 0]
    with pytest.raises(ValueError, match=r"must have shape \(H, W, 3\); got \(2, 2\)"):
        write_png(tmp_path / "b.png", np.zeros((2, 2)))


@pytest.mark.parametrize("shape", [(1, 1, 3), (7, 5, 3), (40, 31, 3), (40, 31)])
def test_any_reader_reads_a_png(shape):
    """Noise, gradients to the right and downwards, and all mixed, so that every filter is used; grey as well."""
    plt, pillow = pytest.importorskip("matplotlib.image"), pytest.importorskip("PIL.Image")
    rng = np.random.default_rng(2)
    y, x = np.indices(shape[:2]).reshape(2, *shape[:2], *(1,) * (len(shape) - 2))
    used = set()
    for pixels in (rng.integers(0, 256, shape), x * 5 + 0 * y, y * 6 + rng.integers(0, 256, shape[1:]), 200 - x * y):
        pixels = np.broadcast_to(pixels, shape).astype(np.uint8)
        data = encode_png(pixels)
        lines = np.frombuffer(zlib.decompress(chunks(data)[b"IDAT"]), np.uint8).reshape(shape[0], -1)
        used |= set(lines[:, 0].tolist())
        np.testing.assert_array_equal(np.asarray(pillow.open(io.BytesIO(data))), pixels)
        np.testing.assert_array_equal(np.rint(255 * plt.imread(io.BytesIO(data))), pixels)
    assert shape[0] < 40 or used == {0, 1, 2}


def test_png_needs_no_package(tmp_path, box):
    """Where neither matplotlib nor Pillow can be imported a preview is written all the same."""
    fresh_python(
        "import sys; sys.modules |= dict.fromkeys(['matplotlib', 'PIL'])\n"  # None: importing them is an error
        "import numpy as np, dmis.image\n"
        f"dmis.image.write_png({str(tmp_path / 'a.png')!r}, np.ones((3, 4, 3)))"
    )
    assert chunks((tmp_path / "a.png").read_bytes())[b"IHDR"][:8] == struct.pack(">II", 4, 3)
