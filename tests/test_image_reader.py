"""Image files of any format become the linear values that they mean; bad ones are refused."""

import io
import struct
import tracemalloc

import numpy as np
import pytest

import dmis
from dmis.base.window import MAX_PIXELS
from dmis.image import encode_png, tonemap, write_exr
from dmis.image_reader import load_image

pytest.importorskip("OpenImageIO")
PIXELS = np.random.default_rng(1).integers(0, 256, (5, 7, 4)).astype(np.uint8)


def pillow(format_, pixels=PIXELS, mode=None, **options):
    image = pytest.importorskip("PIL.Image").fromarray(pixels)
    file = io.BytesIO()
    (image.convert(mode) if mode else image).save(file, format_, **options)
    return file.getvalue()


def linear(pixels):
    """Linear values by the inverse of the display curve, found by a search: an independent way."""
    steps = np.linspace(0, 1, 2**18 + 1)
    return np.interp(pixels / 255, tonemap(steps), steps)


def load(tmp_path, name, data, **options):
    (tmp_path / name).write_bytes(data)
    return load_image(tmp_path / name, **options)


@pytest.mark.parametrize(
    "name, data, channels",
    [
        ("a.png", lambda: pillow("PNG"), 3),
        ("no_extension", lambda: pillow("PNG"), 3),
        ("grey.png", lambda: pillow("PNG", PIXELS[..., 0].copy()), 1),
        ("odd?name=1.png", lambda: encode_png(PIXELS[..., :3]), 3),
        ("a.tga", lambda: pillow("TGA"), 3),
        ("rle.tga", lambda: pillow("TGA", PIXELS[..., :3].copy(), compression="tga_rle"), 3),
    ],
)
def test_bytes_are_decoded_from_srgb(tmp_path, name, data, channels):
    image = load(tmp_path, name, data())
    assert image.dtype == np.float32 and image.flags.c_contiguous
    np.testing.assert_allclose(image, linear(PIXELS[..., :channels]), atol=2e-5)
    np.testing.assert_allclose(load_image(tmp_path / name, linear=True), PIXELS[..., :channels] / 255, atol=1e-7)


def test_palettes_and_jpg(tmp_path):
    image = load(tmp_path, "a.jpg", pillow("JPEG", np.full((8, 8, 3), (200, 100, 50), np.uint8), quality=95))
    np.testing.assert_allclose(image[4, 4], linear(np.array([200, 100, 50])), atol=0.02)
    palette = load(tmp_path, "p.png", pillow("PNG", PIXELS[..., 0].copy(), "P"))
    np.testing.assert_allclose(palette, linear(PIXELS[..., :1]).repeat(3, 2), atol=2e-5)
    # JPG files with many scans
    data = pillow("JPEG", PIXELS[..., :3].copy(), progressive=True)
    last = data[data.rindex(b"\xff\xda") : -2]
    with pytest.raises(ValueError, match=r"a\.jpg as JPG: it must have at most 100 scans; it has 1"):
        load(tmp_path, "a.jpg", data[:-2] + 100 * last + data[-2:])
    # JPG files that are cut off
    data = pillow("JPEG", PIXELS[..., :3].repeat(9, 0).repeat(9, 1))
    with pytest.raises(ValueError, match=r"cannot read .* as JPG"):
        load(tmp_path, "a.jpg", data[: len(data) // 2])


def test_decoding_takes_little_memory(tmp_path):
    (tmp_path / "a.png").write_bytes(encode_png(np.full((600, 700, 3), 9, np.uint8)))
    load_image(tmp_path / "a.png")  # imports OpenImageIO
    tracemalloc.start()
    image = load_image(tmp_path / "a.png")
    assert tracemalloc.get_traced_memory()[1] < 1.5 * image.nbytes
    tracemalloc.stop()


def test_sixteen_bits(tmp_path):
    wide = np.arange(35, dtype=np.uint16).reshape(5, 7) * 1800
    image = load(tmp_path, "a.png", pillow("PNG", wide), linear=True)
    np.testing.assert_allclose(image[..., 0], wide / 65535, atol=1e-7)
    # alpha is kept where it is asked for: colours are not multiplied by it, and it is not decoded
    image = load(tmp_path, "a.png", pillow("PNG"), alpha=True)
    np.testing.assert_allclose(image[..., 3], PIXELS[..., 3] / 255, atol=1e-7)
    np.testing.assert_allclose(image[..., :3], linear(PIXELS[..., :3]), atol=2e-5)
    assert (load(tmp_path, "b.png", encode_png(PIXELS[..., :3]), alpha=True)[..., 3] == 1).all()


def test_floats_are_taken_as_they_are(tmp_path):
    values = np.random.default_rng(2).random((2, 3, 3), np.float32) * 9
    pfm = b"PF\n3 2\n-1.0\n" + values[::-1].astype("<f4").tobytes()  # the last row comes first
    np.testing.assert_array_equal(load(tmp_path, "a.pfm", pfm), values)
    write_exr(tmp_path / "a.exr", {"RGB": values})
    np.testing.assert_array_equal(load_image(tmp_path / "a.exr"), values)
    write_exr(tmp_path / "grey.exr", {"Y": values[..., 0]})
    np.testing.assert_array_equal(load_image(tmp_path / "grey.exr"), values[..., :1])
    hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n" + bytes([128, 64, 32, 130] * 6)
    np.testing.assert_array_equal(load(tmp_path, "a.hdr", hdr), np.broadcast_to([2, 1, 0.5], (2, 3, 3)))


def test_factors_of_headers(tmp_path):
    """HDR files were multiplied by each EXPOSURE, PFM files are to be by the absolute value of their scale."""
    hdr = b"#?RADIANCE\n#EXPOSURE=9\nEXPOSURE=4\nFORMAT=32-bit_rle_rgbe\nEXPOSURE= .5\n\n-Y 1 +X 1\n" + bytes(
        [128, 64, 32, 130]
    )
    np.testing.assert_array_equal(load(tmp_path, "a.hdr", hdr), [[[1, 0.5, 0.25]]])
    np.testing.assert_array_equal(dmis.EnvironmentLight(tmp_path / "a.hdr").texels, [[[1, 0.5, 0.25]]])
    for wrong in (b"0", b"-1", b"nan", b"1e999", b"x"):
        with pytest.raises(ValueError, match=r"a\.hdr as HDR: (EXPOSURE must be a number from|could not convert)"):
            load(tmp_path, "a.hdr", hdr.replace(b" .5", wrong))
    for order, sign in (("<", b"-"), (">", b"")):
        values = np.array([1, 2, 3], f"{order}f4")
        np.testing.assert_array_equal(
            load(tmp_path, "a.pfm", b"PF\n1 1\n%s2.5\n" % sign + values.tobytes()), [[2.5 * values]]
        )


def test_materials_and_skies_take_paths(tmp_path):
    """Colours are decoded, roughness is not; the bottom of the file is at t = 0."""
    wood, rough, sky = tmp_path / "wood.png", tmp_path / "rough.png", tmp_path / "sky.hdr"
    wood.write_bytes(encode_png(PIXELS[..., :3]))
    rough.write_bytes(encode_png(PIXELS[..., 0] // 2 + 64))
    sky.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n" + bytes([128, 64, 32, 130] * 6))
    (lobe,) = dmis.matte(str(wood)).lobes
    np.testing.assert_allclose(lobe.reflectance.texels, linear(PIXELS[::-1, :, :3]), atol=2e-5)
    (metal,) = dmis.metallic_roughness(str(wood), 1.0).lobes
    np.testing.assert_allclose(metal.fresnel.f0.texels, lobe.reflectance.texels, atol=1e-6)
    (coat,) = dmis.ggx(ks=0.1, alpha=rough).lobes
    np.testing.assert_allclose(coat.roughness.alpha.texels[::-1, :, 0], (PIXELS[..., 0] // 2 + 64) / 255, atol=1e-6)
    assert dmis.Image(str(wood), scale=(2, 2)).texels.shape == (5, 7, 3)
    np.testing.assert_array_equal(dmis.EnvironmentLight(sky).texels, load_image(sky))
    with pytest.raises(
        ValueError, match=r"kd must be a number, .* or the path of an image file; there is no file 'red'"
    ):
        dmis.matte("red")


def png(width, height, body=b"\0"):
    import zlib

    chunks = (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)), (b"IDAT", zlib.compress(body))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in (*chunks, (b"IEND", b""))
    )


TGA = struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, 65535, 65535, 24, 0)


@pytest.mark.parametrize(
    "name, data, message",
    [
        ("a.png", png(6000, 6000, bytes(2**22)), f"at most {MAX_PIXELS} pixels; got 6000x6000"),
        ("a.png", png(60_000, 60_000), "claims a 13732 MB image from a 66 byte file"),
        ("a.tga", TGA + bytes(100), "12884508675 bytes, implausible for 100"),
        (
            "a.hdr",
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n+Y 2 +X 3\n" + bytes(24),
            "rows must go down and to the right",
        ),
        ("a.pfm", b"PF\n1 1\n-1\n" + np.full(3, np.nan, "<f4").tobytes(), "must be finite"),
        ("a.png", encode_png(PIXELS[..., :3])[:90], "cannot read .* as PNG"),
        ("a.png", b"", r"a\.png is empty \(0 bytes\)"),
        ("a.png", b"GIF89a", "must be EXR, PNG, JPG, TGA, HDR or PFM; .* begins with b'GIF89a'"),
        ("a.exr", b"GIF89a", "cannot read .* as EXR"),
    ],
    ids=range(9),
)
def test_bad_files_are_refused(tmp_path, name, data, message):
    with pytest.raises(ValueError, match=message):
        load(tmp_path, name, data)


def test_missing_files_and_packages(tmp_path, monkeypatch):
    import sys

    with pytest.raises(FileNotFoundError, match="no such image"):
        load_image(tmp_path / "a.png")
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    with pytest.raises(ValueError, match=r"reading PNG needs OpenImageIO.*dmis\[images\]"):
        load(tmp_path, "a.png", encode_png(PIXELS[..., :3]))
