"""Image files: EXR with layers and attributes, PNG as a preview; the sRGB curve."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.atomic_files import check_writable, replacing
from dmis.base.validate import check_package
from dmis.base.vectors import Array
from dmis.base.window import MAX_VALUES, check_size

REC709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
"""Chromaticities x, y of red, green, blue and white of all images, also those of EXR files that do not name theirs."""


def check_image(path: str | os.PathLike[str]) -> None:
    """Check that an image file can be written, before the image is rendered.

    A ValueError if the extension is neither .exr nor .png, or the package that writes EXR cannot be imported; an
    OSError if the file cannot be written, see `dmis.base.atomic_files.check_writable`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".exr", ".png"):
        raise ValueError(f"an image file must end in .exr (or .png for a preview); got {path}")
    if suffix == ".exr":
        check_package("OpenEXR", "writing EXR", "pip install OpenEXR, or write .png")
    check_writable(path)


def write_exr(
    path: str | os.PathLike[str], layers: Mapping[str, Array] | Array, attributes: Mapping[str, Any] | None = None
) -> None:
    """Write layers ``(H, W)`` or ``(H, W, 3)``, float16 or float32, with attributes of OpenEXR; or an image alone.

    A three-channel layer called ``RGB`` is the image; ``name.R``, ``name.G``, ``name.B`` hold any other.

    A ValueError if the extension is not .exr, a layer has another shape, or the image is not finite; an OSError if it
    cannot be written: an earlier file at `path` is then left as it was.
    """
    import OpenEXR  # imported where used: it is not needed to render

    path = Path(path)
    if path.suffix.lower() != ".exr":
        raise ValueError(f"an image file must end in .exr (or .png for a preview); got {path}")
    check_writable(path)
    channels = {}
    for name, layer in (layers if isinstance(layers, Mapping) else {"RGB": np.asarray(layers)}).items():
        if layer.ndim not in (2, 3) or (layer.ndim == 3 and layer.shape[2] != 3):
            raise ValueError(f"layer {name} must have shape (H, W) or (H, W, 3); got {layer.shape}")
        if name == "RGB" and not np.isfinite(layer).all():
            raise ValueError(f"an image must be finite; {np.size(layer) - np.isfinite(layer).sum()} values are not")
        dtype = np.float16 if layer.dtype == np.float16 else np.float32
        channels[name] = np.ascontiguousarray(layer, dtype)  # OpenEXR writes strided arrays wrong
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **(attributes or {})}
    with replacing(path) as partial, OpenEXR.File(header, channels) as file:
        try:
            file.write(os.fspath(partial))
        except RuntimeError as error:
            raise OSError(f"cannot write {path}: {error}") from error


def read_exr(path: str | os.PathLike[str], most_values: int = MAX_VALUES) -> tuple[dict[str, Array], dict[str, str]]:
    """Read the layers and string attributes of an EXR file; ``RGB`` is ``(H, W, 3)`` float32, its alpha ``A``.

    A FileNotFoundError if there is no such file; a ValueError if it cannot be read as EXR, is deep, has several parts,
    other chromaticities than `REC709`, or by its header more than `most_values` values in all of its channels.
    """
    import OpenEXR

    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such image: {path}")
    try:
        with OpenEXR.File(os.fspath(path), header_only=True) as file:
            header = dict(file.header())  # which closing empties
            if len(file.parts) != 1 or header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile):
                kind = f"has {len(file.parts)} parts" if len(file.parts) != 1 else "is deep"
                raise ValueError(f"an image must have one part of flat pixels; it {kind}; export it as one flat image")
            (low, high), channels = header["dataWindow"], len(header["channels"])
        width, height = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
        check_size(width, height, channels, most_values)
        with OpenEXR.File(os.fspath(path), separate_channels=True) as file:  # those of a layer may differ in type
            if not file.parts:
                raise ValueError("its pixels are damaged or cut off")
            layers = {name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()}
        for red in [name for name in layers if name.rpartition(".")[2] == "R"]:
            names = [red[:-1] + colour for colour in "RGB"]
            if set(names) <= set(layers):
                layers[red[:-2] or "RGB"] = np.stack([layers.pop(name) for name in names], axis=-1)
        primaries = header.get("chromaticities", REC709)
        if "RGB" in layers and not np.allclose(primaries, REC709, atol=1e-3):
            raise ValueError(f"its chromaticities must be those of Rec. 709 (sRGB); convert it; got {primaries}")
    except Exception as error:
        raise ValueError(f"cannot read {path} as EXR: {error}") from error
    return layers, {name: value for name, value in header.items() if isinstance(value, str)}


def srgb_to_linear(values: Array) -> Array:
    """Return linear values of sRGB values in [0, 1] (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def tonemap(image: Array, exposure: float = 1.0) -> Array:
    """Return linear RGB times `exposure` as sRGB values in [0, 1], clipped: for display, not for measurement."""
    x = np.clip(np.nan_to_num(image) * exposure, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def write_png(path: str | os.PathLike[str], image: Array, exposure: float = 1.0) -> None:
    """Write linear RGB ``(H, W, 3)`` times `exposure` as a PNG of 8 bits in sRGB, clipped.

    A ValueError if the image has another shape; an OSError if it cannot be written: an earlier file at `path` is then
    left as it was.
    """
    data = png_of(image, exposure)
    with replacing(path) as partial:
        partial.write_bytes(data)


def png_of(image: Array, exposure: float = 1.0) -> bytes:
    """Return linear RGB ``(H, W, 3)`` times `exposure` as the bytes of a PNG file of 8 bits, sRGB, clipped.

    A ValueError if the image has another shape.
    """
    if image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"an image must have shape (H, W, 3); got {image.shape}")
    return encode_png(np.rint(255 * tonemap(image, exposure)).astype(np.uint8))


def encode_png(pixels: np.ndarray) -> bytes:
    """Return the bytes of a PNG file with pixels ``(H, W, 3)`` or, grey, ``(H, W)`` of 8 bits, marked as sRGB.

    All rows are stored unfiltered, as differences from the pixel to the left, or as differences from the row above
    (filters 0 to 2 of ISO/IEC 15948:2004, 9.2), whichever is the shortest.
    """
    height, width = pixels.shape[:2]
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    rows = np.ascontiguousarray(pixels, np.uint8).reshape(height, -1)
    left, above = rows.copy(), rows.copy()
    left[:, channels:] -= rows[:, :-channels]  # modulo 256, as the format has it
    above[1:] -= rows[:-1]
    filtered = (np.insert(values, 0, number, axis=1) for number, values in enumerate((rows, left, above)))
    compressed = min((zlib.compress(values.tobytes(), 6) for values in filtered), key=len)
    colour = {1: 0, 3: 2}[channels]  # grey, RGB
    header = struct.pack(">IIBBBBB", width, height, 8, colour, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"sRGB", b"\0"), (b"IDAT", compressed), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in chunks
    )
