"""Colours of vertices as an image: a square of two by two texels for each triangle."""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Floats
from dmis.brdf.texture import Image
from dmis.geometry.mesh import Mesh


def paint(mesh: Mesh, colours: Floats) -> tuple[Mesh, Image]:
    """Return a mesh whose triangles have coordinates of their own, and the image that they show: their colours.

    Parameters
    ----------
    mesh
        Its texture coordinates are replaced.
    colours
        Linear RGB of the vertices, ``(V, 3)``, from 0 to 1.

    Notes
    -----
    Bilinear interpolation in a square is linear on the triangle of three corners, ``c0 + a (c1 - c0) + b (c2 - c0)``,
    if the fourth corner is ``c1 + c2 - c0``. Of the three corners that may be c0, the one is taken for which this is
    nearest to [0, 1], to which it is clipped: of grey always one is inside.
    """
    turns = [np.roll(mesh.faces, turn, axis=1) for turn in range(3)]
    fourths = [colours[f[:, 1]] + colours[f[:, 2]] - colours[f[:, 0]] for f in turns]
    beyond = [np.abs(fourth - np.clip(fourth, 0, 1)).max(axis=1) for fourth in fourths]
    best = np.argmin(beyond, axis=0)
    triangle = np.arange(len(best))
    corner = np.stack(turns)[best, triangle].ravel()
    fourth = np.clip(np.stack(fourths)[best, triangle], 0, 1)
    across = int(np.ceil(np.sqrt(len(best))))
    down = -(-len(best) // across)
    texels = np.zeros((down, 2, across, 2, 3), np.float32)
    row, column = np.divmod(triangle, across)
    c = colours[corner].reshape(-1, 3, 3)
    for (i, j), values in zip(((0, 0), (0, 1), (1, 0), (1, 1)), (c[:, 0], c[:, 1], c[:, 2], fourth), strict=True):
        texels[row, i, column, j] = values
    places = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
    uv = (2 * np.stack([column, row], axis=1)[:, None] + places) / (2 * across, 2 * down)
    normals = None if mesh.normals is None else mesh.normals[corner]
    faces = np.arange(len(corner)).reshape(-1, 3)
    return Mesh(mesh.vertices[corner], faces, normals, uv.reshape(-1, 2)), Image(
        texels.reshape(2 * down, 2 * across, 3), wrap="clamp"
    )
