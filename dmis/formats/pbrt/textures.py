"""Textures of pbrt files, made from parameter lists, and images.

The first row of an image is t = 0 in pbrt-v2, and t = 1 in v3 and v4. A texel is (scale * texel) ^ gamma in v2. Files
of whole numbers (`_WHOLE`) are decoded from sRGB in v4, unless ``encoding`` is linear, and in textures of v3, unless
``gamma`` is false, but not in v2 and in skies of v3. A float texture takes the luminance of an image, in v3 before it
is decoded; in v4 its opacity, if it has any, or its mean.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dmis.base.color import LUMINANCE
from dmis.base.vectors import Array
from dmis.brdf.texture import Image, combine, scale
from dmis.formats.pbrt.parameters import ParameterSet
from dmis.formats.pbrt.tokens import Token, blame
from dmis.image import srgb_to_linear
from dmis.image_reader import IMAGE_SUFFIXES, decode_image, linear_values, load_image

TEXTURES = "constant", "scale", "mix", "imagemap", "checkerboard"
"""Classes of textures that are read."""
_WHOLE = ".png", ".tga", ".jpg", ".jpeg"
"""Extensions of image files that hold whole numbers; the others are linear."""
_FORMATS = {"v2": (".exr", ".tga", ".pfm"), "v3": (".exr", ".tga", ".pfm", ".png"), "v4": IMAGE_SUFFIXES}
"""Extensions of the image files that each version of pbrt reads."""


def make_texture(kind: str, name: Token, p: ParameterSet) -> Any:
    """Return a texture of class `name` and type `kind`, float or color.

    A constant texture is a number or an RGB triple, any other an image.
    """
    read = p.real if kind == "float" else p.colour
    name.among("a texture", TEXTURES)
    if name.name == "constant":
        return read("value", 1.0)
    if name.name == "imagemap":
        return _imagemap(kind, name, p)
    if name.name == "checkerboard":
        return _checkerboard(kind, name, p)
    v4 = p.dialect == "v4"
    with blame(name):
        if name.name == "mix":
            value = blend(read("tex1", 0.0), read("tex2", 1.0), p.real("amount", 0.5))
        else:
            value = scale(read("tex" if v4 else "tex1", 1.0), p.real("scale", 1.0) if v4 else read("tex2", 1.0))
    return float(value[0]) if kind == "float" and isinstance(value, tuple) else value


def blend(a: Any, b: Any, amount: Any) -> Any:
    """Return ``(1 - amount) a + amount b``, folded into one constant or, if one of the three is an image, one image.

    A ValueError if more of them are: their product is not bilinear.
    """
    images = [value for value in (a, b, amount) if isinstance(value, Image)]
    if len(images) > 1 or any(image.wrap == "black" for image in images):
        raise ValueError("a mix of several images, or of one that is black outside, is not supported; bake it into one")
    return combine(lambda x, y, t: (1 - t) * x + t * y, a, b, amount)


def _checkerboard(kind: str, name: Token, p: ParameterSet) -> Image:
    """Return two by two squares of two constants; pbrt also blurs their edges by the size of a pixel there."""
    if p.integer("dimension", 2) != 2:
        raise p.items["dimension"].error("must be 2, because a checkerboard in space is not supported")
    p.string("mapping", "uv", ("uv",))
    default: Any = (1.0, 0.0) if kind == "float" else ((1.0,) * 3, (0.0,) * 3)
    one, two = (np.reshape(p.constant(key, d), -1) for key, d in zip(("tex1", "tex2"), default, strict=True))
    size, offset = ((p.number(f"u{x}", d) / 2, p.number(f"v{x}", d) / 2) for x, d in (("scale", 1), ("delta", 0)))
    with blame(name):
        return Image(np.array([[one, two], [two, one]]), size, offset, nearest=True)


def _imagemap(kind: str, name: Token, p: ParameterSet) -> Image:
    p.string("mapping", "uv", ("uv",))
    p.note_unapplied({"filter": ["bilinear"], "trilinear": ["false"], "maxanisotropy": None})
    wrap = p.string("wrap", "repeat", ("repeat", "black", "clamp"))
    size = p.number("uscale", 1), p.number("vscale", 1)
    offset = p.number("udelta", 0), p.number("vdelta", 0)
    factor, v4 = p.number("scale", 1), p.dialect == "v4"
    gamma = p.number("gamma", 1) if p.dialect == "v2" else 1.0
    encoded, grey = _is_encoded(p), kind == "float"
    texels = image(p, "filename", encoded and (v4 or not grey), alpha=v4 and grey)
    texels = texels.astype(np.float32 if factor == gamma == 1 else float, copy=False)
    if p.dialect != "v2":
        texels = texels[::-1]
    if v4 and grey:
        opacity = texels[..., 3:]
        texels = opacity if (opacity < 1).any() else texels[..., :3].mean(axis=2, keepdims=True, dtype=float)
    elif grey:
        texels = srgb_to_linear(texels @ LUMINANCE[:, None]) if encoded else texels @ LUMINANCE[:, None]
    texels = texels if factor == 1 else factor * texels
    if v4:
        p.require({"invert": False})
    if v4 and not grey:
        texels = np.maximum(texels, 0)
    texels = texels if gamma == 1 else np.maximum(texels, 0) ** gamma
    with blame(name):
        return Image(texels.astype(np.float32, copy=False), size, offset, wrap)  # type: ignore[arg-type]


def _is_encoded(p: ParameterSet) -> bool:
    """Return whether the whole numbers of the image of a texture are sRGB."""
    if not p.string("filename").lower().endswith(_WHOLE):
        p.require({"gamma": False} if p.dialect == "v3" else {"encoding": "linear"} if p.dialect == "v4" else {})
        return False
    if p.dialect == "v4":
        return p.string("encoding", "sRGB", ("sRGB", "linear")) == "sRGB"
    return p.dialect == "v3" and p.boolean("gamma", True)


def image(p: ParameterSet, name: str, encoded: bool | None = None, alpha: bool = False) -> Array:
    """Read the image file that the string parameter `name` names, (H, W, 3) float32, or (H, W, 4) with `alpha`.

    Whole numbers are decoded from sRGB if `encoded`; by default in v4 only, as those of skies.
    """
    file = p.string(name)
    token = p.items[name].token
    path = token.file(file)
    if path.suffix.lower() not in _FORMATS[p.dialect]:
        known = ", ".join(suffix[1:].upper() for suffix in _FORMATS[p.dialect])
        raise token.error(f"images of pbrt-{p.dialect} must be {known}; convert {file!r} to .exr, with linear values")
    with blame(token):
        linear = not (p.dialect == "v4" if encoded is None else encoded)
        if path.suffix.lower() == ".hdr":  # without EXPOSURE, which pbrt-v4 does not read
            texels = linear_values(decode_image(path.read_bytes(), str(path)), linear, alpha)
        else:
            texels = load_image(path, linear=linear, alpha=alpha)
    count = 3 + alpha
    return texels if texels.shape[2] == count else texels[..., [0, 0, 0, 1][:count]]
