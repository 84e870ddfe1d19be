"""The camera of a pbrt file, made of its Camera, Film and PixelFilter lines at the end of the file."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dmis.base.validate import FARTHEST
from dmis.base.vectors import Floats
from dmis.formats.pbrt.parameters import Parameters
from dmis.formats.pbrt.reader import Reader
from dmis.formats.pbrt.tokens import blame
from dmis.scene.camera import Camera

CAMERAS: dict[str, dict[str, Any]] = {
    dialect: {"perspective": "perspective", "orthographic": "orthographic", around: "spherical"}
    for dialect, around in (("v2", "environment"), ("v3", "environment"), ("v4", "spherical"))
}
"""Projections by the names of the dialect and of the camera."""


def make_camera(reader: Reader) -> Camera:
    """Return the camera of a file that was read."""
    film, p = reader.film, reader.camera
    wide, high = reader.dialect.film_size
    size = film.integer("xresolution", wide), film.integer("yresolution", high)
    film.refuse("pixelbounds is not supported; use cropwindow", "pixelbounds")
    film.require(reader.dialect.required.get("Film", {}))
    crop = film.table("cropwindow", "float", 4)
    if reader.resolution is None:
        with blame(film.directive):
            Camera(np.eye(4), 90.0, size)
    width, height = reader.resolution or size
    window = _window(p, width / height)
    projection = CAMERAS[reader.dialect.name][reader.camera_kind]
    half, fov = p.number("halffov", 0), p.number("fov", 90)
    fov = (2 * half if half > 0 else fov) if projection == "perspective" else 90.0
    if window != 1:
        fov = float(np.degrees(2 * np.arctan(window * np.tan(np.radians(fov / 2)))))
    radius, focus = p.number("lensradius", 0), p.number("focaldistance", 1e6)
    if projection == "spherical":
        radius = 0
        if reader.dialect.name == "v4" and p.string("mapping", "equalarea") != "equirectangular":
            raise p.directive.error('needs "string mapping" "equirectangular"; maps of equal area are not supported')
    for name, line in (("Film", film), ("Camera", p)):
        line.note_unapplied(reader.dialect.unapplied.get(name, {}))
        reader.notes.add_findings(line)
        reader.notes.add_unread(line)
    with blame(p.directive):
        camera = Camera(inverse(reader.to_camera), fov, (width, height), filter=reader.filter, projection=projection)
        if radius:
            camera = replace(camera, lens_radius=radius, focal_distance=min(focus, FARTHEST))
    if crop is None:
        return camera
    if crop.shape != (1, 4) or not ((crop >= 0) & (crop <= 1)).all():
        got = crop.tolist()
        raise film.items["cropwindow"].error(f"must be four shares of the image, 0 to 1: x, x, y, y; got {got}")
    left, right, top, bottom = np.ceil(crop[0] * [width, width, height, height]).astype(int).tolist()
    with blame(film.items["cropwindow"].token):
        return camera.crop((top, bottom), (left, right))


def _window(p: Parameters, ratio: float) -> float:
    """Return the factor by which the screen window is larger than that of an image of the aspect `ratio`."""
    square = np.array([-max(ratio, 1), max(ratio, 1), -max(1 / ratio, 1), max(1 / ratio, 1)])
    aspect, window = p.table("frameaspectratio", "float", 1), p.table("screenwindow", "float", 4)
    if aspect is not None and not np.isclose(aspect[0, 0], ratio, rtol=1e-6):
        raise p.items["frameaspectratio"].error(f"must be that of square pixels, [{ratio:g}]")
    factor = 1.0 if window is None else float(window[0, 3] / square[3])
    if window is not None and not (factor > 0 and np.allclose(window, square * factor, rtol=1e-6)):
        text = " ".join(f"{number:g}" for number in square)
        raise p.items["screenwindow"].error(f"must be that of square pixels, [{text}], or a multiple of it")
    return 1.0 if np.isclose(factor, 1, rtol=1e-6) else factor


def inverse(matrix: Floats) -> Floats:
    """Return the inverse of an affine matrix (4, 4)."""
    result = np.asarray(np.linalg.inv(matrix), np.float64)
    result[3] = 0, 0, 0, 1
    return result
