"""Textures of pbrt files, made from parameter lists, and images.

The first row of an image is t = 0 in pbrt-v2, and t = 1 in v3 and v4. A texel is (scale * texel) ^ gamma in v2; in v3
and v4 gamma is about files of 8 bits, which are not read. A float texture takes the luminance of an image, in v4 its
mean.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dmis.base.color import LUMINANCE
from dmis.base.vectors import Array
from dmis.brdf.texture import Image, scale
from dmis.formats.pbrt.parameters import Parameters
from dmis.formats.pbrt.tokens import Token, blame
from dmis.image import read_exr

_ENCODINGS: dict[str, dict[str, Any]] = {"v3": {"gamma": False}, "v4": {"encoding": "linear"}}
"""Parameters of images whose texels are linear, by dialect."""


def make_texture(kind: str, name: Token, p: Parameters) -> Any:
    """Return a texture of class `name` and type `kind`, float or color.

    A constant texture is a number or an RGB triple, any other an image.
    """
    read = p.real if kind == "float" else p.colour
    name.among("a texture", ("constant", "scale", "imagemap"))
    if name.name == "constant":
        return read("value", 1.0)
    if name.name == "imagemap":
        return _imagemap(kind, name, p)
    v4 = p.dialect == "v4"
    with blame(name):
        product = scale(read("tex" if v4 else "tex1", 1.0), p.real("scale", 1.0) if v4 else read("tex2", 1.0))
    return float(product[0]) if kind == "float" and isinstance(product, tuple) else product


def _imagemap(kind: str, name: Token, p: Parameters) -> Image:
    p.string("mapping", "uv", ("uv",))
    wrap = p.string("wrap", "repeat", ("repeat", "black", "clamp"))
    size = p.number("uscale", 1), p.number("vscale", 1)
    offset = p.number("udelta", 0), p.number("vdelta", 0)
    factor, v4 = p.number("scale", 1), p.dialect == "v4"
    gamma = p.number("gamma", 1) if p.dialect == "v2" else 1.0
    p.require(_ENCODINGS.get(p.dialect, {}))
    texels = image(p, "filename").astype(np.float64)
    if name.source.dialect.t_up:
        texels = texels[::-1]
    if kind == "float":
        texels = texels.mean(axis=2, keepdims=True) if v4 else texels @ LUMINANCE[:, None]
    texels = factor * texels
    invert = v4 and p.boolean("invert", False)
    if invert or (v4 and kind == "color"):
        texels = np.maximum(1 - texels if invert else texels, 0)
    texels = texels if gamma == 1 else np.maximum(texels, 0) ** gamma
    with blame(name):
        return Image(texels.astype(np.float32), size, offset, wrap)  # type: ignore[arg-type]


def image(p: Parameters, name: str) -> Array:
    """Read the EXR file that the string parameter `name` names, (H, W, 3) float32; alpha is dropped."""
    file = p.string(name)
    token = p.items[name].token
    path = token.file(file)
    if path.suffix.lower() != ".exr":
        raise token.error(f"images must be EXR files, so that their values are linear; convert {file!r} to .exr")
    with blame(token):
        layers, _ = read_exr(path)
    if "RGB" in layers:
        return layers["RGB"]
    if "Y" not in layers:
        raise token.error(f"the image needs the channels R, G, B or Y; it has {', '.join(layers)}")
    return layers["Y"][..., None].repeat(3, axis=2)
