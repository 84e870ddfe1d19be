"""Reader of image files: EXR, and by OpenImageIO PNG, JPG, TGA, HDR and PFM."""

from __future__ import annotations

import math
import os
import re
import tempfile
from pathlib import Path

import numpy as np

from dmis.base.validate import check_package, number
from dmis.base.vectors import Array
from dmis.base.window import MAX_VALUES, check_size
from dmis.image import read_exr, srgb_to_linear

IMAGE_SUFFIXES = (".exr", ".png", ".jpg", ".jpeg", ".tga", ".hdr", ".pfm")
"""Extensions of the image files that are read."""
MAX_SCANS = 100
"""Most scans of a JPG file: each goes over all of its pixels."""
_SIGNATURES = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg", b"#?": ".hdr", b"PF": ".pfm", b"Pf": ".pfm"}
"""First bytes of a file of each format; TGA files have none, so that their extension names them."""


def load_image(path: str | os.PathLike[str], *, linear: bool = False, alpha: bool = False) -> Array:
    """Read an EXR, PNG, JPG, TGA, HDR or PFM file as linear values.

    Whole numbers (PNG, JPG and TGA of 8 bits, PNG of 16) become [0, 1] and are decoded from sRGB; floating-point
    numbers (EXR, HDR, PFM) are linear already, and taken as they are, but for factors in the headers of HDR and PFM.

    Parameters
    ----------
    path
        The file; its first bytes tell its format, but that of a TGA file. Formats other than EXR need the package
        OpenImageIO, ``pip install 'dmis[images]'``.
    linear
        Whether whole numbers are data, such as roughness, which the sRGB curve is not applied to.
    alpha
        Whether a last channel, of opacity, is kept as it is; it is 1 where the file has none. Default: dropped.

    Returns
    -------
    image
        ``(H, W, 1)`` or ``(H, W, 3)`` float32, with `alpha` a channel more, row 0 on top.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file is of another format, too large or damaged, or if OpenImageIO is needed and missing.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such image: {path}")
    with path.open("rb") as file:
        is_exr = file.read(4) == b"\x76\x2f\x31\x01" or path.suffix.lower() == ".exr"
    data = b"" if is_exr else path.read_bytes()
    pixels = _exr(path) if is_exr else decode_image(data, str(path))
    return linear_values(pixels / _exposure(data, path) if data.startswith(b"#?") else pixels, linear, alpha)


def decode_image(data: bytes, name: str) -> np.ndarray:
    """Return the pixels ``(H, W, 1 to 4)`` of the bytes of a file that is not EXR, integers or floating-point numbers.

    `name` is for messages. See `linear_values` for the image of them. EXPOSURE in the header of an HDR file is ignored.
    """
    tga = ".tga" if name.lower().endswith(".tga") else None
    suffix = next((suffix for signature, suffix in _SIGNATURES.items() if data.startswith(signature)), tga)
    if not data:
        raise ValueError(f"{name} is empty (0 bytes)")
    if suffix is None:
        raise ValueError(f"an image must be EXR, PNG, JPG, TGA, HDR or PFM; {name} begins with {data[:8]!r}")
    check_package("OpenImageIO", f"reading {suffix[1:].upper()}", "pip install 'dmis[images]', or convert it to EXR")
    try:
        return _decode(data, suffix)
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"cannot read {name} as {suffix[1:].upper()}: {' '.join(str(error).split())}") from error


def linear_values(pixels: np.ndarray, linear: bool = False, alpha: bool = False) -> Array:
    """Return the image of pixels, see `load_image`; the last of 2 or 4 channels is opacity."""
    count = 3 if pixels.shape[2] > 2 else 1
    if pixels.dtype.kind == "f":
        shown = np.ascontiguousarray(pixels[..., : count + alpha], np.float32)
        return shown if shown.shape[2] == count + alpha else np.insert(shown, count, 1, axis=2)
    image = np.ones((*pixels.shape[:2], count + alpha), np.float32)
    steps = np.arange(np.iinfo(pixels.dtype).max + 1) / np.iinfo(pixels.dtype).max
    curve = steps if linear else srgb_to_linear(steps)
    for row, values in zip(pixels, image, strict=True):  # by rows: as indices, pixels take 8 bytes a channel
        values[:, :count] = curve[row[:, :count]]
        if alpha and pixels.shape[2] > count:
            values[:, -1] = steps[row[:, -1]]
    return image


def _decode(data: bytes, suffix: str) -> np.ndarray:
    import OpenImageIO

    if suffix == ".jpg" and (scans := data.count(b"\xff\xda")) > MAX_SCANS:  # which begin so, and no other data does
        raise ValueError(f"it must have at most {MAX_SCANS} scans; it has {scans}")
    if suffix == ".hdr" and not re.search(rb"\n-Y \d+ \+X \d+\n", data[:4096]):
        raise ValueError("its rows must go down and to the right, with -Y and +X in its header; turn it")
    config = OpenImageIO.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"image{suffix}"  # it reads files only, and takes a ? in a name for an option
        file.write_bytes(data)
        image = OpenImageIO.ImageInput.open(str(file), config)
        if image is None:
            raise ValueError(OpenImageIO.geterror().replace(str(file), "the file") or "it is damaged")
        about = image.spec()
        check_size(about.width, about.height, about.nchannels)
        pixels = image.read_image(0, 0, 0, min(about.nchannels, 4), about.format)
        if image.has_error or pixels is None:  # also where the end of the file is missing
            raise ValueError(image.geterror().replace(str(file), "the file") or "it is damaged")
        image.close()
    if pixels.dtype.kind == "f" and not np.isfinite(pixels).all():
        raise ValueError("its values must be finite")
    return pixels


def _exposure(data: bytes, path: Path) -> np.float32:
    """Return the factor of the values of an HDR file: the product of the lines EXPOSURE in its header."""
    factors = re.findall(rb"\nEXPOSURE *= *([^\n]*)", data.partition(b"\n\n")[0])
    try:
        return np.float32(number("EXPOSURE", math.prod(map(float, factors)), 1e-12, 1e12))
    except ValueError as error:
        raise ValueError(f"cannot read {path} as HDR: {error}") from error


def _exr(path: Path) -> Array:
    """Return the channels R, G, B and A of an EXR file, ``(H, W, 3 or 4)``, or Y, ``(H, W, 1)``."""
    layers, _ = read_exr(path, MAX_VALUES * 3 // 8)  # 800 MB
    if "RGB" in layers:
        return np.dstack([layers["RGB"], layers["A"]]) if "A" in layers else layers["RGB"]
    if "Y" not in layers or {"RY", "BY", "X"} & set(layers):
        what = f"channels R, G, B, or Y alone, without RY, BY or X, Z; it has {', '.join(layers)}; convert it to RGB"
        raise ValueError(f"image {path} must have the {what}")
    return layers["Y"][..., None]
