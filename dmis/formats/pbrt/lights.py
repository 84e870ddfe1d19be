"""Lights of pbrt files: those without a shape, their skies, and the emission of area lights.

The strength of a light is its colour times ``scale``; pbrt-v4 brings spectra to luminance 1. Its ``power`` and
``illuminance``, in place of the light's own strength, are refused.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dmis.base.color import Rgb
from dmis.base.patches import row_blocks
from dmis.base.vectors import Array, Floats
from dmis.formats.pbrt.parameters import SPECTRUM_TYPES, ParameterSet, rgb
from dmis.formats.pbrt.tokens import Token, blame
from dmis.light.delta import DistantLight, PointLight, SpotLight
from dmis.light.light import Light


def make_light(name: Token, p: ParameterSet, to_world: Floats) -> Light:
    """Return the light `name` of a ``LightSource`` line; `to_world` (4, 4) is the current transform."""
    make = LIGHTS[name.among("a light", LIGHTS)]
    with blame(name):
        return make(p, to_world)


def scale_of(matrix: Floats, what: str, reason: str) -> float:
    """Return the factor by which a matrix (4, 4), which may also rotate and mirror, scales all lengths of `what`.

    A ValueError, which gives the `reason`, if it scales them differently.
    """
    square = matrix[:3, :3].T @ matrix[:3, :3]
    factor = np.trace(square) / 3
    if not np.allclose(square, factor * np.eye(3), atol=1e-4 * factor):
        raise ValueError(f"{what} must not be stretched, because {reason}; scale all axes alike")
    return float(np.sqrt(factor))


def _strength(p: ParameterSet, name: str) -> Rgb:
    """Return the intensity or radiance of a light whose colour is the parameter `name`."""
    colour = p.light(name)
    if p.dialect == "v4":
        p.refuse("this is not supported; give the strength of the light by its scale", "power", "illuminance")
        return rgb(p.number("scale", 1) * np.asarray(colour))
    scale = p.get("scale", *SPECTRUM_TYPES)
    return rgb(np.multiply(colour, 1 if scale is None else scale.colour()))


def emission(p: ParameterSet) -> Rgb:
    """Return the radiance of an ``AreaLightSource``."""
    if p.dialect == "v4":
        p.refuse("an image that emits is not supported", "filename")
    return _strength(p, "L")


def _point(p: ParameterSet, to_world: Floats) -> Light:
    """Return a point light, at the parameter ``from``."""
    start = p.point("from", (0, 0, 0))
    moved = to_world[:3, :3] @ start if p.dialect == "v4" else start  # v2 and v3 add it in world space
    return PointLight(rgb(moved + to_world[:3, 3]), _strength(p, "I"))


def _spot(p: ParameterSet, to_world: Floats) -> Light:
    """Return a spot light at ``from`` that looks at ``to``."""
    scale_of(to_world, "a spot light", "its cone is round")
    start, end = p.point("from", (0, 0, 0)), p.point("to", (0, 0, 1))
    outer, delta = p.number("coneangle", 30), p.number("conedeltaangle", 5)
    position, direction = to_world[:3, :3] @ start + to_world[:3, 3], to_world[:3, :3] @ (end - start)
    inner = min(abs(outer - delta), outer)  # only its cosine counts
    return SpotLight(rgb(position), rgb(direction), _strength(p, "I"), outer, inner, p.dialect == "v4")


def _distant(p: ParameterSet, to_world: Floats) -> Light:
    """Return a light from the direction of ``from``, seen from ``to``."""
    start, end = p.point("from", (0, 0, 0)), p.point("to", (0, 0, 1))
    return DistantLight(rgb(to_world[:3, :3] @ (start - end)), _strength(p, "L"))


def _infinite(p: ParameterSet, to_world: Floats) -> Light:
    """Return a sky, of one colour or of a map."""
    from dmis.formats.pbrt.textures import image
    from dmis.light.environment import EnvironmentLight

    rotation = to_world[:3, :3] / scale_of(to_world, "an infinite light", "it is all directions")
    texels = np.ones((1, 1, 3))
    if p.dialect == "v4":
        p.refuse("portals are not supported; remove the parameter", "portal")
        if "filename" in p.items:
            p.refuse("a light must have a map or L, not both", "L")
            texels = to_latitude_longitude(image(p, "filename"))
    elif "mapname" in p.items:
        texels = image(p, "mapname")
    return EnvironmentLight(texels, rotation, _strength(p, "L"), wrap="clamp" if p.dialect == "v4" else "repeat")


LIGHTS: dict[str, Callable[[ParameterSet, Floats], Light]] = {
    "point": _point,
    "spot": _spot,
    "distant": _distant,
    "infinite": _infinite,
}
"""Functions that make lights without a shape, by name."""


SIDE_SAMPLES = 4096
"""Lookups along the height of a map, at least one per row; a texel is the mean of the lookups in it."""


def sphere_to_square(d: Array) -> Array:
    """Return coordinates in [0, 1], ``(2, N)``, of unit directions ``(3, N)``."""
    x, y, z = np.abs(d)
    radius = np.sqrt(np.maximum(1 - z, 0))
    angle = np.arctan2(y, x) * (2 / np.pi)  # share of a quarter turn
    v = angle * radius
    u = radius - v
    u, v = np.where(d[2] < 0, (1 - v, 1 - u), (u, v))
    return (np.stack([np.copysign(u, d[0]), np.copysign(v, d[1])]) + 1) / 2


def to_latitude_longitude(square: Array) -> Array:
    """Return the latitude-longitude map ``(N, 2 N, 3)`` of a map of equal area ``(N, N, 3)``, both row 0 on top."""
    side = len(square)
    if square.shape[1] != side:
        raise ValueError(f"the map of a sky must be square in v4; got {square.shape[1]}x{side} pixels")
    fine = max(1, min(8, SIDE_SAMPLES // side))
    offsets = (np.arange(fine) + 0.5) / fine
    phi = ((np.arange(2 * side)[:, None] + offsets) * (np.pi / side)).reshape(-1)
    result = np.zeros((side, 2 * side, 3), np.float32)
    for block in row_blocks(side, 8):
        theta = ((np.arange(side)[block, None] + offsets) * (np.pi / side)).reshape(-1, 1)
        d = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi
        place = sphere_to_square(np.reshape(d, (3, -1)))
        column, row = np.minimum((place * side).astype(np.int32), side - 1)
        texels = square[row, column].reshape(-1, fine, 2 * side, fine, 3)
        result[block] = texels.mean(axis=(1, 3))
    return result
