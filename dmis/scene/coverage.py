"""Pixel coverage: the pixels that triangles may cover, as the union of the bounds of all triangles in the image.

Only what is provable counts. A pixel is left out if it lies outside the rectangle of every triangle, with room for the
pixel filter and for the rounding of float32 positions and directions; a triangle that reaches behind the camera covers
everything, and so it is for any camera but a pinhole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.geometry.mesh import Mesh
from dmis.scene.camera import Camera

POSITION_ERROR = 2.0**-18
"""Share of the largest coordinate by which positions may be off, many times that of float32."""


def find_covered_pixels(camera: Camera, meshes: Sequence[Mesh]) -> np.ndarray | None:
    """Return the pixels that triangles of `meshes` may cover, ``(H, W)`` bool; None if that is all of them."""
    if not camera.is_pinhole:
        return None
    width, height = camera.resolution
    size = np.array([[width], [height]])
    reach = 0.0 if camera.filter is None else max(camera.filter.radius)
    begins = np.zeros((height + 1, width + 1), np.int32)  # its sums over rows and columns count rectangles
    for mesh in meshes:
        error = POSITION_ERROR * max(np.abs(mesh.vertices).max(), np.abs(camera.origin).max())
        x, y, depth, scale = camera.raster(mesh.vertices)
        near = error * scale  # of camera space, where lengths may differ from the world's
        faces = mesh.faces[(depth[mesh.faces] > -near).any(axis=1)]
        if (depth[faces] <= near).any():
            return None
        places = np.stack([x, y])
        margin = 1 + reach + near / (depth * camera.pixel)
        # rectangles outside of the image have no extent
        left, top = np.floor(np.clip((places - margin)[:, faces].min(axis=2), 0, size)).astype(np.int64)
        right, bottom = np.ceil(np.clip((places + margin)[:, faces].max(axis=2), 0, size)).astype(np.int64)
        for row, column, step in ((top, left, 1), (top, right, -1), (bottom, left, -1), (bottom, right, 1)):
            np.add.at(begins, (row, column), step)
    covered = begins.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0
    return None if covered.all() else covered
