"""Emission of models: lamps of a file that overlap, and how much of the image all of them light."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from dmis.estimator.allocation import CameraSamples
from dmis.estimator.batch import Batch
from dmis.estimator.mis import Combiner
from dmis.estimator.settings import Settings
from dmis.estimator.technique import BRDF, LIGHT
from dmis.estimator.trace import radiance
from dmis.formats.model import Model
from dmis.intersect import CountingCaster
from dmis.light.coincident import find_overlaps, lamp_triangles
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import SAMPLERS, Numbers
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene, SceneWarning

LIT = 1e-3
"""Least radiance of a lit place of the image, over the largest radiance that is emitted."""
COLUMNS, ROWS, SPP = 32, 24, 8
"""Places of the probe render, and samples of each."""
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
    numbers = Numbers(SAMPLERS["independent"](block), rng)
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
