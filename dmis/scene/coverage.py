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
    begins = np.zeros((height + 1, width + 1), np.int32)  # its sums over rows and columns count rectangles
    for mesh in meshes:
        if not _count(begins, camera, mesh):
            return None
    covered = begins.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0
    return None if covered.all() else covered


def _count(begins: np.ndarray, camera: Camera, mesh: Mesh) -> bool:
    """Add the rectangles of a mesh's triangles; False if one of them covers everything."""
    width, height = camera.resolution
    error = POSITION_ERROR * max(np.abs(mesh.vertices).max(), np.abs(camera.origin).max())
    x, y, depth, scale = camera.raster(mesh.vertices)
    near = error * scale  # of camera space, where lengths may differ from the world's
    faces = mesh.faces[(depth[mesh.faces] > -near).any(axis=1)]
    if (depth[faces] <= near).any():
        return False
    reach = 0.0 if camera.filter is None else max(camera.filter.radius)
    margin = 1 + reach + near / (depth * camera.pixel)
    low_x, low_y = ((a - margin)[faces].min(axis=1) for a in (x, y))
    high_x, high_y = ((a + margin)[faces].max(axis=1) for a in (x, y))
    inside = (high_x >= 0) & (low_x <= width) & (high_y >= 0) & (low_y <= height)
    left, right = np.floor(np.clip(low_x, 0, width)), np.ceil(np.clip(high_x, 0, width))
    top, bottom = np.floor(np.clip(low_y, 0, height)), np.ceil(np.clip(high_y, 0, height))
    edges = [a[inside].astype(np.int64) for a in (left, right, top, bottom)]
    left, right, top, bottom = edges
    for row, column, step in ((top, left, 1), (top, right, -1), (bottom, left, -1), (bottom, right, 1)):
        np.add.at(begins, (row, column), step)
    return True
