"""Units that suit float32: a scene near its origin, of a size near 1, whose lights are near 1.

float32 has 7 digits, and squares between 1e-38 and 1e38. A scene of size 1 that is a million away from the origin would
have one digit left for its shape; one of radiance 1e30 has variances that are infinite. Neither is lost in the float64
description that scenes have. So what is extreme is moved, and multiplied by powers of two, before float32 sees it, and
the image is multiplied back. Triangles that are huge beside small bodies are split near these
(`dmis.geometry.refinement`). No bit of an ordinary scene's image depends on this, and nothing is copied for it.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.geometry.mesh import Mesh
from dmis.geometry.refinement import diagonals, refine_near_bodies, small_beside
from dmis.scene.scene import RAY_OFFSET, Scene

MAX_REACH = 16
"""Largest coordinate in diagonals of the scene for which the origin stays: a scene loses one digit of float32 for each
factor of ten."""
KEPT_DIAGONALS = 2.0**-20, 2.0**20
"""Range of diagonals of scenes whose unit of length stays."""
KEPT_RADIANCES = 2.0**-32, 2.0**32
"""Range of the brightest radiance for which its unit stays: squares of samples, and 1e9 times these, are in float32."""
LIGHT_EXTENTS = 1e-12, 1e12
"""Range of extents of lights, in diagonals of the scene."""
MAX_RESOLVED_REACH = 1e4
"""Largest coordinate in diagonals of a body at which the ray offset is small beside the body: a hundredth of it."""


def rescale_for_float32(scene: Scene) -> tuple[Scene, float]:
    """Return a scene of the same looks in units that suit float32, and the factor for its image.

    Raises
    ------
    ValueError
        If the scene is so far away from the origin that even float64 keeps fewer than 7 digits of it, or a light is so
        small or so large that squares of its size are beyond float32.
    """
    return (scene, 1.0) if _fits_float32(scene) else _rescale(scene)


def _fits_float32(scene: Scene) -> bool:
    """Return whether float32 holds a scene as it is: size, distance, lights and bodies are in their ranges."""
    low, high = scene.bounds
    size = float(np.linalg.norm(high - low))
    brightest = max((light.brightness(1.0) for light in scene.lights), default=0.0)
    extents = [extent for light in scene.lights if (extent := light.extent()) is not None]
    largest = max(size, *(part.mesh.edges[1] for part in scene.parts))
    return (
        KEPT_DIAGONALS[0] <= size <= KEPT_DIAGONALS[1]
        and float(np.abs([low, high]).max()) <= MAX_REACH * size
        and (brightest == 0 or KEPT_RADIANCES[0] <= brightest <= KEPT_RADIANCES[1])
        and all(LIGHT_EXTENTS[0] * size <= extent <= LIGHT_EXTENTS[1] * size for extent in extents)
        and not len(small_beside(largest, scene.bodies))
    )


def _rescale(scene: Scene) -> tuple[Scene, float]:
    """Return `rescale_for_float32` of a scene that may not fit."""
    low, high = scene.bounds
    size, reach = float(np.linalg.norm(high - low)), float(np.abs([low, high]).max())
    if reach > 1e9 * size > 0:
        raise ValueError(
            f"a scene must not be further from the origin than 1e9 times its size, where its shape is rounding; got "
            f"coordinates up to {reach:g} and a diagonal of {size:g}"
        )
    for light in scene.lights:
        extent = light.extent()
        if extent is not None and size > 0 and not LIGHT_EXTENTS[0] * size <= extent <= LIGHT_EXTENTS[1] * size:
            raise ValueError(
                f"a light must have {LIGHT_EXTENTS[0]:g} to {LIGHT_EXTENTS[1]:g} times the size of the scene, because "
                f"float32 does not hold its area; got a {type(light).__name__} of {extent:g} in a scene of diagonal "
                f"{size:g}. A smaller one is a PointLight, a larger one an EnvironmentLight"
            )
    origin = _origin(scene, low, high)
    _check_small_bodies(scene, origin)
    length = 1.0 if KEPT_DIAGONALS[0] <= size <= KEPT_DIAGONALS[1] or size == 0 else _power_of_two(size)
    brightest = max((light.brightness(length) for light in scene.lights), default=0.0)
    gain = 1.0 if KEPT_RADIANCES[0] <= brightest <= KEPT_RADIANCES[1] or brightest == 0 else _power_of_two(brightest)
    if not origin.any() and length == gain == 1:
        return _resolved(scene), 1.0
    lights: dict[int, Any] = {id(light): light.rescaled(origin, length, gain) for light in scene.lights}
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
    return _resolved(
        scene.changed(camera=camera, parts=parts, lights=tuple(lights[id(light)] for light in scene.lights))
    ), gain


def _origin(scene: Scene, low: Array, high: Array) -> Array:
    """Return the new origin, ``(3,)``: amid the scene, or its small bodies, if they are far off; else 0."""
    origin, small = np.zeros(3), scene.small_bodies
    boxes = [(low, high)]
    if len(small):
        boxes.append((small[:, 0].min(axis=0), small[:, 1].max(axis=0)))
    for least, largest in boxes:
        if np.abs([least, largest]).max() > MAX_REACH * np.linalg.norm(largest - least):
            origin = (least + largest) / 2
    return origin


def _check_small_bodies(scene: Scene, origin: Array) -> None:
    """Warn where float32 does not resolve a small body, however the triangles beside it are split."""
    small = scene.small_bodies
    if not len(small):
        return
    diagonal, reach = diagonals(small), np.abs(small - origin).max(axis=(1, 2))
    worst = int(np.argmax(reach / diagonal))
    if reach[worst] > MAX_RESOLVED_REACH * diagonal[worst]:
        warnings.warn(
            f"float32 does not resolve a body of size {diagonal[worst]:.3g} that is {reach[worst]:.3g} away from the "
            f"origin: shadows within {RAY_OFFSET * reach[worst]:.3g} of it are lost. Render it as a "
            f"scene without what is far away",
            stacklevel=5,
        )


def _resolved(scene: Scene) -> Scene:
    """Return `scene` with its huge triangles split near small bodies, see `dmis.geometry.refinement`."""
    parts = tuple(replace(part, mesh=refine_near_bodies(part.mesh, scene.bodies)) for part in scene.parts)
    same = all(new.mesh is old.mesh for new, old in zip(parts, scene.parts, strict=True))
    return scene if same else scene.changed(parts=parts)


def _power_of_two(value: float) -> float:
    return 2.0 ** math.floor(math.log2(value))
