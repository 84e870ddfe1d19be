"""What the commands share: the scene, sky and settings that the options name, and a progress bar."""

from __future__ import annotations

import argparse
import sys
from contextlib import AbstractContextManager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.atomic_files import check_writable
from dmis.base.text import printable
from dmis.estimator.settings import Settings
from dmis.formats.load_scene import load_scene
from dmis.formats.model import up_axis
from dmis.light.environment import EnvironmentLight
from dmis.pipeline.progress import Progress, reporting
from dmis.scene.camera import Camera
from dmis.scene.scene import Scene


def say(*lines: object, error: bool = False) -> None:
    """Print lines, `error`: on standard error; control characters of names and files are shown, not obeyed."""
    print(printable("\n".join(map(str, lines))), file=sys.stderr if error else sys.stdout, flush=True)


def load(options: argparse.Namespace, name: str) -> Scene:
    """Return the scene of a name or file, seen and lit as the options have it."""
    more: dict[str, Any] = {"camera": options.camera, "fov": options.fov}
    up = up_axis(name, options.up)
    if options.look_at is not None:
        eye, target = tuple(options.look_at[:3]), tuple(options.look_at[3:])
        along = not np.cross(np.subtract(target, eye), up).any()  # of an image that is seen from above or below
        top = ((0.0, 1.0, 0.0) if up[2] else (0.0, 0.0, -1.0)) if along else up
        more["camera"] = Camera.look_at(eye, target, top, options.fov or 45.0)
    if options.light is not None:
        more["lights"] = [read_sky(options.light, up)]
    more |= {"dialect": options.dialect, "outside": options.allow_outside, "up": options.up}
    return load_scene(name, options.resolution, **more)


def settings_of(options: argparse.Namespace, scene: Scene) -> Settings:
    """Return the settings that were given, with --as-in-file in place of the scene file's."""
    return Settings.as_in_file(scene, **options.given) if options.as_in_file else options.settings


def describe(scene: Scene) -> str:
    """Return the name, resolution and plan of a scene."""
    width, height = scene.camera.resolution
    unseen = 0 if scene.covered_pixels is None else int((~scene.covered_pixels).sum())
    empty = f" ({unseen:,} of them see no surface or light and are not sampled)" if unseen else ""
    return f"scene {scene.name}: {width}x{height} pixels{empty}, {scene.describe()}"


def check_page(path: Path) -> None:
    """Raise a ValueError unless a page has the name of one, an OSError if it cannot be written."""
    if path.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"a page must end in .html; got {str(path)!r}")
    check_writable(path)


def progress_bar(quiet: bool) -> AbstractContextManager[Progress | None]:
    """Give a progress bar if standard error is a terminal and tqdm is there; it prints nothing into a log."""
    return reporting(not quiet and sys.stderr.isatty() and find_spec("tqdm") is not None)


def read_sky(text: str, up: tuple[float, float, float]) -> EnvironmentLight:
    """Return the sky of a text: an even one of "R G B" or of one number, or that of an image file.

    The top of the image is towards `up`, and it is not mirrored: text in it can be read.
    """
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        if not Path(text).is_file():
            raise FileNotFoundError(f"no such image: {text}; --light takes an image file or 'R G B': '1 1 1'") from None
        y_up = up[1] != 0
        return EnvironmentLight(text, np.eye(3)[[0, 2, 1]] if y_up else np.diag((1.0, -1.0, 1.0)))  # type: ignore[arg-type]
    if len(values) not in (1, 3):
        raise ValueError(f"--light must be an image file, or one number or three; got {len(values)}: {text!r}")
    return EnvironmentLight(np.broadcast_to(values, (16, 32, 3)))
