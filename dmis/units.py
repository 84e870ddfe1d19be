"""Units that suit float32: a scene near its origin, of a size near 1, whose lights are near 1.

float32 has 7 digits, and squares between 1e-38 and 1e38. A scene of size 1 that is a million away from the origin would
have one digit left for its shape; one of radiance 1e30 has variances that are infinite. Neither is lost in the float64
description that scenes have. So what is extreme is moved, and multiplied by powers of two, before float32 sees it, and
the image is multiplied back. No bit of an ordinary scene's image depends on this, and nothing is copied for it.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np

from dmis.light import DiskLight, EnvironmentLight, Light, MeshLight, QuadLight, SphereLight
from dmis.mesh import Mesh
from dmis.scene import Scene
from dmis.vec import Array

FAR_OFF = 16
"""Largest coordinate, in diagonals of the scene, up to which float32 positions have digits enough: a scene loses one
digit for each factor of ten."""
LENGTHS = 2.0**-20, 2.0**20
"""Diagonals that stay as they are."""
RADIANCES = 2.0**-32, 2.0**32
"""Those of the brightest light that stay as they are: radiances of samples, their squares, and 1e9 times as much."""
EXTENTS = 1e-12, 1e12
"""Of lights, in diagonals of the scene."""
_POINTS, _VECTORS = ("position", "centre", "corner", "vertices"), ("radius", "edge_u", "edge_v")


def suited(scene: Scene) -> tuple[Scene, float]:
    """`scene`, or one that looks the same in better units, and by what an image of it is to be multiplied.

    Raises
    ------
    ValueError
        If the scene is so far away from the origin that even float64 keeps fewer than 7 digits of it, or a light is so
        small or so large that squares of its size are beyond float32.
    """
    low, high = scene.bounds
    size, reach = float(np.linalg.norm(high - low)), float(np.abs([low, high]).max())
    if reach > 1e9 * size > 0:
        raise ValueError(
            f"a scene must not be further from the origin than 1e9 times its size, where its shape is rounding; got "
            f"coordinates up to {reach:g} and a diagonal of {size:g}"
        )
    for light in scene.lights:
        extent = _extent(light)
        if extent is not None and size > 0 and not EXTENTS[0] * size <= extent <= EXTENTS[1] * size:
            raise ValueError(
                f"a light must have {EXTENTS[0]:g} to {EXTENTS[1]:g} times the size of the scene, because float32 does "
                f"not hold its area; got a {type(light).__name__} of {extent:g} in a scene of diagonal {size:g}. "
                f"A smaller one is a PointLight, a larger one an EnvironmentLight"
            )
    origin = (low + high) / 2 if reach > FAR_OFF * size else np.zeros(3)
    length = 1.0 if LENGTHS[0] <= size <= LENGTHS[1] or size == 0 else _power_of_two(size)
    brightest = max((_brightness(light, length) for light in scene.lights), default=0.0)
    gain = 1.0 if RADIANCES[0] <= brightest <= RADIANCES[1] or brightest == 0 else _power_of_two(brightest)
    if not origin.any() and length == gain == 1:
        return scene, 1.0
    lights = {id(light): _light(light, origin, length, gain) for light in scene.lights}
    parts = tuple(
        replace(
            part,
            mesh=Mesh((part.mesh.vertices - origin) / length, part.mesh.faces, part.mesh.normals, part.mesh.uv),
            light=part.light and lights[id(part.light)],
        )
        for part in scene.parts
    )
    matrix = np.array(scene.camera.to_world, np.float64)
    matrix[:3, 3] = (matrix[:3, 3] - origin) / length
    camera = replace(scene.camera, to_world=matrix)
    return replace(scene, camera=camera, parts=parts, lights=tuple(lights.values())), gain


def _power_of_two(value: float) -> float:
    return 2.0 ** math.floor(math.log2(value))


def _extent(light: Light) -> float | None:
    """Radius, or root of the area; None for lights without any."""
    if isinstance(light, DiskLight | SphereLight):
        return float(light.radius)
    if isinstance(light, QuadLight):
        return float(np.sqrt(np.linalg.norm(np.cross(light.edge_u, light.edge_v))))
    if isinstance(light, MeshLight):
        return float(np.linalg.norm(np.ptp(np.asarray(light.vertices, np.float64), axis=0)))
    return None


def _brightness(light: Light, length: float) -> float:
    """Largest radiance; of point and spot lights, at the distance `length`."""
    if isinstance(light, EnvironmentLight):
        texels = np.broadcast_to(np.asarray(light.texels).max(axis=(0, 1)).astype(float), 3)
        return float((texels * light.scale).max())
    radiance = getattr(light, "radiance", None)
    return float(np.max(light.intensity) / length**2 if radiance is None else np.max(radiance))  # type: ignore[union-attr]


def _light(light: Light, origin: Array, length: float, gain: float) -> Any:
    """The same light in other units."""
    changes: dict[str, Any] = {}
    units = {"radiance": gain, "scale": gain, "intensity": gain * length**2, **dict.fromkeys(_VECTORS, length)}
    for name in (field.name for field in fields(light)):
        if name in _POINTS:
            changes[name] = (np.asarray(getattr(light, name), np.float64) - origin) / length
        elif name in units:
            changes[name] = np.asarray(getattr(light, name), np.float64) / units[name]
    copy: Any = replace  # of whichever kind of light
    return copy(light, **{name: value if value.ndim else float(value) for name, value in changes.items()})
