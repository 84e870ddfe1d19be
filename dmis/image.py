"""Images in files: EXR with layers and provenance, PNG for a quick look."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.files import replacing
from dmis.vec import Array

if TYPE_CHECKING:
    from dmis.render import Result


MAX_PIXELS = 2**25
"""Most pixels of an image that is read: 400 MB of RGB. A side has at most 65535."""
MAX_CHANNELS = 64
"""Most channels of an image that is read, and of all its pixels as many as 16 of the largest image have."""


def write_image(path: str | os.PathLike[str], result: Result) -> None:
    """Write a rendered image: ``.exr`` with all layers, or ``.png`` for a look at it.

    Raises
    ------
    ValueError
        If the extension is neither.
    OSError
        If the directory does not exist.
    """
    if Path(path).suffix.lower() == ".png":
        write_png(path, result.image)
        return
    variance = np.minimum(result.variance, np.finfo(np.float32).max)  # squares may be beyond what the file can hold
    layers = {"RGB": result.image, "weight": result.weight, "variance": variance, "samples": result.samples}
    write_exr(path, layers, {"dmis.provenance": json.dumps(dict(result.provenance))})


def write_exr(
    path: str | os.PathLike[str], layers: Mapping[str, Array], attributes: Mapping[str, str] | None = None
) -> None:
    """Write layers ``(H, W)`` or ``(H, W, 3)``, float16 or float32, with string attributes.

    A three-channel layer called ``RGB`` is the image; ``name.R``, ``name.G``, ``name.B`` hold any other.

    Raises
    ------
    ValueError
        If the extension is not .exr, a layer has another shape, or the image is not finite.
    OSError
        If the directory does not exist, or the disk is full: a file that was there before is then left as it was.
    """
    import OpenEXR  # imported where used: it is not needed to render

    path = Path(path)
    if path.suffix.lower() != ".exr":
        raise ValueError(f"an image file must end in .exr (or .png for a preview); got {path}")
    if not path.resolve().parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: its directory does not exist")
    channels = {}
    for name, layer in layers.items():
        if layer.ndim not in (2, 3) or (layer.ndim == 3 and layer.shape[2] != 3):
            raise ValueError(f"layer {name} must have shape (H, W) or (H, W, 3); got {layer.shape}")
        if name == "RGB" and not np.isfinite(layer).all():
            raise ValueError(f"an image must be finite; {np.size(layer) - np.isfinite(layer).sum()} values are not")
        kind = np.float16 if layer.dtype == np.float16 else np.float32
        channels[name] = np.ascontiguousarray(layer, kind)  # OpenEXR writes strided arrays wrong
    header: dict[str, Any] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        **(attributes or {}),
    }
    with replacing(path) as partial, OpenEXR.File(header, channels) as file:
        try:
            file.write(os.fspath(partial))
        except RuntimeError as error:
            raise OSError(f"cannot write {path}: {error}") from error


def read_exr(path: str | os.PathLike[str]) -> tuple[dict[str, Array], dict[str, str]]:
    """Layers and string attributes of an EXR file; ``RGB`` is ``(H, W, 3)`` float32, alpha dropped.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it cannot be read as EXR, or is too large, which its header tells before memory is taken for it.
    """
    import OpenEXR

    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such image: {path}")
    try:
        with OpenEXR.File(os.fspath(path), header_only=True) as file:
            if len(file.parts) != 1:
                raise ValueError(f"an image must have one part; it has {len(file.parts)}")
            (low, high), channels = file.header()["dataWindow"], len(file.header()["channels"])
        width, height = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
        if not (1 <= width <= 65535 and 1 <= height <= 65535 and width * height <= MAX_PIXELS):
            raise ValueError(
                f"an image must have 1 to 65535 pixels on a side and at most {MAX_PIXELS}; it says {width}x{height}"
            )
        if channels > MAX_CHANNELS or channels * width * height > 16 * MAX_PIXELS:
            raise ValueError(
                f"an image must have at most {MAX_CHANNELS} channels, and {16 * MAX_PIXELS} values in them; "
                f"it says {channels} of {width}x{height}"
            )
        with OpenEXR.File(os.fspath(path)) as file:
            attributes = {k: v for k, v in file.header().items() if isinstance(v, str)}
            layers = {name: np.array(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except Exception as error:
        raise ValueError(f"cannot read {path} as EXR: {error}") from error
    if "RGBA" in layers:
        layers["RGB"] = np.ascontiguousarray(layers.pop("RGBA")[..., :3])
    return layers, attributes


def tonemap(image: Array, exposure: float = 1.0) -> Array:
    """Linear RGB to sRGB in [0, 1], clipped: for looking at, not for measuring."""
    x = np.clip(np.nan_to_num(image) * exposure, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def write_png(path: str | os.PathLike[str], image: Array) -> None:
    """Write linear RGB ``(H, W, 3)`` as an sRGB PNG (needs matplotlib, extra ``plot``)."""
    try:
        from matplotlib.image import imsave
    except ImportError as error:
        raise ValueError("writing PNG needs matplotlib: pip install 'dmis[plot]', or write .exr instead") from error
    with replacing(path) as partial:
        imsave(os.fspath(partial), tonemap(image).astype(np.float32), format="png")
