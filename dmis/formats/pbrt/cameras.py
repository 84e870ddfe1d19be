"""The camera of a pbrt file, made of its Camera, Film and PixelFilter lines at the end of the file."""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Floats
from dmis.formats.pbrt.reader import Reader
from dmis.formats.pbrt.tokens import blame
from dmis.scene.camera import Camera


def make_camera(reader: Reader) -> Camera:
    """Return the camera of a file that was read."""
    film, p = reader.film, reader.camera
    wide, high = reader.dialect.film_size
    size = film.integer("xresolution", wide), film.integer("yresolution", high)
    film.refuse("pixelbounds is not supported; use cropwindow", "pixelbounds")
    film.require(reader.dialect.required.get("Film", {}))
    p.require({"lensradius": 0.0, **reader.dialect.required.get("Camera", {})})
    crop = film.table("cropwindow", "float", 4)
    if reader.resolution is None:
        with blame(film.directive):
            Camera(np.eye(4), 90.0, size)
    width, height = reader.resolution or size
    half, fov = p.number("halffov", 0), p.number("fov", 90)
    ratio = width / height
    x, y = max(ratio, 1), max(1 / ratio, 1)
    for name, square in (("frameaspectratio", [ratio]), ("screenwindow", [-x, x, -y, y])):
        if (table := p.table(name, "float", len(square))) is not None and not np.allclose(table, square, rtol=1e-6):
            text = " ".join(f"{number:g}" for number in square)
            raise p.items[name].error(f"must be that of square pixels, [{text}]; use fov instead")
    for name, line in (("Film", film), ("Camera", p)):
        line.note_unapplied(reader.dialect.unapplied.get(name, {}))
        reader.notes.add_findings(line)
        reader.notes.add_unread(line)
    with blame(p.directive):
        camera = Camera(inverse(reader.to_camera), 2 * half if half > 0 else fov, (width, height), filter=reader.filter)
    if crop is None:
        return camera
    if crop.shape != (1, 4) or not ((crop >= 0) & (crop <= 1)).all():
        got = crop.tolist()
        raise film.items["cropwindow"].error(f"must be four shares of the image, 0 to 1: x, x, y, y; got {got}")
    left, right, top, bottom = np.ceil(crop[0] * [width, width, height, height]).astype(int).tolist()
    with blame(film.items["cropwindow"].token):
        return camera.crop((top, bottom), (left, right))


def inverse(matrix: Floats) -> Floats:
    """Return the inverse of an affine matrix (4, 4)."""
    result = np.asarray(np.linalg.inv(matrix), np.float64)
    result[3] = 0, 0, 0, 1
    return result
