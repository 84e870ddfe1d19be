"""What the commands share: the scene and the settings that the options name, and a progress bar."""

from __future__ import annotations

import argparse
import sys
from contextlib import AbstractContextManager
from dataclasses import fields
from importlib.util import find_spec
from typing import Any

from dmis.cli.models import read_material, read_sky
from dmis.estimator.settings import Settings
from dmis.formats.load_scene import load_scene
from dmis.formats.read_model import up_axis
from dmis.pipeline.job import DEFAULT_SPP
from dmis.pipeline.progress import Progress, reporting
from dmis.scene.camera import Camera
from dmis.scene.scene import Scene


def load(options: argparse.Namespace) -> Scene:
    """Return the scene that the options name."""
    more: dict[str, Any] = {"camera": options.camera, "fov": options.fov}
    up = up_axis(options.scene, options.up)
    if options.look_at is not None:
        eye, target = tuple(options.look_at[:3]), tuple(options.look_at[3:])
        more["camera"] = Camera.look_at(eye, target, up, options.fov or 45.0)
    if options.light is not None:
        more["lights"] = [read_sky(options.light, up)]
    if options.material is not None:
        more["material"] = read_material(options.material)
    more |= {"dialect": options.dialect, "outside": options.allow_outside, "up": options.up}
    return load_scene(options.scene, options.resolution, **more)


def given_settings(options: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of `Settings` that were given as options, by name."""
    return {field.name: getattr(options, field.name) for field in fields(Settings) if hasattr(options, field.name)}


def settings_of(options: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Return fields of `Settings` by name: those given, and with --as-in-file the scene file's."""
    given = given_settings(options)
    return vars(Settings.as_in_file(scene, **given)) if options.as_in_file else given


def spp_of(options: argparse.Namespace, scene: Scene) -> int:
    """Return the camera samples per pixel where no option says."""
    return (scene.suggested.spp if options.as_in_file else None) or DEFAULT_SPP


def describe(scene: Scene) -> str:
    """Return the name, resolution and plan of a scene."""
    width, height = scene.camera.resolution
    unseen = 0 if scene.covered_pixels is None else int((~scene.covered_pixels).sum())
    empty = f" ({unseen:,} of them see no surface or light and are not sampled)" if unseen else ""
    return f"scene {scene.name}: {width}x{height} pixels{empty}, {scene.describe()}"


def progress_bar(quiet: bool) -> AbstractContextManager[Progress | None]:
    """Give a progress bar if standard error is a terminal and tqdm is there; it prints nothing into a log."""
    return reporting(not quiet and sys.stderr.isatty() and find_spec("tqdm") is not None)
