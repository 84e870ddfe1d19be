"""Textures: constants, images, and products of them, evaluated for batches of surface points.

A parameter of a lobe is a plain number, an RGB triple, or an `Image`; `check_values` and `check_number` check it.
Products are folded when they are made (`scale`), because bilinear interpolation is linear: a scaled image costs no more
than an image.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from inspect import signature
from typing import Any, Literal, ParamSpec, TypeVar

import numpy as np

from dmis.base.validate import one_of
from dmis.base.vectors import Array, Index

P = ParamSpec("P")
R = TypeVar("R")
Wrap = Literal["repeat", "mirror", "black", "clamp"]
FLOAT32_TINY = float(np.finfo(np.float32).tiny)
FLOAT32_MAX = float(np.finfo(np.float32).max)
"""Smallest positive and largest number of float32, in which lobes are computed: the bounds of parameters."""
COLOURS = "kd", "ks", "kr", "kt", "base", "opacity"
"""Parameters of materials whose image files are decoded from sRGB."""
MAX_UV_SCALE = 1e15
"""Largest scale and offset of texture coordinates: times coordinates of a mesh (`dmis.base.validate.FARTHEST`) and
texels they are below 3e38 still."""


@dataclass(frozen=True, eq=False)
class Image:
    """A bilinear image texture, or one of squares of a colour.

    Parameters
    ----------
    texels
        ``(H, W, C)`` linear values, C = 1 or 3, row 0 at t = 0; three equal channels are stored as one. Or the path of
        an image file, which is read by `dmis.load_image` and turned over: its bottom is at t = 0, as in OBJ files.
    scale, offset
        ``(s, t) = uv * scale + offset``; within `MAX_UV_SCALE`.
    wrap
        What lies outside [0, 1): ``repeat``, ``mirror``, ``black`` or ``clamp``; of both axes, or a pair, of s and t.
    nearest
        Whether a texel is a square of one colour: nothing is interpolated.
    """

    texels: Any
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    wrap: Wrap | tuple[Wrap, Wrap] = "repeat"
    nearest: bool = False

    def __post_init__(self) -> None:
        if isinstance(self.texels, str | os.PathLike):
            object.__setattr__(self, "texels", _read(self.texels))
        given = np.asarray(self.texels)
        if given.dtype.kind in "ui" and given.size and given.max() > 1:
            raise ValueError(
                "texels must be linear values, mostly in [0, 1]; divide those of 8 bits by 255, and make them linear; "
                f"got {given.dtype} up to {given.max()}"
            )
        if given.dtype.kind not in "fbui":
            raise ValueError(f"texels must be an array of numbers; got {self.texels!r}")
        texels = np.asarray(given, np.float32)
        if texels.ndim != 3 or texels.shape[2] not in (1, 3) or texels.size == 0:
            raise ValueError(f"texels must have shape (H, W, 1) or (H, W, 3); got {texels.shape}")
        if not np.isfinite(texels).all():
            raise ValueError("texels must be finite, because one bad texel spoils every pixel that sees it")
        for name, values in (("scale", self.scale), ("offset", self.offset)):
            if not (np.abs(values) <= MAX_UV_SCALE).all():
                bound = f"within {MAX_UV_SCALE:g}, because lookups are in float32"
                raise ValueError(f"{name} must be {bound}; got {values}")
        for wrap in self.wraps:
            one_of("wrap", wrap, ("repeat", "mirror", "black", "clamp"))
        if len(set(self.wraps)) == 1:
            object.__setattr__(self, "wrap", self.wraps[0])
        if texels.shape[2] == 3 and (texels == texels[..., :1]).all():
            texels = texels[..., :1]
        object.__setattr__(self, "texels", np.ascontiguousarray(texels))

    @property
    def place(self) -> tuple[Any, ...]:
        """Scale, offset and wrap: images of one place have their texels at the same coordinates, up to resolution."""
        return tuple(self.scale), tuple(self.offset), self.wrap

    @property
    def wraps(self) -> tuple[Wrap, Wrap]:
        """What lies outside [0, 1) along s and along t."""
        return self.wrap if isinstance(self.wrap, tuple) else (self.wrap, self.wrap)

    @cached_property
    def _rows(self) -> Array:
        """One row per texel, those of a border around the image included; three channels are padded to four.

        A lookup reads all channels of a texel from one place in memory, and needs no wrap mode.
        """
        height, width, channels = self.texels.shape
        table = np.zeros((height + 2, width + 2, channels + channels // 2), np.float32)
        table[1:-1, 1:-1, :channels] = self.texels
        for wrap, rows in zip(self.wraps, (table.swapaxes(0, 1), table), strict=True):
            if wrap != "black":
                before, behind = (-2, 1) if wrap == "repeat" else (1, -2)
                rows[0], rows[-1] = rows[before], rows[behind]
        object.__setattr__(self, "texels", table[1:-1, 1:-1, :channels])  # large images are kept once
        return table.reshape(-1, table.shape[2])

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, which are pickled; tables of texels are made again."""
        return {name: value for name, value in self.__dict__.items() if name != "_rows"}

    def __call__(self, uv: Array) -> Array:
        """Return values ``(C, N)`` at coordinates `uv` ``(2, N)``; texel (i, j) is centred at ((j+.5)/W, (i+.5)/H)."""
        s = uv[0] * np.float32(self.scale[0]) + np.float32(self.offset[0])
        t = uv[1] * np.float32(self.scale[1]) + np.float32(self.offset[1])
        return self.at(*(_folded(x, wrap) for x, wrap in zip((s, t), self.wraps, strict=True)))

    def at(self, s: Array, t: Array) -> Array:
        """Return values ``(C, N)`` at coordinates in the image, `s` and `t` ``(N,)``; in [0, 1] if it repeats."""
        height, width, channels = self.texels.shape
        x = s * width - np.float32(0.5)
        y = t * height - np.float32(0.5)
        if self.wrap != "repeat":
            x = np.clip(x, -1, width)
            y = np.clip(y, -1, height)
        if self.nearest:
            j, i = (np.floor(a + np.float32(0.5)).astype(np.int32) for a in (x, y))
            return self._gather((i + 1) * (width + 2) + j + 1, np.ones(len(j), np.float32), channels)
        j = np.minimum(np.floor(x), width - 1)
        i = np.minimum(np.floor(y), height - 1)
        fx, fy = x - j, y - i
        gx, gy = 1 - fx, 1 - fy
        below = width + 2
        corner = (i.astype(np.int32) + 1) * below + j.astype(np.int32) + 1
        out = self._gather(corner, gx * gy, channels)
        out += self._gather(corner + 1, fx * gy, channels)
        out += self._gather(corner + below, gx * fy, channels)
        out += self._gather(corner + (below + 1), fx * fy, channels)
        return out

    def _gather(self, row: np.ndarray, weight: Array, channels: int) -> Array:
        """Return texels times `weight` ``(N,)``, as ``(C, N)`` with contiguous channels."""
        return np.multiply(self._rows.take(row, axis=0).T[:channels], weight, order="C")


@dataclass(frozen=True, eq=False)
class Images:
    """A parameter of M materials: numbers, RGB triples and at least one `Image`."""

    values: tuple[Any, ...]

    def __call__(self, row: Index, uv: Array) -> Array:
        """Return the values ``(3, N)`` of the materials `row` ``(N,)`` at texture coordinates `uv` ``(2, N)``."""
        out = np.empty((3, len(row)), np.float32)
        for number, value in enumerate(self.values):
            here = np.flatnonzero(row == number)
            if len(here):
                out[:, here] = value(uv.take(here, axis=1)) if isinstance(value, Image) else np.reshape(value, (-1, 1))
        return out


def _folded(x: Array, wrap: Wrap) -> Array:
    """Return coordinates of an image in [0, 1] if it repeats or is mirrored, else as they are."""
    if wrap == "mirror":
        return 1 - np.abs(x - 2 * np.floor(x / 2) - 1)
    return x - np.floor(x) if wrap == "repeat" else x


def _read(path: Any, linear: bool = False) -> Array:
    """Return the texels of an image file, the bottom row first, see `dmis.load_image`."""
    from dmis.image_reader import load_image  # where a texture has a file

    return load_image(path, linear=linear)[::-1]


def image_of_data(name: str, value: Any) -> Image:
    """Return an image, that of a file whose numbers are no colours if `value` is its path; refuse others by `name`."""
    if isinstance(value, str | os.PathLike):
        return Image(_read(value, linear=True))
    if not isinstance(value, Image):
        raise ValueError(f"{name} must be an Image, or the path of an image file; got {value!r}")
    return value


Parameter = float | tuple[float, ...] | Array | Image
"""What a lobe's parameter may be in a scene description."""


def reads_images(make: Callable[P, R]) -> Callable[P, R]:
    """Let arguments of a function that makes a material be paths of image files, in place of `Image`.

    Files are decoded from sRGB where they are the colours `COLOURS`, and else taken as they are.
    """

    @wraps(make)
    def make_with_images(*args: P.args, **kwargs: P.kwargs) -> R:
        if not any(isinstance(value, str | os.PathLike) for value in (*args, *kwargs.values())):
            return make(*args, **kwargs)
        bound = signature(make).bind(*args, **kwargs)
        for name, value in bound.arguments.items():
            if isinstance(value, str | os.PathLike):
                if not os.path.isfile(value):
                    what = "a number, an RGB triple, an Image or the path of an image file"
                    raise ValueError(f"{name} must be {what}; there is no file {str(value)!r}")
                bound.arguments[name] = Image(_read(value, linear=name not in COLOURS))
        return make(*bound.args, **bound.kwargs)

    return make_with_images


def scale(a: Parameter, b: Parameter) -> Parameter:
    """Return the product of two parameters, folded into one constant or one image.

    A ValueError if both are images: their product is not bilinear, and no scene has needed it.
    """
    if isinstance(a, Image) and isinstance(b, Image):
        raise ValueError("the product of two image textures is not supported; bake it into one image")
    return combine(np.multiply, a, b)


def combine(function: Callable[..., Array], *values: Parameter) -> Parameter:
    """Return a function of parameters: a constant, or an image whose texels are the function of theirs.

    Smaller images are interpolated at the texels of the largest. A ValueError if images are not placed alike.
    """
    images = [value for value in values if isinstance(value, Image)]
    if not images:
        return tuple(np.atleast_1d(function(*(np.asarray(value, float) for value in values))).tolist())
    largest = max(images, key=lambda image: image.texels.size)
    if any(image.place != largest.place for image in images):
        raise ValueError("images that are combined must have one scale, offset and wrap; bake them into one image")
    (height, width), arrays = largest.texels.shape[:2], []
    for value in values:
        if not isinstance(value, Image):
            arrays.append(np.asarray(value, np.float32).reshape(1, 1, -1))
        elif value.texels.shape[:2] == (height, width):
            arrays.append(value.texels)
        else:
            rows, columns = (np.mgrid[:height, :width] + 0.5).astype(np.float32).reshape(2, -1)
            arrays.append(value.at(columns / np.float32(width), rows / np.float32(height)).T.reshape(height, width, -1))
    return replace(largest, texels=function(*arrays))


def check_values(
    name: str,
    value: Any,
    rule: str,
    reason: str,
    least: float = 0.0,
    most: float = FLOAT32_MAX,
    *,
    rgb: bool = True,
    image: bool = True,
) -> Array:
    """Return the numbers of a parameter: ``(1,)`` or ``(3,)`` of a constant, the texels of an image.

    Parameters
    ----------
    name, value
        The parameter.
    rule, reason
        For the message: ``NAME must be RULE, because REASON; got VALUE``.
    least, most
        Bounds of all of the numbers.
    rgb, image
        Whether there may be three channels, and an `Image`.

    Raises
    ------
    ValueError
        If a number is out of bounds or NaN, or there are too few or too many.
    """
    textured = isinstance(value, Image)
    if isinstance(value, str):
        raise ValueError(f"{name} must be {_KINDS[rgb, image]}, because {reason}; got {value!r}")
    numbers: Array = value.texels if textured else np.asarray(value, float).reshape(-1)
    if (textured and not image) or numbers.shape[-1] not in ((1, 3) if rgb else (1,)):
        rule = _KINDS[rgb, image]
    elif textured and "black" in value.wraps and not least <= 0 <= most:
        rule += ", an image with another wrap than black"
    elif (numbers >= least).all() and (numbers <= most).all():
        return numbers
    if textured:
        value = f"an image {numbers.shape} from {numbers.min():g} to {numbers.max():g}"
    raise ValueError(f"{name} must be {rule}, because {reason}; got {value}")


_KINDS = {
    (False, False): "a number",
    (True, False): "a number or an RGB triple",
    (False, True): "a number or an image of one channel",
    (True, True): "a number, an RGB triple or an image",
}


def check_number(
    name: str, value: Any, rule: str, reason: str, least: float, most: float = FLOAT32_MAX, *, image: bool = False
) -> Any:
    """Return a float, or an `Image` of one channel if `image`; refuse numbers out of bounds, see `check_values`."""
    numbers = check_values(name, value, rule, reason, least, most, rgb=False, image=image)
    return value if isinstance(value, Image) else float(numbers[0])
