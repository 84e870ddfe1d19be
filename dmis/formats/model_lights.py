"""Lights of models: lamps that overlap, the share of the image that emission lights, and lights of dark models."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from dmis.base.color import Rgb
from dmis.base.vectors import Array
from dmis.estimator.allocation import CameraSamples
from dmis.estimator.batch import Batch
from dmis.estimator.mis import BRDF, LIGHT, Combiner
from dmis.estimator.settings import Settings
from dmis.estimator.trace import radiance
from dmis.formats.model import Model
from dmis.intersect import CountingCaster
from dmis.light.area import QuadLight
from dmis.light.coincident import find_overlaps, lamp_triangles
from dmis.light.environment import EnvironmentLight
from dmis.light.light import Light
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import Numbers
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene, SceneWarning

LIT = 1e-3
"""Least radiance of a lit place of the image, over the largest radiance that is emitted."""
COLUMNS, ROWS, SPP = 32, 24, 8
"""Places of the probe render, and samples of each."""
SKY = 0.25
"""Radiance of the default sky of a mesh; its lamp adds the rest of 1."""
SOFT_SKY = (0.1, 0.32, 0.62)
"""Radiance of the default sky of a model with materials: below, at the horizon and above, linear in the height."""
LEAST_LIT = 0.1
"""Least share of the image that emission lights so that a model needs no sky and lamp: the share is 0.97 in the room of
`scenes/make_room.py`, 0.2 from outside, and at most 0.03 in models with displays or status lights."""


def without_overlaps(model: Model, parts: list[Part], camera: Camera) -> tuple[list[Part], float]:
    """Return the parts, later ones of overlapping lamps without emission, and the share of the image that all light.

    Emission that is lost is counted as left out of the model.
    """
    lamps = tuple(part.light for part in parts if part.light is not None)
    if not lamps:
        return parts, 0.0
    with warnings.catch_warnings():  # the scene that is rendered warns, too
        warnings.simplefilter("ignore", SceneWarning)
        scene = Scene(camera, tuple(parts), lamps)
    dropped = overlapping_lamps(scene)
    model.unread["emission of a surface that overlaps another lamp"] += len(dropped)
    parts = [replace(part, light=None) if k in dropped else part for k, part in enumerate(parts)]
    return parts, lit_share(scene)


def overlapping_lamps(scene: Scene) -> set[int]:
    """Return the numbers of the parts whose lights overlap the light of an earlier part.

    As in `Scene.prepare`, which refuses such lights, rays to each triangle of a lamp must meet it first.
    """
    scene, _ = scene.in_float32
    triangles, _, owner = lamp_triangles(scene.parts)
    number, met = find_overlaps(scene.intersector, triangles, 2 * float(np.min(scene.epsilon)))
    part_of = np.repeat(np.arange(len(scene.parts)), [part.mesh.triangles for part in scene.parts])
    first, second = np.sort(np.stack([owner[number], part_of[met]]), axis=0)
    emits = np.array([part.light is not None for part in scene.parts])
    return set(second[(first != second) & emits[first] & emits[second]].tolist())


def lit_share(scene: Scene) -> float:
    """Return the share of the image in which surfaces reflect light, more than `LIT` of the most that is emitted.

    By paths through `COLUMNS` x `ROWS` places; places that show a lamp itself do not count.
    """
    scene, _ = scene.in_float32
    rng, places = np.random.default_rng(1), COLUMNS * ROWS
    corners = np.mgrid[:ROWS, :COLUMNS].reshape(2, 1, places)
    y, x = ((corners + rng.random((2, SPP, places))) / [[[ROWS]], [[COLUMNS]]]).reshape(2, -1).astype(np.float32)
    width, height = scene.camera.resolution
    origin, direction = scene.camera.lens_rays(x * width, y * height)
    settings = Settings(integrator="path", max_depth=4, sampler="independent")
    block = PixelBlock(rng, 1, np.arange(places), [SPP], settings.shading_samples)
    numbers = Numbers("independent", block)
    samples = CameraSamples(
        pixel=np.tile(np.arange(places), SPP),
        number=np.repeat(np.arange(SPP), places),
        shares=np.full((2, 1), 0.5, np.float32),
        counts=(1, 1),
    )
    numbers.start(samples.pixel, samples.number)
    caster = CountingCaster(scene.intersector)
    batch = Batch(scene, caster, settings, (LIGHT, BRDF), Combiner("balance"), samples, numbers)
    emits = np.repeat([part.light is not None for part in scene.parts], [part.mesh.triangles for part in scene.parts])
    prim = scene.intersector.closest(origin, direction).prim
    reflected = radiance(batch, origin, direction).max(axis=0) * ~((prim >= 0) & emits[prim])
    largest = max(light.brightness(1.0) for light in scene.lights)
    return float((reflected.reshape(SPP, places).mean(axis=0) > LIT * largest).mean())


def default_lights(camera: Camera, low: Array, high: Array, up: Rgb | None = None) -> list[Light]:
    """Return the lights of a mesh that has none: a sky, and a lamp that shows its shape.

    The sky has radiance `SKY`; with an axis `up` it is soft, `SOFT_SKY`, so that metals have something to reflect. The
    lamp is a square behind the camera, to the upper left and out of its view, that looks at the middle of the mesh,
    whose least and largest coordinates are `low` and `high` ``(3,)``, and is about as large. Under an even sky an
    unoccluded white surface that faces the lamp has radiance 1.
    """
    sky = EnvironmentLight(np.full((16, 32, 3), SKY))
    if up is not None:
        height = np.cos((np.arange(64) + 0.5) * np.pi / 64)
        soft = np.interp(height, (-1, 0, 1), SOFT_SKY)
        axes = np.eye(3) if up[2] else np.eye(3)[[0, 2, 1]]
        sky = EnvironmentLight(np.broadcast_to(soft[:, None, None], (64, 128, 3)), axes)
    middle = (low + high) / 2
    eye = np.asarray(camera.to_world, float)[:3, 3]
    right, up, forward = (axis / np.linalg.norm(axis) for axis in np.asarray(camera.to_world, float)[:3, :3].T)
    distance = max(float(np.linalg.norm(middle - eye)), float(np.linalg.norm(high - low)) / 2)
    # 0.4 behind the camera, which is more than the edges of the tilted square come forward
    centre = eye + distance * (0.9 * (up - right) - 0.4 * forward)
    towards, side = middle - centre, 0.7 * distance
    across = np.cross(towards, up)
    first = across * (side / np.linalg.norm(across))
    second = np.cross(towards, first) / np.linalg.norm(towards)
    # E = pi L sin^2 of the angle of a disk of the same area, pi r^2
    square = side**2 / np.pi
    radiance = (1 - SKY) * (1 + towards @ towards / square)
    corner, u, v = (tuple(place.tolist()) for place in (centre - (first + second) / 2, first, second))
    return [sky, QuadLight(corner, u, v, (radiance,) * 3)]
