"""Textures: constants, images, and products of them, evaluated for batches of surface points.

A parameter of a lobe is a plain number, an RGB triple, or an `Image`. Products are folded when they are made
(`scale`), because bilinear interpolation is linear: a scaled image costs no more than an image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from dmis.vec import Array

Wrap = Literal["repeat", "black", "clamp"]


@dataclass(frozen=True, eq=False)
class Image:
    """A bilinear image texture.

    Parameters
    ----------
    texels
        ``(H, W, C)`` linear values, C = 1 or 3, row 0 at t = 0. Three equal channels are stored as one.
    scale, offset
        ``(s, t) = uv * scale + offset``.
    wrap
        What lies outside [0, 1): ``repeat``, ``black`` or ``clamp``.
    """

    texels: Array
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    wrap: Wrap = "repeat"

    def __post_init__(self) -> None:
        texels = np.asarray(self.texels, np.float32)
        if texels.ndim != 3 or texels.shape[2] not in (1, 3) or texels.size == 0:
            raise ValueError(f"texels must have shape (H, W, 1) or (H, W, 3); got {texels.shape}")
        if not np.isfinite(texels).all():
            raise ValueError("texels must be finite, because one bad texel spoils every pixel that sees it")
        if self.wrap not in ("repeat", "black", "clamp"):
            raise ValueError(f"wrap must be 'repeat', 'black' or 'clamp'; got {self.wrap!r}")
        if texels.shape[2] == 3 and (texels == texels[..., :1]).all():
            texels = texels[..., :1]
        object.__setattr__(self, "texels", _planar(texels))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Pickles do not keep the order of axes in memory."""
        self.__dict__.update(state, texels=_planar(state["texels"]))

    def __call__(self, uv: Array) -> Array:
        """Values ``(C, N)`` at texture coordinates `uv` ``(2, N)``; texel (i, j) is centred at ((j+.5)/W, (i+.5)/H)."""
        height, width, channels = self.texels.shape
        flat = np.moveaxis(self.texels, 2, 0).reshape(channels, -1)  # a view: see `_planar`
        s = uv[0] * np.float32(self.scale[0]) + np.float32(self.offset[0])
        t = uv[1] * np.float32(self.scale[1]) + np.float32(self.offset[1])
        if self.wrap == "repeat":
            s, t = s - np.floor(s), t - np.floor(t)
        x, y = s * width - np.float32(0.5), t * height - np.float32(0.5)
        j, i = np.floor(x), np.floor(y)
        fx, fy = x - j, y - i
        (j0, in_j0), (j1, in_j1) = _wrap(j, width, self.wrap), _wrap(j + 1, width, self.wrap)
        (i0, in_i0), (i1, in_i1) = _wrap(i, height, self.wrap), _wrap(i + 1, height, self.wrap)
        row0, row1 = i0 * width, i1 * width
        gx0, gx1, gy0, gy1 = (1 - fx) * in_j0, fx * in_j1, (1 - fy) * in_i0, fy * in_i1
        out = flat.take(row0 + j0, axis=1) * (gx0 * gy0)
        out += flat.take(row0 + j1, axis=1) * (gx1 * gy0)
        out += flat.take(row1 + j0, axis=1) * (gx0 * gy1)
        out += flat.take(row1 + j1, axis=1) * (gx1 * gy1)
        return out


def _planar(texels: Array) -> Array:
    """The same ``(H, W, C)``, one channel after the other in memory, so that lookups gather from whole arrays.

    (`numpy.take` copies an array that is not contiguous, all of it, at every call.)
    """
    return np.moveaxis(np.ascontiguousarray(np.moveaxis(texels, 2, 0)), 0, 2)


Parameter = float | tuple[float, ...] | Array | Image
"""What a lobe's parameter may be in a scene description."""


def scale(a: Parameter, b: Parameter) -> Parameter:
    """The product of two parameters, folded into one constant or one image.

    Raises
    ------
    ValueError
        If both are images: their product is not bilinear, and no scene has needed it.
    """
    if isinstance(a, Image) and isinstance(b, Image):
        raise ValueError("the product of two image textures is not supported; bake it into one image")
    if isinstance(b, Image):
        a, b = b, a
    if isinstance(a, Image):
        return replace(a, texels=a.texels * np.asarray(b, np.float32))
    return tuple(np.atleast_1d(np.asarray(a, float) * np.asarray(b, float)).tolist())


def _wrap(i: Array, size: int, wrap: Wrap) -> tuple[np.ndarray, Array | float]:
    """Whole texel numbers brought into [0, size), and the weight (0 or 1) of what the wrap mode lets through."""
    if wrap == "repeat":  # i is in [-1, size] already
        return (i + size * (i < 0) - size * (i >= size)).astype(np.int32), 1.0
    inside = np.clip(i, 0, size - 1)
    return inside.astype(np.int32), 1.0 if wrap == "clamp" else (inside == i)
